"""Fleets of vehicles as TorchRL environments, in MuJoCo and on plain torch physics, each with a task."""

from typing import TYPE_CHECKING

import gymnasium

from auv_torchrl.late import late

if TYPE_CHECKING:
    from auv_torchrl.envs.fleet import FleetEnv
    from auv_torchrl.envs.gymnasium_env import RegulationEnv, RegulationVectorEnv
    from auv_torchrl.envs.make import BACKENDS, make_fleet
    from auv_torchrl.envs.mujoco_fleet import MujocoFleet
    from auv_torchrl.envs.randomize import RandomizeVehicle
    from auv_torchrl.envs.torch_fleet import TorchFleet

ID = "auv_torchrl/Regulation-v0"

__all__ = [
    "BACKENDS",
    "ID",
    "FleetEnv",
    "MujocoFleet",
    "RandomizeVehicle",
    "RegulationEnv",
    "RegulationVectorEnv",
    "TorchFleet",
    "make_fleet",
]

__getattr__ = late(
    __name__,
    {
        "fleet": "FleetEnv",
        "gymnasium_env": "RegulationEnv RegulationVectorEnv",
        "make": "BACKENDS make_fleet",
        "mujoco_fleet": "MujocoFleet",
        "randomize": "RandomizeVehicle",
        "torch_fleet": "TorchFleet",
    },
)

# By names, so that nothing of it is imported before it is made. Gymnasium leaves a part of its type open.
gymnasium.register(  # pyright: ignore[reportUnknownMemberType]
    ID,
    entry_point="auv_torchrl.envs.gymnasium_env:RegulationEnv",
    vector_entry_point="auv_torchrl.envs.gymnasium_env:RegulationVectorEnv",
)
