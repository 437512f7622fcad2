"""Streams of a log, each with its own times, and the table that the diagnosis makes of them."""

from typing import TYPE_CHECKING

from auv_torchrl.flightlog.streams.stream import ReadOptions, Sampling, Stream, Streams, VehicleFacts
from auv_torchrl.late import late

if TYPE_CHECKING:
    from auv_torchrl.flightlog.streams.grid import tabulate

__all__ = ["ReadOptions", "Sampling", "Stream", "Streams", "VehicleFacts", "tabulate"]

__getattr__ = late(__name__, {"grid": "tabulate"})
