"""Fleets of vehicles as TorchRL environments, in MuJoCo and on plain torch physics, each with a task."""

from auv_torchrl.envs.fleet import FleetEnv
from auv_torchrl.envs.gymnasium_env import RegulationEnv, RegulationVectorEnv
from auv_torchrl.envs.make import BACKENDS, make_fleet
from auv_torchrl.envs.mujoco_fleet import MujocoFleet
from auv_torchrl.envs.randomize import RandomizeVehicle
from auv_torchrl.envs.torch_fleet import TorchFleet

__all__ = [
    "BACKENDS",
    "FleetEnv",
    "MujocoFleet",
    "RandomizeVehicle",
    "RegulationEnv",
    "RegulationVectorEnv",
    "TorchFleet",
    "make_fleet",
]
