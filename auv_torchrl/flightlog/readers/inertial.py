"""Gyro and accelerometer of an ArduPilot log: of the unit in use, less what the filter found it to be off by."""

from collections.abc import Mapping

import numpy as np

from auv_torchrl.flightlog.readers.lanes import latest, of_lane, rows
from auv_torchrl.flightlog.readers.messages import Columns, Messages
from auv_torchrl.flightlog.streams.stream import Sampling, Stream, stream

BIASES = {"XKF1": ("GX", "GY", "GZ"), "XKF2": ("AX", "AY", "AZ")}  # that the filter found of gyro and accelerometer
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
    if "I" in imu:
        imu = rows(imu, imu["I"] == unit)
    turning = np.stack([imu[f"Gyr{axis}"].astype(np.float64) for axis in "XYZ"], -1)
    late = {name: _late(parameters.get(f"INS_{name}_FILTER")) for name in ("GYRO", "ACCEL")}
    pushing = np.stack([imu[f"Acc{axis}"].astype(np.float64) for axis in "XYZ"], -1)
    drift, off = (_bias(messages, name, primary, lane, imu["t"]) for name in BIASES)
    what = [f"IMU {unit}" + ("" if bias is None else f" less the bias of {name}")
            for name, bias in zip(BIASES, (drift, off), strict=True)]  # fmt: skip
    turning = turning if drift is None else turning - np.deg2rad(drift)
    pushing = pushing if off is None else pushing - off
    gyro = stream("gyro", "pqr", "rad/s", imu["t"] - late["GYRO"], turning, Sampling.MEASURED, what[0])
    return gyro, stream(
        "accelerometer", ("ax", "ay", "az"), "m/s^2", imu["t"] - late["ACCEL"], pushing, Sampling.MEASURED, what[1],
    )  # fmt: skip


def _bias(messages: Messages, name: str, primary: Columns | None, lane: int, t: np.ndarray) -> np.ndarray | None:
    """What the lane in use found its unit to be off by at times ``t``: degree/s in XKF1, m/s^2 in XKF2; (T, 3)."""
    fields = BIASES[name]
    told = messages.get(name, *fields)
    if told is None or not len((told := of_lane(told, primary, lane))["t"]):
        return None
    return np.stack([told[field].astype(np.float64) for field in fields], -1)[latest(told["t"], t)]


def _late(corner: float | None) -> float:
    """How late in s the firmware's low pass of ``corner`` Hz tells of a change; 0 where it is off or not known."""
    return float(_GROUP_DELAY / corner) if corner is not None and corner > 0 else 0.0
