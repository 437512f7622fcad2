"""Sweeps on local cores and on a cluster, as far as their config goes."""

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from auv_torchrl.experiment import schema
from auv_torchrl.paths import CONF
from auv_torchrl.scenario import scenarios_of
from auv_torchrl.vehicle import load_vehicle


def launcher(*overrides: str):
    schema.register()
    with initialize_config_dir(version_base="1.3", config_dir=str(CONF)):
        return compose("train", list(overrides), return_hydra_config=True).hydra


def test_the_sweep_covers_every_scenario_and_three_seeds_on_the_local_cores():
    """Those whose effects act on parts that the vehicle has, by the joblib launcher."""
    hydra = launcher("+experiment=sweep")
    assert hydra.sweeper.params["+scenario"].split(",") == scenarios_of(load_vehicle("paper"))
    assert hydra.sweeper.params["seed"] == "0,1,2"
    torpedo = launcher("+experiment=sweep", "vehicle=remus100").sweeper.params["+scenario"].split(",")
    assert "fin_stuck" in torpedo and len(torpedo) > 20
    assert hydra.launcher._target_.endswith("JoblibLauncher")


def test_the_cluster_launcher_replaces_the_local_one():
    """One override, no other change."""
    hydra = launcher("+experiment=sweep", "hydra/launcher=submitit_slurm")
    assert hydra.launcher._target_.endswith("SlurmLauncher")
    assert hydra.launcher.timeout_min > 0 and hydra.sweeper.params["seed"] == "0,1,2"


def test_the_cluster_launcher_has_only_settings_that_its_plugin_knows():
    """Checked against the plugin's own schema where it is installed."""
    plugin = pytest.importorskip("hydra_plugins.hydra_submitit_launcher.config", reason="pip install '.[slurm]'")
    settings = OmegaConf.load(CONF / "hydra" / "launcher" / "submitit_slurm.yaml")
    merged = OmegaConf.merge(OmegaConf.structured(plugin.SlurmQueueConf), settings)
    assert merged.timeout_min == settings.timeout_min
