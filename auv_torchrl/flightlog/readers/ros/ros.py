"""ROS 1 bags, and ROS 2 bags as sqlite3 or MCAP: topics are known by the type of their messages.

ROS has its vectors in ENU and FLU (REP 103); a frame that is called ned or frd is taken at its word. Arrays of numbers
are commands of thrusters where the name of their topic says so, and never because there are as many as thrusters.
"""

import io
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.readers import mcap_records
from auv_torchrl.flightlog.readers.bounds import MOST_MESSAGE, Budget, Loss, Rows
from auv_torchrl.flightlog.readers.messages import changes
from auv_torchrl.flightlog.readers.packed_log import BAG, unpacked
from auv_torchrl.flightlog.readers.packings import PACKINGS
from auv_torchrl.flightlog.readers.reader import HEAD_BYTES, refuse_pointer
from auv_torchrl.flightlog.readers.recording import Channel, Messages, Wanted
from auv_torchrl.flightlog.readers.ros import rosbag
from auv_torchrl.flightlog.readers.ros.ros_types import CDR, ROS1, DefinitionError, Type, Values
from auv_torchrl.flightlog.streams.attitude import euler_angles, frd_of_flu, ned_of_enu, ned_of_enu_vector
from auv_torchrl.flightlog.streams.stream import (
    WHICH_COMMANDS,
    Floats,
    Modes,
    ReadOptions,
    Sampling,
    Spans,
    Stream,
    Streams,
    VehicleFacts,
    state_of,
    stream,
)
from auv_torchrl.flightlog.tables.header import first_bytes
from auv_torchrl.quantities import counted
from auv_torchrl.text import MOST_CHARACTERS, printable

_SAME_CLOCK_S = 5.0  # between a message's stamp and the time of the bag; more is a simulated clock, or none
_MOST_MODES = 1000  # different names of modes that are held; a vehicle has some tens
_LISTED = 6  # topics that a finding names
_SLACK = 1.001  # of commands, which are within [-1, 1]: roundings to float32
_COMMANDS = re.compile(r"(?<![a-z])(thruster|motor|propeller|escs?(?![a-z]))", re.IGNORECASE)  # in the name of a topic
_ANSWERS = re.compile(r"rpm|temp|current|volt|state|status|feedback|measured|force", re.IGNORECASE)  # not commands
_TO_RECORD = (
    "Record the commands in [-1, 1] as std_msgs/Float64MultiArray on a topic with thruster or motor in its name, or "
    "the pulses as mavros_msgs/RCOut"
)


def _xyz(name: str) -> tuple[str, ...]:
    return tuple(f"{name}.{axis}" for axis in "xyz")


def _wxyz(name: str) -> tuple[str, ...]:
    return tuple(f"{name}.{axis}" for axis in "wxyz")


def _pose(name: str) -> tuple[str, ...]:
    return (*_xyz(f"{name}.position"), *_wxyz(f"{name}.orientation"))


def _twist(name: str) -> tuple[str, ...]:
    return (*_xyz(f"{name}.linear"), *_xyz(f"{name}.angular"))


_IMU = (*_wxyz("orientation"), "orientation_covariance", *_xyz("angular_velocity"), *_xyz("linear_acceleration"))
_FIELDS = {  # of each type, the fields that are taken
    "mavros_msgs/RCOut": ("channels",),
    "mavros_msgs/State": ("armed", "mode"),
    "std_msgs/Float64MultiArray": ("data",),
    "std_msgs/Float32MultiArray": ("data",),
    "sensor_msgs/Imu": _IMU,
    "nav_msgs/Odometry": (*_pose("pose.pose"), *_twist("twist.twist")),
    "geometry_msgs/PoseStamped": _pose("pose"),
    "geometry_msgs/PoseWithCovarianceStamped": _pose("pose.pose"),
    "geometry_msgs/TwistStamped": _twist("twist"),
    "geometry_msgs/TwistWithCovarianceStamped": _twist("twist.twist"),
    "sensor_msgs/BatteryState": ("voltage", "current"),
}
_ARRAYS = ("std_msgs/Float64MultiArray", "std_msgs/Float32MultiArray")
_POSES = ("geometry_msgs/PoseStamped", "geometry_msgs/PoseWithCovarianceStamped")
_CHANNELS = {  # of each stream: names, unit, how it is sampled, and the kinds of message that give it before others
    "position": ("xyz", "m", Sampling.ESTIMATED, ("nav_msgs/Odometry",)),
    # headings of an IMU and of odometry begin at different norths: the one that goes with the positions counts
    "attitude": (("roll", "pitch", "yaw"), "rad", Sampling.ESTIMATED, ("nav_msgs/Odometry", *_POSES)),
    "gyro": ("pqr", "rad/s", Sampling.MEASURED, ("sensor_msgs/Imu",)),
    "accelerometer": (("ax", "ay", "az"), "m/s^2", Sampling.MEASURED, ("sensor_msgs/Imu",)),
    "body_velocity": ("uvw", "m/s", Sampling.ESTIMATED, ()),
    "battery": (("voltage", "current"), ("V", "A"), Sampling.MEASURED, ()),
}
_APART = 0.35  # rad, by which the attitude of another vehicle is off that of the IMU; no two filters of one are
_WITH_PLACE = ("attitude", "body_velocity")  # streams that are taken from the topic of the position if it has them


@dataclass
class Topic:
    """The messages of one topic that were read."""

    name: str
    kind: str  # type of its messages
    type: Type
    frame: str = ""  # in which its first message is; empty where messages bear none
    child: str = ""  # the frame of the moving thing, likewise
    rows: Rows | None = None  # received and sent in s, 0 where messages do not say; then the fields
    modes: dict[str, int] = field(default_factory=dict)  # numbers of the names of modes

    def add(self, time_ns: int, data: bytes, budget: Budget) -> None:
        """Take a message.

        Raises:
            struct.error, ValueError, TypeError, OverflowError: if it is damaged, or has another width than the first.
            KeyError: if its type lacks a field.
        """
        values = self.type.values(data)
        row = [time_ns * 1e-9, _stamp(values)]
        for name in _FIELDS[self.kind]:
            value = values[name]
            if name == "orientation_covariance":
                row.append(value[0])
            elif isinstance(value, str):
                row.append(self._mode(value[:MOST_CHARACTERS]))
            elif isinstance(value, tuple):
                row.extend(value)
            else:
                row.append(value)
        if self.rows is None:
            self.frame, self.child = str(values.get("header.frame_id", "")), str(values.get("child_frame_id", ""))
            self.rows = Rows(len(row))
        if budget.take(len(row)):
            self.rows.add(row)

    def _mode(self, name: str) -> int:
        if name not in self.modes and len(self.modes) >= _MOST_MODES:
            raise ValueError(f"more than {_MOST_MODES} modes")
        return self.modes.setdefault(name, len(self.modes))

    @property
    def received(self) -> Floats:
        """(T,) s."""
        return self._values[:, 0]

    @property
    def sent(self) -> Floats:
        """(T,) s; NaN where messages do not say."""
        return np.where(self._values[:, 1] > 0, self._values[:, 1], np.nan)

    @property
    def fields(self) -> Floats:
        """(T, n) the fields, side by side."""
        return self._values[:, 2:]

    @property
    def _values(self) -> Floats:
        assert self.rows is not None  # topics without messages are left out
        return self.rows.array()


def recognizes(head: bytes) -> bool:
    """Whether a file begins as a bag of ROS 1, or of ROS 2 in sqlite3."""
    return head.startswith((rosbag.SQLITE, rosbag.BAG_1))


def is_bag(folder: Path) -> bool:
    """Whether a folder is a bag of ROS 2."""
    return any(path.is_file() for path in folder.glob(f"{BAG}*"))


@np.errstate(invalid="ignore", over="ignore")  # of numbers in a damaged file
def read(path: Path, options: ReadOptions) -> Streams:
    """The streams of a bag.

    Raises:
        FlightLogError: if no topic is of a type that is known, or a library that unpacks it is missing.
    """
    loss, seen = Loss(), {}
    topics = _topics(path, seen, loss)
    findings = tuple(loss.findings())
    if not topics and not seen and loss.sentence:
        raise FlightLogError(f"{path.name} cannot be read as a ROS bag (left out: {loss.sentence}): copy it again")
    if not topics:
        there = sorted(f"{channel.topic} ({channel.kind})" for channel in seen)
        more = f" ({' '.join(map(str, findings))})" if findings else ""
        raise FlightLogError(
            f"{path.name} has no topic that is known (it has {_listed(there) or 'none'}): record "
            f"{', '.join(sorted(_FIELDS))}{more}"
        )
    others = sorted({f"{channel.topic} ({channel.kind})" for channel in seen if not _is_wanted(channel)})
    if others:
        sentence = f"topics of other types are left out: {_listed(others)}"
        findings = (*findings, Finding(Severity.INFO, "topics_left_out", sentence))
    return _streams(path.name, topics, others, findings)


def _topics(path: Path, seen: dict[Channel, None], loss: Loss) -> list[Topic]:
    """The topics whose messages are needed and can be read."""
    topics: dict[Channel, Topic | None] = {}
    budget = Budget(loss)
    for channel, time_ns, data in messages(path, _is_wanted, seen, loss):
        if channel not in topics:
            try:
                made = Type(channel.kind, channel.definition, channel.encoding)
                topics[channel] = Topic(channel.topic, channel.kind, made)
            except DefinitionError as error:
                topics[channel] = None
                loss.cut(f"{channel.topic}, the description of whose type cannot be read", error)
        topic = topics[channel]
        if topic is None:
            continue
        try:
            topic.add(time_ns, plain(data), budget)
        except KeyError as error:
            topics[channel] = None
            loss.cut(f"{channel.topic}, whose type {channel.kind} has no field {error.args[0]}")
        except (struct.error, ValueError, TypeError, OverflowError):
            loss.add("messages that cannot be read")
        if loss.stopped:
            break
    return [topic for topic in topics.values() if topic is not None and topic.rows is not None and len(topic.rows)]


def _is_wanted(channel: Channel) -> bool:
    return channel.kind in _FIELDS and channel.encoding in (CDR, ROS1)


def messages(path: Path, wanted: Wanted, seen: dict[Channel, None], loss: Loss) -> Messages:
    """The messages of a bag, whatever contains them."""
    for part in rosbag.storage_of(path, loss) if path.is_dir() else [path]:
        with unpacked(part, lambda name, head: True) as (file, findings):
            for finding in findings:
                loss.cut(finding.sentence)
            head = first_bytes(file, HEAD_BYTES)
            refuse_pointer(part.name if part == path else f"{path.name}/{part.name}", head)
            if head.startswith(rosbag.SQLITE):
                yield from rosbag.read_database(file, wanted, seen, loss)
            elif head.startswith(rosbag.BAG_1):
                yield from rosbag.read_bag(file, wanted, seen, loss)
            elif head.startswith(mcap_records.MAGIC):
                yield from mcap_records.read_messages(file, wanted, seen, loss)
            else:
                loss.cut(f"{part.name}, which is neither a database nor an MCAP file")


def plain(data: bytes) -> bytes:
    """A message that the recorder packed by itself, unpacked.

    Raises:
        ValueError: if that cannot be done, or it becomes too large.
    """
    packing = PACKINGS["zstd"]
    if not data.startswith(packing.magic):
        return data
    opened, errors = packing.opened(io.BytesIO(data), "a bag with packed messages")
    try:
        message = opened.read(MOST_MESSAGE + 1)
    except errors as error:
        raise ValueError(error) from error
    if len(message) > MOST_MESSAGE:
        raise ValueError("a message that becomes too large")
    return message


def _listed(names: list[str]) -> str:
    return ", ".join(map(printable, names[:_LISTED])) + (
        f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    )


def _stamp(values: Values) -> float:
    return values.get("header.stamp.sec", 0) + values.get("header.stamp.nanosec", 0) * 1e-9


def _is_ned(frame: str) -> bool:
    return "ned" in frame.lower().split("_") or "frd" in frame.lower() or frame.lower().endswith("ned")


def _posed(values: Floats, ned: bool) -> dict[str, Floats]:
    place, turn = values[:, :3], values[:, 3:7]
    return {
        "position": place if ned else ned_of_enu_vector(place),
        "attitude": euler_angles(turn if ned else ned_of_enu(turn)),
    }


def _in_body(values: Floats, frd: bool) -> Floats:
    return values if frd else frd_of_flu(values)


def _twisted(values: Floats, frd: bool) -> dict[str, Floats]:
    return {"body_velocity": _in_body(values[:, :3], frd), "gyro": _in_body(values[:, 3:6], frd)}


def _imu(topic: Topic) -> dict[str, Floats]:
    values, frd = topic.fields, _is_ned(topic.frame)
    found = {"gyro": _in_body(values[:, 5:8], frd), "accelerometer": _in_body(values[:, 8:11], frd)}
    there = values[:, 4:5] >= 0  # -1: there is no orientation
    if there.any():
        turn = np.where(there, values[:, :4], np.nan)
        found["attitude"] = euler_angles(turn if frd else ned_of_enu(turn))
    return found


def _odometry(topic: Topic) -> dict[str, Floats]:
    ned = _is_ned(topic.frame)
    return {**_posed(topic.fields, ned), **_twisted(topic.fields[:, 7:], ned or _is_ned(topic.child))}


def _posed_topic(topic: Topic) -> dict[str, Floats]:
    return _posed(topic.fields, _is_ned(topic.frame))


def _twisted_topic(topic: Topic) -> dict[str, Floats]:
    return _twisted(topic.fields, _is_ned(topic.frame)) if "base" in topic.frame.lower() else {}  # else not the body's


_SENSED: dict[str, Callable[[Topic], dict[str, Floats]]] = {  # by type: values (T, n) by stream
    "sensor_msgs/Imu": _imu,
    "nav_msgs/Odometry": _odometry,
    **dict.fromkeys(_POSES, _posed_topic),
    "geometry_msgs/TwistStamped": _twisted_topic,
    "geometry_msgs/TwistWithCovarianceStamped": _twisted_topic,
    "sensor_msgs/BatteryState": lambda topic: {"battery": topic.fields},
}


def _streams(name: str, topics: list[Topic], others: list[str], findings: tuple[Finding, ...]) -> Streams:
    late = [np.nanmedian(t.sent - t.received) for t in topics if np.isfinite(t.sent).any()]
    stamped = bool(late) and max(abs(value) for value in late) < _SAME_CLOCK_S
    times = {id(t): np.where(np.isfinite(t.sent) & stamped, t.sent, t.received) for t in topics}
    start = min(float(values.min()) for values in times.values())
    sensed = [(topic, _SENSED[topic.kind](topic)) for topic in topics if topic.kind in _SENSED]
    strangers = _strangers(topics, sensed, times)
    found: dict[str, Stream] = {}
    sources: dict[str, Topic] = {}
    several: dict[str, list[str]] = {}
    for key, (channels, unit, sampling, preferred) in _CHANNELS.items():
        if holds := [(t, values[key]) for t, values in sensed if key in values]:
            with_place = sources.get("position") if key in _WITH_PLACE else None
            rank = {
                id(t): (t is not with_place, id(t) in strangers, t.kind not in preferred, -len(values))
                for t, values in holds
            }
            topic, rows = min(holds, key=lambda one: rank[id(one[0])])
            made = stream(key, channels, unit, times[id(topic)] - start, rows, sampling, topic.name)
            found.update({key: made} if made else {})
            sources[key] = topic
            same_kinds = {topic.kind, *(preferred if topic.kind in preferred else ())}
            if rivals := [t.name for t, _ in holds if t.kind in same_kinds and t is not topic]:
                several.setdefault(f"{topic.name} and not from {_listed(rivals)}", []).append(key)
    commands, missing = _commands(topics, times, start, others)
    found.update({commands.name: commands} if commands else {})
    armed, modes = _state(topics, times, start, max((float(s.t[-1]) for s in found.values()), default=0.0))
    sentence = "vectors are read as ENU and FLU (REP 103) unless their frame is called ned or frd"
    taken = [
        Finding(Severity.WARNING, "several_sources", f"{' and '.join(keys)} {'are' if keys[1:] else 'is'} taken from "
                f"{source}", "Look whether they are of the same vehicle, and record the right one alone if not")
        for source, keys in several.items()
    ]  # fmt: skip
    frames = Finding(Severity.INFO, "ros_frames", sentence)
    noted = (*findings, frames, *taken, *_mounting(sources.get("accelerometer")), *missing)
    return Streams(name, "ROS bag", found, VehicleFacts(), armed, modes, findings=noted)


def _strangers(
    topics: list[Topic], sensed: list[tuple[Topic, dict[str, Floats]]], times: dict[int, Floats]
) -> set[int]:
    """The topics whose attitude is not that of the IMU that bears the name of the commands: of another vehicle.

    Where north is, and which way up, may differ: the tilt of the vehicle and how its heading changes may not.
    """
    commanding = {_namespace(t) for t in topics if t.kind in ("mavros_msgs/RCOut", "mavros_msgs/State", *_ARRAYS)}
    own = next(
        (
            (times[id(t)], values["attitude"])
            for t, values in sensed
            if t.kind == "sensor_msgs/Imu" and "attitude" in values and _namespace(t) in commanding
        ),
        None,
    )
    if own is None:
        return set()
    attitudes = ((t, values["attitude"]) for t, values in sensed if "attitude" in values)
    return {id(t) for t, attitude in attitudes if _apart(*own, times[id(t)], attitude) > _APART}


def _apart(t: Floats, attitude: Floats, other_t: Floats, other: Floats) -> float:
    """By how many rad two attitudes (T, 3) usually differ, but for where north is; 0 where that is not known."""
    known, others = np.isfinite(attitude).all(-1), np.isfinite(other).all(-1)
    t, attitude, other_t, other = t[known], attitude[known], other_t[others], other[others]
    if not len(t) or not len(other_t):
        return 0.0
    order = np.argsort(t)
    near = order[np.clip(np.searchsorted(t[order], other_t), 0, len(t) - 1)]
    down, other_down = (_down_in_body(each) for each in (attitude[near], other))
    tilt = np.median(np.arccos(np.clip((down * other_down).sum(-1), -1.0, 1.0)))
    turned = np.exp(1j * (other[:, 2] - attitude[near, 2]))
    return float(max(tilt, np.median(np.abs(np.angle(turned / turned.mean())))))


def _down_in_body(attitude: Floats) -> Floats:
    roll, pitch = attitude[:, 0], attitude[:, 1]
    return np.stack([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)], axis=-1)


def _namespace(topic: Topic) -> str:
    """The first part of the name of a topic."""
    return topic.name.strip("/").partition("/")[0]


def _mounting(imu: Topic | None) -> list[Finding]:
    """What is taken for granted of an IMU whose frame is another one than the body's."""
    if imu is None or not imu.frame or "base" in imu.frame.lower():
        return []
    sentence = f"{imu.name} is in the frame {imu.frame}: it is read as mounted along the axes of the body"
    remedy = "Record it turned into the frame of the body if it is not"
    return [Finding(Severity.INFO, "imu_frame", sentence, remedy, ("p", "q", "r", "ax", "ay", "az"))]


def _commands(
    topics: list[Topic], times: dict[int, Floats], start: float, others: list[str]
) -> tuple[Stream | None, list[Finding]]:
    """Pulses of mavros, or the one topic that is called as commands of thrusters are and has numbers within [-1, 1]."""
    pulses = [t for t in topics if t.kind == "mavros_msgs/RCOut"]
    arrays = [t for t in topics if t.kind in _ARRAYS]
    called = [t for t in arrays if _is_called_commands(t.name)]
    within = [t for t in called if t.fields.size and np.nanmax(np.abs(t.fields), initial=0.0) <= _SLACK]
    chosen = pulses or within
    if len(chosen) != 1:
        if chosen:
            sentence = f"{_listed([t.name for t in chosen])} may all be the commands of the thrusters"
        elif called:
            listed = _listed([f"{t.name} (up to {np.nanmax(np.abs(t.fields), initial=0.0):.3g})" for t in called])
            sentence = f"{listed} is called as the commands of thrusters are, but has no numbers within [-1, 1]"
        elif arrays:
            listed = _listed([f"{t.name} ({counted(t.fields.shape[1], 'number')})" for t in arrays])
            sentence = f"no topic is called as the commands of thrusters are; arrays that may be them: {listed}"
        else:
            sentence = "no topic tells commands"
        if not chosen and (named := [other for other in others if _is_called_commands(other.partition(" ")[0])]):
            sentence += f"; {_listed(named)} may be, but is of a type that is not read"
        return None, [Finding(Severity.WARNING, WHICH_COMMANDS, sentence, _TO_RECORD)]
    topic = chosen[0]
    t, width = times[id(topic)] - start, topic.fields.shape[1]
    if pulses:
        names, unit, key, sampling = (f"C{n + 1}" for n in range(width)), "us", "outputs", Sampling.SNAPSHOT
    else:
        names, unit, key, sampling = (f"cmd_{n + 1}" for n in range(width)), "1", "commands", Sampling.HELD
    return stream(key, names, unit, t, topic.fields, sampling, topic.name), []


def _is_called_commands(topic: str) -> bool:
    return _COMMANDS.search(topic) is not None and _ANSWERS.search(topic) is None


def _state(topics: list[Topic], times: dict[int, Floats], start: float, end: float) -> tuple[Spans | None, Modes]:
    states = next((t for t in topics if t.kind == "mavros_msgs/State"), None)
    if states is None:
        return None, ()
    at = changes(*states.fields.T)
    names = list(states.modes)
    t = times[id(states)][at] - start
    return state_of(
        [(float(s), bool(on), names[int(mode)]) for s, (on, mode) in zip(t, states.fields[at], strict=True)], end
    )
