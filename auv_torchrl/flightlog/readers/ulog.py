"""What the topics of a PX4 log mean: the streams, the vehicle, arming and modes."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from auv_torchrl.flightlog.findings import Finding, FlightLogError
from auv_torchrl.flightlog.readers.bounds import Loss
from auv_torchrl.flightlog.readers.messages import changes
from auv_torchrl.flightlog.readers.ulog_records import Content, Topic, read_content
from auv_torchrl.flightlog.streams.attitude import euler_angles
from auv_torchrl.flightlog.streams.parameters import read_parameters
from auv_torchrl.flightlog.streams.stream import (
    Kind,
    Modes,
    ReadOptions,
    Sampling,
    Spans,
    Stream,
    Streams,
    VehicleFacts,
    by_name,
    state_of,
    stream,
)
from auv_torchrl.flightlog.streams.vehicle_kind import kind_of_type

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
_TYPES: dict[float, str] = {
    1: "a multirotor",
    2: "a fixed-wing aircraft",
    3: "a rover",
    4: "an airship",
}  # vehicle_type
_AIRFRAMES = (  # SYS_AUTOSTART from which on: https://docs.px4.io/main/en/airframes/airframe_reference.html
    (2000, "a fixed-wing aircraft", False), (3000, "a flying wing", False), (4000, "a quadrotor", False),
    (5000, "a quadrotor", False), (6000, "a hexarotor", False), (7000, "a hexarotor", False),
    (8000, "an octorotor", False), (13000, "a VTOL aircraft", False), (50000, "a rover", False),
    (60000, "an underwater vehicle", True),
)  # fmt: skip


@np.errstate(invalid="ignore", over="ignore")  # of numbers in a damaged file
def read(path: Path, options: ReadOptions) -> Streams:
    """The streams of a PX4 log.

    Raises:
        FlightLogError: if nothing of the file can be read.
    """
    loss = Loss()
    found = read_content(path, TOPICS, loss)
    topics = {}
    for name, data in found.topics.items():
        if "timestamp" in data and len(data["timestamp"]):
            since = data["timestamp"].astype(np.float64) - found.start_us
            topics[name] = {**data, "t": since * 1e-6}
    if not topics and not found.parameters:
        raise FlightLogError(
            f"{path.name} cannot be read as a PX4 log (left out: {loss.sentence or 'nothing, there is nothing'}): copy "
            "it from the vehicle again"
        )
    facts, odd = _vehicle(path.name, found, topics.get("vehicle_status"))
    end = max((float(topic["t"].max()) for topic in topics.values()), default=0.0)
    armed, modes = _status(topics.get("vehicle_status"), end)
    streams = (
        _commands(topics), _attitude(topics),
        _felt(topics, "gyro", "pqr", "rad/s", ("vehicle_angular_velocity", "xyz"), ("sensor_combined", "gyro_rad")),
        _felt(topics, "accelerometer", ("ax", "ay", "az"), "m/s^2",
              ("vehicle_acceleration", "xyz"), ("sensor_combined", "accelerometer_m_s2")),
        *_local(topics), _battery(topics),
    )  # fmt: skip
    return Streams(path.name, "PX4 ULog", by_name(streams), facts, armed, modes, findings=(*loss.findings(), *odd))


def _vehicle(name: str, found: Content, status: Topic | None) -> tuple[VehicleFacts, tuple[Finding, ...]]:
    parameters, odd = read_parameters(name, found.parameters.items())
    system, release = found.infos.get("sys_name", "PX4"), found.infos.get("ver_sw_release")
    version = "" if not isinstance(release, int) else ".".join(str(release >> s & 255) for s in (24, 16, 8))
    start, motors = parameters.get("SYS_AUTOSTART"), parameters.get("CA_ROTOR_COUNT", 0.0)
    frame = f"SYS_AUTOSTART {start:g}" if start else ""
    number = int(motors) if 0 < motors <= _MOTORS else None
    return VehicleFacts(f"{system} {version}".strip(), frame, number, parameters, _kinds(parameters, status)), odd


def _kinds(parameters: Mapping[str, float], status: Topic | None) -> tuple[Kind, ...]:
    """The kinds of vehicle that its status and its parameters name."""
    found = [kind_of_type(parameters.get("MAV_TYPE", 0.0), "MAV_TYPE")]
    if status is not None and "system_type" in status:
        found.append(kind_of_type(_most(status["system_type"]), "vehicle_status.system_type"))
    if status is not None and (named := _TYPES.get(_most(status["vehicle_type"]) if "vehicle_type" in status else 0)):
        found.append(Kind("vehicle_status.vehicle_type", named, False))
    start = parameters.get("SYS_AUTOSTART", 0.0)
    for low, named, underwater in _AIRFRAMES:
        if low <= start < low + 1000:
            found.append(Kind(f"airframe {start:g}", named, underwater))
    return tuple(kind for kind in found if kind is not None)


def _most(values: np.ndarray) -> float:
    """The most frequent value (T,)."""
    numbers, counts = np.unique(values, return_counts=True)
    return float(numbers[counts.argmax()])


def _some(topics: Mapping[str, Topic], name: str, *fields: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Times and values (T, fields) of a topic that has all of them."""
    topic = topics.get(name)
    if topic is None or not all(field in topic for field in fields):
        return None
    return topic["t"], np.stack([topic[field].astype(np.float64) for field in fields], axis=-1)


def _commands(topics: Mapping[str, Topic]) -> Stream | None:
    rows = _some(topics, "actuator_motors", *(f"control[{n}]" for n in range(_MOTORS)))
    if rows is None:
        return None
    t, values = rows
    used = np.isfinite(values).any(axis=0)
    number = int(np.flatnonzero(used)[-1]) + 1 if used.any() else 0
    names = (f"cmd_{n + 1}" for n in range(number))
    return stream("commands", names, "1", t, values[:, :number], Sampling.SNAPSHOT, "actuator_motors")


def _attitude(topics: Mapping[str, Topic]) -> Stream | None:
    rows = _some(topics, "vehicle_attitude", *(f"q[{i}]" for i in range(4)))
    if rows is None:
        return None
    angles = euler_angles(rows[1])
    return stream("attitude", ("roll", "pitch", "yaw"), "rad", rows[0], angles, Sampling.ESTIMATED, "vehicle_attitude")


def _felt(
    topics: Mapping[str, Topic], name: str, channels: Iterable[str], unit: str, *sources: tuple[str, str]
) -> Stream | None:
    """Rates or specific force of the first of the topics that has its field: less their biases, or as sensed."""
    for topic, field in sources:
        rows = _some(topics, topic, *(f"{field}[{i}]" for i in range(3)))
        if rows is not None:
            return stream(name, channels, unit, *rows, Sampling.MEASURED, topic)
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
    rows = _some(topics, "battery_status", "voltage_v", "current_a")
    if rows is None:
        return None
    return stream("battery", ("voltage", "current"), ("V", "A"), *rows, Sampling.MEASURED, "battery_status")


def _status(topic: Topic | None, end: float) -> tuple[Spans | None, Modes]:
    if topic is None or "arming_state" not in topic or "nav_state" not in topic:
        return None, ()
    on = topic["arming_state"] == _ARMED
    at = changes(on, topic["nav_state"])
    names = (_MODES.get(number, f"MODE_{number}") for number in topic["nav_state"][at].tolist())
    return state_of(zip(topic["t"][at].tolist(), on[at].tolist(), names, strict=True), end)
