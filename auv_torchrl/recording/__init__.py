"""Recordings for the rerun viewer."""

from typing import TYPE_CHECKING

from auv_torchrl.late import late

if TYPE_CHECKING:
    from auv_torchrl.recording.flight import OneFlight
    from auv_torchrl.recording.run import ControlMap, record_run

__all__ = ["ControlMap", "OneFlight", "record_run"]

__getattr__ = late(__name__, {"flight": "OneFlight", "run": "ControlMap record_run"})
