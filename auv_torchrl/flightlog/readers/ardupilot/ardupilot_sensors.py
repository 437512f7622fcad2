"""Sensors of an ArduPilot log: gyro and accelerometer of the unit in use, and the barometer that is outside."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.readers.ardupilot.firmware import latest, of_lane
from auv_torchrl.flightlog.readers.messages import Columns, Messages, stacked, whole_numbers
from auv_torchrl.flightlog.streams.stream import Sampling, Stream, stream

_BAROMETERS = 8  # more than an autopilot has; numbers beyond are one that is none
_SAME_M = 0.25  # m, median by which a barometer differs from the altitude in use; the one inside is metres away
BIASES = {"XKF1": ("GX", "GY", "GZ"), "XKF2": ("AX", "AY", "AZ")}  # that the filter found of gyro and accelerometer
_GROUP_DELAY = np.sqrt(2) / (2 * np.pi)  # periods, of a Butterworth filter of second order below its corner


def depth(messages: Messages, primary: Columns | None) -> tuple[Stream | None, list[Finding]]:
    """Depth below where the barometer was set to zero; of several barometers that which the vehicle dives by.

    That one is known by CTUN.BAlt, which repeats it, or by the depth of the filter, which follows it.
    """
    sensed = messages.get("BARO", "Alt")
    if sensed is None:
        return None, []
    numbers = whole_numbers(sensed["I"]).clip(-1, _BAROMETERS) if "I" in sensed else np.zeros(len(sensed["t"]), int)
    reference = _reference(messages, primary)
    each = np.unique(numbers).tolist()
    if reference is None and len(each) > 1:
        sentence = f"there are {len(each)} barometers and nothing tells which is outside: depth is left out"
        return None, [Finding(Severity.WARNING, "which_barometer", sentence, "Log CTUN or XKF1", ("z",))]
    chosen = each[0]
    if reference is not None:
        off = {number: _difference(sensed, numbers == number, *reference) for number in each}
        chosen = min(each, key=lambda number: off[number])
        if not off[chosen] < _SAME_M:
            sentence = f"no barometer follows the depth in use (nearest by {off[chosen]:.2f} m): depth is left out"
            return None, [Finding(Severity.WARNING, "which_barometer", sentence, "Look at BARO and CTUN", ("z",))]
    mine = numbers == chosen
    t, altitude = sensed["t"][mine], sensed["Alt"][mine].astype(np.float64)
    return stream("depth", "z", "m", t, -altitude, Sampling.MEASURED, f"BARO {int(chosen)}"), []


def _reference(messages: Messages, primary: Columns | None) -> tuple[np.ndarray, np.ndarray, bool] | None:
    """Times and altitude of what the vehicle dives by, and whether only its changes count."""
    control = messages.get("CTUN", "BAlt")
    if control is not None:
        return control["t"], control["BAlt"].astype(np.float64), False
    estimate = messages.get("XKF1", "PD")
    if estimate is None:
        return None
    lane = 0 if primary is None else primary["PI"][0]
    mine = estimate["C"] == lane if "C" in estimate else slice(None)
    return estimate["t"][mine], -estimate["PD"][mine].astype(np.float64), True


def _difference(sensed: Columns, mine: np.ndarray, t: np.ndarray, altitude: np.ndarray, changes: bool) -> float:
    if not len(t) or not mine.any():
        return np.inf
    order = np.argsort(t, kind="stable")
    off = sensed["Alt"][mine].astype(np.float64) - np.interp(sensed["t"][mine], t[order], altitude[order])
    off = off[np.isfinite(off)]
    if not len(off):
        return np.inf
    return float(np.median(np.abs(off - np.median(off) if changes else off)))


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
    if source is not None:
        used = whole_numbers(of_lane(source, primary, lane)["GI"]).clip(0, 255)
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
    rows = messages.get(name, *fields)
    if rows is None or not len((rows := of_lane(rows, primary, lane))["t"]):
        return None
    return stacked(rows, fields)[latest(rows["t"], t)]


def _late(corner: float | None) -> float:
    """How late in s the firmware's low pass of ``corner`` Hz tells of a change; 0 where it is off or not known."""
    return float(_GROUP_DELAY / corner) if corner is not None and corner > 0 else 0.0
