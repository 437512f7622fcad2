"""PX4's log, ``.ulg``, read by pyulog: https://docs.px4.io/main/en/dev_log/ulog_file_format.html."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.readers.reader import library
from auv_torchrl.flightlog.streams.attitude import euler_angles
from auv_torchrl.flightlog.streams.stream import (
    ReadOptions,
    Sampling,
    Stream,
    Streams,
    VehicleFacts,
    by_name,
    state_of,
    stream,
)

MAGIC = b"ULog"
TOPICS = (
    "actuator_motors", "vehicle_attitude", "vehicle_angular_velocity", "vehicle_acceleration", "sensor_combined",
    "vehicle_local_position", "battery_status", "vehicle_status",
)  # fmt: skip
_ARMED = 2  # vehicle_status.arming_state
_MODES = {  # vehicle_status.nav_state
    0: "MANUAL", 1: "ALTCTL", 2: "POSCTL", 3: "AUTO_MISSION", 4: "AUTO_LOITER", 5: "AUTO_RTL", 10: "ACRO",
    12: "DESCEND", 13: "TERMINATION", 14: "OFFBOARD", 15: "STAB", 17: "AUTO_TAKEOFF", 18: "AUTO_LAND",
}  # fmt: skip
_MOTORS = 12  # that actuator_motors has room for

Topic = Mapping[str, np.ndarray]


@np.errstate(invalid="ignore", over="ignore")  # of numbers in a damaged file
def read(path: Path, options: ReadOptions) -> Streams:
    """The streams of a PX4 log.

    Raises:
        FlightLogError: if pyulog is missing or cannot read the file.
    """
    pyulog = library("pyulog", f"a PX4 log ({path.name})")
    try:
        found = pyulog.ULog(str(path), list(TOPICS), disable_str_exceptions=True)
    except Exception as error:  # it does not say which, for a file that is cut or damaged
        cause = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise FlightLogError(
            f"{path.name} cannot be read as a PX4 log ({cause}): copy it from the vehicle again"
        ) from error
    topics: dict[str, Topic] = {}
    for entry in found.data_list:
        data = {name: values for name, values in entry.data.items() if values.dtype.kind in "fiub"}
        if "timestamp" in data and entry.name not in topics:  # the first of several instances
            topics[entry.name] = {**data, "t": (data["timestamp"].astype(np.float64) - found.start_timestamp) * 1e-6}
    facts = _vehicle(found)
    end = max((float(topic["t"].max()) for topic in topics.values() if len(topic["t"])), default=0.0)
    armed, modes = _status(topics.get("vehicle_status"), end)
    streams = (
        _commands(topics), _attitude(topics),
        _felt(topics, "gyro", "pqr", "rad/s", ("vehicle_angular_velocity", "xyz"), ("sensor_combined", "gyro_rad")),
        _felt(topics, "accelerometer", ("ax", "ay", "az"), "m/s^2",
              ("vehicle_acceleration", "xyz"), ("sensor_combined", "accelerometer_m_s2")),
        *_local(topics), _battery(topics),
    )  # fmt: skip
    return Streams(path.name, "PX4 ULog", by_name(streams), facts, armed, modes)


def _vehicle(found) -> VehicleFacts:
    given = found.initial_parameters.items()  # of a damaged file also bytes, and numbers that are none
    parameters = {str(k): float(v) for k, v in given if isinstance(v, int | float) and np.isfinite(v)}
    name = str(found.msg_info_dict.get("sys_name", "PX4"))
    release = found.msg_info_dict.get("ver_sw_release")
    version = "" if not isinstance(release, int) else ".".join(str(release >> s & 255) for s in (24, 16, 8))
    start = parameters.get("SYS_AUTOSTART")
    motors = parameters.get("CA_ROTOR_COUNT")
    frame = f"SYS_AUTOSTART {start:g}" if start else ""
    return VehicleFacts(f"{name} {version}".strip(), frame, int(motors) if motors else None, parameters)


def _some(topics: Mapping[str, Topic], name: str, *fields: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Times and values (T, fields) of a topic that has all of them."""
    topic = topics.get(name)
    if topic is None or not all(field in topic for field in fields):
        return None
    return topic["t"], np.stack([topic[field].astype(np.float64) for field in fields], axis=-1)


def _commands(topics: Mapping[str, Topic]) -> Stream | None:
    told = _some(topics, "actuator_motors", *(f"control[{n}]" for n in range(_MOTORS)))
    if told is None:
        return None
    t, values = told
    used = np.isfinite(values).any(axis=0)
    number = int(np.flatnonzero(used)[-1]) + 1 if used.any() else 0
    names = (f"cmd_{n + 1}" for n in range(number))
    return stream("commands", names, "1", t, values[:, :number], Sampling.SNAPSHOT, "actuator_motors")


def _attitude(topics: Mapping[str, Topic]) -> Stream | None:
    told = _some(topics, "vehicle_attitude", *(f"q[{i}]" for i in range(4)))
    if told is None:
        return None
    angles = euler_angles(told[1])
    return stream("attitude", ("roll", "pitch", "yaw"), "rad", told[0], angles, Sampling.ESTIMATED, "vehicle_attitude")


def _felt(
    topics: Mapping[str, Topic], name: str, channels: Iterable[str], unit: str, *sources: tuple[str, str]
) -> Stream | None:
    """Rates or specific force of the first of the topics that has its field: less their biases, or as sensed."""
    for topic, field in sources:
        told = _some(topics, topic, *(f"{field}[{i}]" for i in range(3)))
        if told is not None:
            return stream(name, channels, unit, *told, Sampling.MEASURED, topic)
    return None


def _local(topics: Mapping[str, Topic]) -> tuple[Stream | None, Stream | None]:
    """Position and velocity in NED, where the filter says that they are valid."""
    what = "vehicle_local_position"
    place, speed = _some(topics, what, "x", "y", "z"), _some(topics, what, "vx", "vy", "vz")
    valid = _some(topics, what, "xy_valid", "z_valid", "v_xy_valid", "v_z_valid")
    if place is None or speed is None or valid is None:
        return None, None
    knows = valid[1][:, [0, 0, 1, 2, 2, 3]] > 0
    position = np.where(knows[:, :3], place[1], np.nan)
    velocity = np.where(knows[:, 3:], speed[1], np.nan)
    axes = ("north", "east", "down")
    return (
        stream("position", "xyz", "m", place[0], position, Sampling.ESTIMATED, what),
        stream("velocity", axes, "m/s", speed[0], velocity, Sampling.ESTIMATED, what),
    )


def _battery(topics: Mapping[str, Topic]) -> Stream | None:
    told = _some(topics, "battery_status", "voltage_v", "current_a")
    if told is None:
        return None
    return stream("battery", ("voltage", "current"), ("V", "A"), *told, Sampling.MEASURED, "battery_status")


def _status(topic: Topic | None, end: float):
    if topic is None or "arming_state" not in topic or "nav_state" not in topic:
        return None, ()
    on = (int(state) == _ARMED for state in topic["arming_state"])
    names = (_MODES.get(number, f"MODE_{number}") for number in topic["nav_state"].tolist())
    return state_of(zip(topic["t"].tolist(), on, names, strict=True), end)
