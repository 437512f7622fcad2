"""What people do today when a thruster misbehaves, to be compared with: each a transform or a weighting of vehicles."""

from auv_torchrl.baselines.allocations import RecursiveLeastSquares, TrueMap
from auv_torchrl.baselines.particles import Particles, weigh_particles
from auv_torchrl.baselines.pulse_test import FixedSigns, pulse_test

__all__ = ["FixedSigns", "Particles", "RecursiveLeastSquares", "TrueMap", "pulse_test", "weigh_particles"]
