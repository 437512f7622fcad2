"""Sensors: what is reported of a motion, and which motion a report stands for."""

from auv_torchrl.sensors.asked import report_otherwise, report_the_same
from auv_torchrl.sensors.instruments import SENSORS, ages, read, sensor_of
from auv_torchrl.sensors.inverse import Inverse
from auv_torchrl.sensors.report import (
    felt_along,
    felt_at_rows,
    is_felt,
    measured_pose,
    measured_velocity,
    motion_of,
    moving,
)
from auv_torchrl.sensors.sensor import CHANNELS, FELT, MOTION, Sensor, at_once

__all__ = [
    "CHANNELS", "FELT", "MOTION", "SENSORS", "Inverse", "Sensor", "ages", "at_once", "felt_along",
    "felt_at_rows", "is_felt", "measured_pose", "measured_velocity", "motion_of", "moving", "read",
    "report_otherwise", "report_the_same", "sensor_of",
]  # fmt: skip
