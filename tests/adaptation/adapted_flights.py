"""Flights in which a scenario begins, for the tests of the adaptation."""

from dataclasses import replace

import torch
import yaml
from torchrl.envs import TransformedEnv

from auv_torchrl.adaptation import InFlightAdapter, load_adaptation_config
from auv_torchrl.agents.pid import PID
from auv_torchrl.ddr.transform import observing
from auv_torchrl.envs import TorchFleet
from auv_torchrl.evaluation import draw_starts, fly
from auv_torchrl.flight import Flight
from auv_torchrl.paths import config_path
from auv_torchrl.scenario import read_scenario
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle

VEHICLE = load_vehicle("paper")
INTEGRAL = (0.5, 0.5, 0.5, 0.2)  # 1/(m s), so that the source controller settles inside the dead band


def task(seconds):
    return replace(StationKeeping().for_evaluation(1.0), episode_s=seconds, thruster_commands=True)


def scenario(name, start_s=0.0):
    config = yaml.safe_load(config_path("scenario", name).read_text())
    for settings in config["effects"].values():
        settings["start_s"] = start_s
    return read_scenario(name, config, VEHICLE)


def adapted_fleet(count, seconds, acting=None, **overrides):
    adapter = InFlightAdapter(VEHICLE, task(seconds), load_adaptation_config(overrides=overrides), count)
    fleet = TorchFleet(VEHICLE, task(seconds), count, scenario=acting, seed=0, dtype=torch.float64)
    return TransformedEnv(fleet, observing(adapter, task(seconds))), adapter


def adapted_flight(acting=None, count=6, seconds=15.0, policy=None, **overrides) -> tuple[Flight, InFlightAdapter]:
    env, adapter = adapted_fleet(count, seconds, acting, **overrides)
    flown = task(seconds)
    policy = policy or PID(flown, integral=INTEGRAL, state="expected")
    return fly(env, policy, draw_starts(flown, count, seed=1), flown.steps - 1), adapter
