"""Train a source policy, break the vehicle, adapt the policy from a few seconds of data, and report.

``python train.py +scenario=thruster_gain``; every setting is in conf/train.yaml.
"""

import logging
import sys
from pathlib import Path

import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from auv_torchrl.command import checking_input, command
from auv_torchrl.experiment import schema
from auv_torchrl.experiment.run import run
from auv_torchrl.experiment.setup import read_experiment, scenario_name

log = logging.getLogger("train")
schema.register()


@command("train", files=("diagnosis_file", "policies", "output"), groups=("scenario", "experiment"))
def main(config: DictConfig) -> None:
    """Check the config, run the experiment."""
    torch.set_num_threads(1)  # small networks: a second thread costs more than it gives, and the cores are for sweeps
    hydra = HydraConfig.get()
    with checking_input():
        experiment = read_experiment(config, scenario_name(hydra.runtime.choices, hydra.overrides.task))
    folder = Path(hydra.runtime.output_dir)
    run(experiment, folder)
    log.info("\nresults.json, figures and run.rrd are in %s", folder)


def spelt_out(arguments: list[str]) -> list[str]:
    """``diagnosis=FILE`` as the setting that it stands for: Hydra would look for FILE in the folder conf/diagnosis."""
    short, long = "diagnosis=", "diagnosis_file="
    return [long + given.removeprefix(short) if given.startswith(short) else given for given in arguments]


if __name__ == "__main__":
    sys.argv = spelt_out(sys.argv)
    main()
