"""Streams of a log, each with its own times, and the table that the diagnosis makes of them."""

from auv_torchrl.flightlog.streams.grid import tabulate
from auv_torchrl.flightlog.streams.stream import ReadOptions, Sampling, Stream, Streams, VehicleFacts

__all__ = ["ReadOptions", "Sampling", "Stream", "Streams", "VehicleFacts", "tabulate"]
