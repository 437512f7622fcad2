"""Recordings for the rerun viewer."""

from auv_torchrl.recording.flight import OneFlight
from auv_torchrl.recording.run import ControlMap, record_run

__all__ = ["ControlMap", "OneFlight", "record_run"]
