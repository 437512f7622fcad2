"""Diagnosis of the gap between a flown vehicle and its simulator: where, which, how far."""

from typing import TYPE_CHECKING

from auv_torchrl.late import late

if TYPE_CHECKING:
    from auv_torchrl.diagnosis.pipeline import diagnose
    from auv_torchrl.diagnosis.verdict import Diagnosis, Verdict

__all__ = ["Diagnosis", "Verdict", "diagnose"]

__getattr__ = late(
    __name__,
    {
        "pipeline": "diagnose",
        "verdict": "Diagnosis Verdict",
    },
)
