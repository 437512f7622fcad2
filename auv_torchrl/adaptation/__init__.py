"""Adaptation in one flight: notice that the vehicle has changed, learn what its thrusters do now, and go on."""

from typing import TYPE_CHECKING

from auv_torchrl.late import late

if TYPE_CHECKING:
    from auv_torchrl.adaptation.adapter import InFlightAdapter
    from auv_torchrl.adaptation.config import AdaptationConfig, load_adaptation_config
    from auv_torchrl.adaptation.learner import PHASES, Phase

__all__ = ["PHASES", "InFlightAdapter", "AdaptationConfig", "Phase", "load_adaptation_config"]

__getattr__ = late(
    __name__,
    {
        "adapter": "InFlightAdapter",
        "config": "AdaptationConfig load_adaptation_config",
        "learner": "PHASES Phase",
    },
)
