"""Data-informed domain randomization: maps between the commands of the source and the target vehicle."""

from typing import TYPE_CHECKING

from auv_torchrl.late import late

if TYPE_CHECKING:
    from auv_torchrl.ddr.adapter import DDRAdapter
    from auv_torchrl.ddr.collect import Adaptation, adapt
    from auv_torchrl.ddr.config import AdapterConfig
    from auv_torchrl.ddr.models import SourceModels
    from auv_torchrl.ddr.pretraining import PretrainingConfig, pretrain

__all__ = ["Adaptation", "AdapterConfig", "DDRAdapter", "PretrainingConfig", "SourceModels", "adapt", "pretrain"]

__getattr__ = late(
    __name__,
    {
        "adapter": "DDRAdapter",
        "collect": "Adaptation adapt",
        "config": "AdapterConfig",
        "models": "SourceModels",
        "pretraining": "PretrainingConfig pretrain",
    },
)
