"""What people do today when a thruster misbehaves, to be compared with: each a transform or a weighting of vehicles."""

from auv_torchrl.baselines.allocations import RecursiveLeastSquares, TrueMap
from auv_torchrl.baselines.history import EncoderConfig, HistoryPolicy, train_encoder, train_informed
from auv_torchrl.baselines.l1 import L1Augmentation
from auv_torchrl.baselines.lqr import LQR, AdaptiveLQR
from auv_torchrl.baselines.particles import Particles, weigh_particles
from auv_torchrl.baselines.pulse_test import FixedSigns, pulse_test
from auv_torchrl.baselines.retrain import Retrained, retrain

__all__ = [
    "AdaptiveLQR", "EncoderConfig", "FixedSigns", "HistoryPolicy", "L1Augmentation", "LQR", "Particles",
    "RecursiveLeastSquares", "Retrained", "TrueMap", "pulse_test", "retrain", "train_encoder", "train_informed",
    "weigh_particles",
]  # fmt: skip
