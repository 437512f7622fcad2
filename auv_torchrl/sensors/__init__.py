"""Sensors: what is reported of a motion, and which motion a report stands for."""

from auv_torchrl.sensors.instruments import SENSORS, ages, read, sensor_of
from auv_torchrl.sensors.inverse import Inverse
from auv_torchrl.sensors.report import measured_pose, measured_velocity, motion_of
from auv_torchrl.sensors.sensor import MOTION, Sensor, at_once

__all__ = [
    "MOTION", "SENSORS", "Inverse", "Sensor", "ages", "at_once", "measured_pose", "measured_velocity", "motion_of",
    "read", "sensor_of",
]  # fmt: skip
