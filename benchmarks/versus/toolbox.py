"""MuJoCo and its mujoco.sysid, most of whose names a type checker cannot see."""

from importlib import import_module
from typing import Any

mujoco: Any = import_module("mujoco")
rollout: Any = import_module("mujoco.rollout")
sysid: Any = import_module("mujoco.sysid")
