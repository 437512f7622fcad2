"""The one format between the world and the diagnosis: reading, checking and writing flight logs."""

from typing import TYPE_CHECKING

from auv_torchrl.late import late

if TYPE_CHECKING:
    from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
    from auv_torchrl.flightlog.log import POSE, VELOCITY, Episode, FlightLog, join
    from auv_torchrl.flightlog.reader import read_flightlog
    from auv_torchrl.flightlog.writer import raw_columns, write_columns, write_flightlog

__all__ = [
    "POSE",
    "VELOCITY",
    "Episode",
    "Finding",
    "FlightLog",
    "FlightLogError",
    "Severity",
    "join",
    "raw_columns",
    "read_flightlog",
    "write_columns",
    "write_flightlog",
]

__getattr__ = late(
    __name__,
    {
        "findings": "Finding FlightLogError Severity",
        "log": "POSE VELOCITY Episode FlightLog join",
        "reader": "read_flightlog",
        "writer": "raw_columns write_columns write_flightlog",
    },
)
