"""The one format between the world and the diagnosis: reading, checking and writing flight logs."""

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
