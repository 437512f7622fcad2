"""Adaptation in one flight: notice that the vehicle has changed, learn what its thrusters do now, and go on."""

from auv_torchrl.online.adapter import OnlineAdapter
from auv_torchrl.online.config import OnlineConfig, load_online_config
from auv_torchrl.online.learner import PHASES, Phase

__all__ = ["PHASES", "OnlineAdapter", "OnlineConfig", "Phase", "load_online_config"]
