"""ROS 1 bags, and ROS 2 bags as sqlite3 or MCAP, read by rosbags: topics are known by the type of their messages.

ROS has its vectors in ENU and FLU (REP 103); a frame that is called ned or frd is taken at its word.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.readers.reader import library
from auv_torchrl.flightlog.streams.attitude import euler_angles, frd_of_flu, ned_of_enu, ned_of_enu_vector
from auv_torchrl.flightlog.streams.stream import ReadOptions, Sampling, Stream, Streams, VehicleFacts, state_of, stream

_SAME_CLOCK_S = 5.0  # between a message's stamp and the time of the bag; more is a simulated clock, or none
_SQLITE, _BAG = b"SQLite format 3\0", b"#ROSBAG V2"

Sample = dict[str, list[float]]


class Topic(NamedTuple):
    """The samples of one topic."""

    name: str
    kind: str  # type of its messages
    frame: str  # in which its first message is; empty where messages bear none
    received: np.ndarray  # (T,) s
    stamp: np.ndarray  # (T,) s; NaN where messages bear none
    samples: list[Sample]


def recognizes(head: bytes) -> bool:
    """Whether a file begins as a bag of ROS 1, or of ROS 2 in sqlite3."""
    return head.startswith((_SQLITE, _BAG))


def is_bag(folder: Path) -> bool:
    """Whether a folder is a bag of ROS 2."""
    return (folder / "metadata.yaml").is_file()


def read(path: Path, options: ReadOptions) -> Streams:
    """The streams of a bag.

    Raises:
        FlightLogError: if rosbags is missing or cannot read it, or no topic is of a type that is known.
    """
    anyreader = library("rosbags.highlevel", f"a ROS bag ({path.name})")
    typesys = library("rosbags.typesys", f"a ROS bag ({path.name})")
    try:
        latest = typesys.get_typestore(typesys.Stores.LATEST)
        with anyreader.AnyReader([path], default_typestore=latest) as reader:
            topics, there = _topics(reader)
    except Exception as error:  # sqlite3, lz4, yaml and struct errors alike come from files that are cut or damaged
        cause = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        remedy = "copy it again, or mend it with rosbag reindex"
        raise FlightLogError(f"{path.name} cannot be read as a ROS bag ({cause}): {remedy}") from error
    if not topics:
        raise FlightLogError(
            f"{path.name} has no topic that is known (it has {', '.join(there[:8]) or 'none'}): record "
            f"{', '.join(sorted(_SAMPLES))}"
        )
    return _streams(path.name, topics)


def _topics(reader: Any) -> tuple[list[Topic], list[str]]:
    known = [c for c in reader.connections if _short(c.msgtype) in _SAMPLES]
    rows: dict[str, tuple[str, str, list[tuple[float, float, Sample]]]] = {}
    for connection, time_ns, raw in reader.messages(connections=known) if known else ():
        message = reader.deserialize(raw, connection.msgtype)
        kind = _short(connection.msgtype)
        frame = getattr(getattr(message, "header", None), "frame_id", "")
        told = (time_ns * 1e-9, _stamp(message), _SAMPLES[kind](message))
        rows.setdefault(connection.topic, (kind, frame, []))[2].append(told)
    topics = []
    for name, (kind, frame, samples) in rows.items():
        received, stamp, values = zip(*samples, strict=True)
        topics.append(Topic(name, kind, frame, np.array(received), np.array(stamp), list(values)))
    return topics, sorted({f"{c.topic} ({c.msgtype})" for c in reader.connections})


def _short(kind: str) -> str:
    return kind.replace("/msg/", "/")


def _stamp(message: Any) -> float:
    header = getattr(message, "header", None)
    if header is None:
        return np.nan
    seconds = header.stamp.sec + header.stamp.nanosec * 1e-9
    return seconds if seconds > 0 else np.nan


def _xyz(vector: Any) -> np.ndarray:
    return np.array([vector.x, vector.y, vector.z])


def _is_ned(frame: str) -> bool:
    return "ned" in frame.lower().split("_") or "frd" in frame.lower() or frame.lower().endswith("ned")


def _angles(q: Any, ned: bool) -> list[float]:
    quaternion = np.array([q.w, q.x, q.y, q.z])
    return euler_angles(quaternion if ned else ned_of_enu(quaternion)).tolist()


def _in_body(vector: Any, frd: bool) -> list[float]:
    return (_xyz(vector) if frd else frd_of_flu(_xyz(vector))).tolist()


def _pose(pose: Any, ned: bool) -> Sample:
    place = _xyz(pose.position)
    place = place if ned else ned_of_enu_vector(place)
    return {"position": place.tolist(), "attitude": _angles(pose.orientation, ned)}


def _twist(twist: Any, frd: bool) -> Sample:
    return {"body_velocity": _in_body(twist.linear, frd), "gyro": _in_body(twist.angular, frd)}


def _imu(m: Any) -> Sample:
    frd = _is_ned(m.header.frame_id)
    found = {"gyro": _in_body(m.angular_velocity, frd), "accelerometer": _in_body(m.linear_acceleration, frd)}
    if m.orientation_covariance[0] >= 0:  # -1: there is none
        found["attitude"] = _angles(m.orientation, frd)
    return found


def _odometry(m: Any) -> Sample:
    return {
        **_pose(m.pose.pose, _is_ned(m.header.frame_id)),
        **_twist(m.twist.twist, _is_ned(m.child_frame_id) or _is_ned(m.header.frame_id)),
    }


def _body_twist(twist: Any, frame: str) -> Sample:
    return _twist(twist, _is_ned(frame)) if "base" in frame.lower() else {}  # other frames are not the body's


_SAMPLES: dict[str, Callable[[Any], Sample]] = {
    "mavros_msgs/RCOut": lambda m: {"outputs": [float(c) for c in m.channels]},
    "mavros_msgs/State": lambda m: {"state": [float(m.armed), str(m.mode)]},  # type: ignore[list-item]
    "std_msgs/Float64MultiArray": lambda m: {"commands": [float(c) for c in m.data]},
    "std_msgs/Float32MultiArray": lambda m: {"commands": [float(c) for c in m.data]},
    "sensor_msgs/Imu": _imu,
    "nav_msgs/Odometry": _odometry,
    "geometry_msgs/PoseStamped": lambda m: _pose(m.pose, _is_ned(m.header.frame_id)),
    "geometry_msgs/PoseWithCovarianceStamped": lambda m: _pose(m.pose.pose, _is_ned(m.header.frame_id)),
    "geometry_msgs/TwistStamped": lambda m: _body_twist(m.twist, m.header.frame_id),
    "geometry_msgs/TwistWithCovarianceStamped": lambda m: _body_twist(m.twist.twist, m.header.frame_id),
    "sensor_msgs/BatteryState": lambda m: {"battery": [float(m.voltage), float(m.current)]},
}
_POSES = ("geometry_msgs/PoseStamped", "geometry_msgs/PoseWithCovarianceStamped")
_CHANNELS = {  # of each stream: names, unit, how it is sampled, and the kinds of message that give it before others
    # headings of an IMU and of odometry begin at different norths: the one that goes with the positions counts
    "attitude": (("roll", "pitch", "yaw"), "rad", Sampling.ESTIMATED, ("nav_msgs/Odometry", *_POSES)),
    "gyro": ("pqr", "rad/s", Sampling.MEASURED, ("sensor_msgs/Imu",)),
    "accelerometer": (("ax", "ay", "az"), "m/s^2", Sampling.MEASURED, ("sensor_msgs/Imu",)),
    "position": ("xyz", "m", Sampling.ESTIMATED, ("nav_msgs/Odometry",)),
    "body_velocity": ("uvw", "m/s", Sampling.ESTIMATED, ()),
    "battery": (("voltage", "current"), ("V", "A"), Sampling.MEASURED, ()),
}


def _streams(name: str, topics: list[Topic]) -> Streams:
    late = [np.nanmedian(t.stamp - t.received) for t in topics if np.isfinite(t.stamp).any()]
    stamped = bool(late) and max(abs(value) for value in late) < _SAME_CLOCK_S
    times = {t.name: np.where(np.isfinite(t.stamp) & stamped, t.stamp, t.received) for t in topics}
    start = min(float(values.min()) for values in times.values())
    found: dict[str, Stream] = {}
    sources: dict[str, Topic] = {}
    for key, (channels, unit, sampling, preferred) in _CHANNELS.items():
        if holds := [t for t in topics if key in t.samples[0]]:
            topic = sources[key] = min(holds, key=lambda t: (t.kind not in preferred, -len(t.samples)))
            rows = [s.get(key, [np.nan] * len(tuple(channels))) for s in topic.samples]
            made = stream(key, channels, unit, times[topic.name] - start, rows, sampling, topic.name)
            found.update({key: made} if made else {})
    told, missing = _commands(topics, times, start)
    found.update({told.name: told} if told else {})
    armed, modes = _state(topics, times, start, max((float(s.t[-1]) for s in found.values()), default=0.0))
    sentence = "vectors are read as ENU and FLU (REP 103) unless their frame is called ned or frd"
    findings = [Finding(Severity.INFO, "ros_frames", sentence), *_mounting(sources.get("accelerometer")), *missing]
    return Streams(name, "ROS bag", found, VehicleFacts(), armed, modes, findings=tuple(findings))


def _mounting(imu: Topic | None) -> list[Finding]:
    """What is taken for granted of an IMU whose frame is another one than the body's."""
    if imu is None or not imu.frame or "base" in imu.frame.lower():
        return []
    sentence = f"{imu.name} is in the frame {imu.frame}: it is read as mounted along the axes of the body"
    remedy = "Record it turned into the frame of the body if it is not"
    return [Finding(Severity.INFO, "imu_frame", sentence, remedy, ("p", "q", "r", "ax", "ay", "az"))]


def _commands(topics: list[Topic], times: dict[str, np.ndarray], start: float) -> tuple[Stream | None, list[Finding]]:
    """Pulses of mavros, or the one topic of numbers within [-1, 1] as the commands of the thrusters."""
    pulses = [t for t in topics if t.kind == "mavros_msgs/RCOut"]
    arrays = [t for t in topics if "commands" in t.samples[0]]
    chosen, key, held = (pulses[:1] or arrays), "commands", Sampling.HELD
    if pulses:
        key, held = "outputs", Sampling.SNAPSHOT
    if len(chosen) != 1:
        names = ", ".join(t.name for t in chosen)
        sentence = f"{names} may all be the commands of the thrusters" if chosen else "no topic tells commands"
        return None, [Finding(Severity.WARNING, "which_commands", sentence, "Record one topic of them in the bag")]
    topic = chosen[0]
    width = len(topic.samples[0][key])
    kept = [i for i, sample in enumerate(topic.samples) if len(sample[key]) == width]
    values = np.array([topic.samples[i][key] for i in kept]).reshape(len(kept), width)
    t = times[topic.name][kept] - start
    names = [f"C{n + 1}" if key == "outputs" else f"cmd_{n + 1}" for n in range(width)]
    return stream(key, names, "us" if key == "outputs" else "1", t, values, held, topic.name), []


def _state(topics: list[Topic], times: dict[str, np.ndarray], start: float, end: float):
    told = next((t for t in topics if t.kind == "mavros_msgs/State"), None)
    if told is None:
        return None, ()
    rows = [(float(t - start), *s["state"]) for t, s in zip(times[told.name], told.samples, strict=True)]
    return state_of([(t, on > 0, str(mode)) for t, on, mode in rows], end)
