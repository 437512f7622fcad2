"""Gyro and accelerometer of an ArduPilot log: of the unit in use, less what the filter found it to be off by."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from auv_torchrl.flightlog.readers.lanes import latest, of_lane
from auv_torchrl.flightlog.readers.messages import Columns, Messages, stacked
from auv_torchrl.flightlog.streams.stream import Sampling, Stream, stream

BIASES = {"XKF1": ("GX", "GY", "GZ"), "XKF2": ("AX", "AY", "AZ")}  # that the filter found of gyro and accelerometer


class _Sensor(NamedTuple):
    name: str
    channels: tuple[str, ...]
    unit: str
    field: str  # of IMU, but for its axis
    estimate: str  # message in which the filter tells its bias
    per: float  # units of the stream in one of that
    filter: str  # parameter with the corner of the low pass before the log


_SENSORS = (
    _Sensor("gyro", ("p", "q", "r"), "rad/s", "Gyr", "XKF1", np.pi / 180, "INS_GYRO_FILTER"),
    _Sensor("accelerometer", ("ax", "ay", "az"), "m/s^2", "Acc", "XKF2", 1.0, "INS_ACCEL_FILTER"),
)
_GROUP_DELAY = np.sqrt(2) / (2 * np.pi)  # periods, of a Butterworth filter of second order below its corner


def inertial(
    messages: Messages, primary: Columns | None, lane: int, parameters: Mapping[str, float]
) -> tuple[Stream | None, Stream | None]:
    """Gyro and accelerometer, less the bias that the filter found, of the unit that the lane in use listens to.

    Both are logged behind a low pass, and told for the moment at which they were felt.
    """
    imu = messages.get("IMU", "GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ")
    if imu is None:
        return None, None
    unit, source = lane, messages.get("XKFS", "GI")
    if source is not None and len(source["t"]):
        used = of_lane(source, primary, lane)["GI"].astype(np.int64).clip(0, 255)
        unit = int(np.bincount(used).argmax()) if len(used) else lane
    kept = np.flatnonzero(imu["I"] == unit) if "I" in imu else slice(None)
    gyro, accelerometer = (  # one after the other: of a large log their copies are most of the memory
        _read(sensor, imu, kept, _bias(messages, sensor.estimate, primary, lane, imu["t"][kept]), unit, parameters)
        for sensor in _SENSORS
    )
    return gyro, accelerometer


def _read(
    sensor: _Sensor, imu: Columns, kept: Any, bias: np.ndarray | None, unit: int, parameters: Mapping[str, float]
) -> Stream | None:
    values = np.stack([imu[f"{sensor.field}{axis}"][kept].astype(np.float64) for axis in "XYZ"], -1)
    if bias is not None:
        values -= sensor.per * bias
    source = f"IMU {unit}" + ("" if bias is None else f" less the bias of {sensor.estimate}")
    t = imu["t"][kept] - _late(parameters.get(sensor.filter))
    return stream(sensor.name, sensor.channels, sensor.unit, t, values, Sampling.MEASURED, source)


def _bias(messages: Messages, name: str, primary: Columns | None, lane: int, t: np.ndarray) -> np.ndarray | None:
    """What the lane in use found its unit to be off by at times ``t``: degree/s in XKF1, m/s^2 in XKF2; (T, 3)."""
    fields = BIASES[name]
    told = messages.get(name, *fields)
    if told is None or not len((told := of_lane(told, primary, lane))["t"]):
        return None
    return stacked(told, fields)[latest(told["t"], t)]


def _late(corner: float | None) -> float:
    """How late in s the firmware's low pass of ``corner`` Hz tells of a change; 0 where it is off or not known."""
    return float(_GROUP_DELAY / corner) if corner is not None and corner > 0 else 0.0
