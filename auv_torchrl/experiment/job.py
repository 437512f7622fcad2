"""What ``train.py`` does once its command line is read."""

import logging
from pathlib import Path

import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from auv_torchrl.command import checking_input
from auv_torchrl.command.chosen import scenario_name
from auv_torchrl.experiment.run import run
from auv_torchrl.experiment.schema import DEFAULT_RANDOMIZATION, OWN_RANDOMIZATION
from auv_torchrl.experiment.setup import read_experiment

log = logging.getLogger("train")


def train(config: DictConfig) -> None:
    """Check the config, run the experiment."""
    torch.set_num_threads(1)  # small networks: a second thread costs more than it gives, and the cores are for sweeps
    hydra = HydraConfig.get()
    with checking_input():
        experiment = read_experiment(config, scenario_name(hydra.runtime.choices, hydra.overrides.task))
    default, chosen = DEFAULT_RANDOMIZATION, hydra.runtime.choices
    if chosen.get("randomization") == default and f"randomization={default}" not in hydra.overrides.task:
        log.info("no randomization for vehicle=%s: training draws from randomization=%s", chosen["vehicle"], default)
    if chosen.get("randomization") == OWN_RANDOMIZATION:
        log.info("training draws from what the file of vehicle=%s says is uncertain in it", chosen["vehicle"])
    folder = Path(hydra.runtime.output_dir)
    run(experiment, folder)
    log.info("\nresults.json, figures and run.rrd are in %s", folder)
