"""What people do today when a thruster misbehaves, to be compared with: each a transform or a weighting of vehicles."""

from auv_torchrl.baselines.oracle import TrueMap
from auv_torchrl.baselines.particles import Particles, weigh_particles
from auv_torchrl.baselines.pulse_test import FixedSigns, pulse_test
from auv_torchrl.baselines.recursive_least_squares import RecursiveLeastSquares

__all__ = ["FixedSigns", "Particles", "RecursiveLeastSquares", "TrueMap", "pulse_test", "weigh_particles"]
