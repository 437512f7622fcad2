"""Simulators of vehicles: place them, step them, and read what they do and what their sensors report.

The plain one runs the equations of motion on numpy or torch. The one in MuJoCo is
:class:`auv_torchrl.simulator.mujoco.MujocoSimulator`, imported by that name because MuJoCo takes a while to load.
"""

from auv_torchrl.simulator import headless  # isort: skip  # before anything imports MuJoCo
from auv_torchrl.simulator.arrays import Arrays, NumpyArrays, TorchArrays
from auv_torchrl.simulator.base import Report, Simulator
from auv_torchrl.simulator.plain import PlainSimulator
from auv_torchrl.simulator.record import Recorded, record
from auv_torchrl.simulator.simulate import Simulated, at_rest, replay, simulate

__all__ = [
    "Arrays",
    "NumpyArrays",
    "PlainSimulator",
    "Recorded",
    "Report",
    "Simulated",
    "Simulator",
    "TorchArrays",
    "at_rest",
    "headless",
    "record",
    "replay",
    "simulate",
]
