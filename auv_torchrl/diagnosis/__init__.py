"""Diagnosis of the gap between a flown vehicle and its simulator: where, which, how far."""

from auv_torchrl.diagnosis.diagnose import diagnose
from auv_torchrl.diagnosis.verdict import Diagnosis, Verdict

__all__ = ["Diagnosis", "Verdict", "diagnose"]
