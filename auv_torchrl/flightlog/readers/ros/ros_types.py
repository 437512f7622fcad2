"""Types of ROS messages as their definitions describe them, and messages of them as values by field.

A recording mostly bears the definitions of its types; those of ROS 2 in sqlite3 up to Humble do not, and for them the
definitions of the types that are needed stand here. https://wiki.ros.org/msg says how they are written.
"""

import re
import struct
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from auv_torchrl.flightlog.readers.recording import short
from auv_torchrl.quantities import counted

Values = dict[str, Any]  # by name of the field, with dots: numbers, texts, or tuples of them

CDR, ROS1 = "cdr", "ros1"  # how ROS 2 and ROS 1 write messages
_TWIST = "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular"
_XYZ = "float64 x\nfloat64 y\nfloat64 z"
KNOWN = {  # of ROS 2: https://github.com/ros2/common_interfaces, https://github.com/mavlink/mavros
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/MultiArrayDimension": "string label\nuint32 size\nuint32 stride",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset",
    "std_msgs/Float64MultiArray": "std_msgs/MultiArrayLayout layout\nfloat64[] data",
    "std_msgs/Float32MultiArray": "std_msgs/MultiArrayLayout layout\nfloat32[] data",
    "geometry_msgs/Vector3": _XYZ,
    "geometry_msgs/Point": _XYZ,
    "geometry_msgs/Quaternion": f"{_XYZ}\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/PoseWithCovarianceStamped": "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose",
    "geometry_msgs/Twist": _TWIST,
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "geometry_msgs/TwistStamped": "std_msgs/Header header\ngeometry_msgs/Twist twist",
    "geometry_msgs/TwistWithCovarianceStamped": "std_msgs/Header header\ngeometry_msgs/TwistWithCovariance twist",
    "nav_msgs/Odometry": "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
    "geometry_msgs/TwistWithCovariance twist",
    "sensor_msgs/Imu": "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\n"
    "float64[9] orientation_covariance\ngeometry_msgs/Vector3 angular_velocity\n"
    "float64[9] angular_velocity_covariance\ngeometry_msgs/Vector3 linear_acceleration\n"
    "float64[9] linear_acceleration_covariance",
    # of a BatteryState, how it begins
    "sensor_msgs/BatteryState": "std_msgs/Header header\nfloat32 voltage\nfloat32 temperature\nfloat32 current",
    "mavros_msgs/RCOut": "std_msgs/Header header\nuint16[] channels",
    "mavros_msgs/State": "std_msgs/Header header\nbool connected\nbool armed\nbool guided\nbool manual_input\n"
    "string mode\nuint8 system_status",
}
_NUMBERS = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d", "octet": "B",
}  # fmt: skip
_PAIRS = {"time": ("sec", "nanosec"), "duration": ("sec", "nanosec")}  # of ROS 1, 32 bits each
_FIELD = re.compile(r"([A-Za-z][\w/]*)(?:<=[0-9]+)?(\[(?:<=)?[0-9]{0,9}\])?\s+([A-Za-z]\w*)(.*)", re.ASCII)
_MOST_STEPS = 500  # fields of a type with all that are in it; an Odometry has 30
_DEEPEST = 10  # types within one another


class DefinitionError(ValueError):
    """A type cannot be read by its definition."""


class _Step(NamedTuple):
    """One field that is no message itself, or an array of messages."""

    name: str  # with dots
    kind: str  # code of struct; "s" for texts, "" for an array of messages
    length: int | None  # None for one value, -1 for an array whose length goes before it
    parts: tuple["_Step", ...] = ()  # of each message of an array


class Type:
    """A type of message, and how its messages are read.

    Raises:
        DefinitionError: for a definition that says nothing of a field, that is recursive, or is larger than any type.
    """

    def __init__(self, name: str, definition: str, encoding: str) -> None:
        sections = _sections(name, definition) if definition else KNOWN
        self._cdr = encoding == CDR
        self._left = _MOST_STEPS
        self._steps = tuple(self._plan(short(name), sections, "", _DEEPEST))

    def values(self, data: bytes) -> Values:
        """The fields of a message.

        Raises:
            struct.error: if it is shorter than its type.
            ValueError: if it is written in another way.
        """
        begin, order = 0, "<"
        if self._cdr:
            if len(data) < 4 or data[0] or data[1] > 1:
                raise ValueError(f"a message that begins with {data[:4].hex()}")
            begin, order = 4, "<" if data[1] else ">"
        found: Values = {}
        _read(self._steps, data, begin, begin if self._cdr else None, order, found)
        return found

    def _plan(self, name: str, sections: Mapping[str, str], prefix: str, deepest: int) -> Iterator[_Step]:
        if name not in sections:
            raise DefinitionError(f"{name} is not defined")
        if not deepest:
            raise DefinitionError(f"{name} holds itself, or too many types in one another")
        for kind, count, field in _fields(name, sections[name]):
            self._left -= 1
            if self._left < 0:
                raise DefinitionError(f"{name} has more than {_MOST_STEPS} fields")
            place = f"{prefix}{field}"
            if kind in _NUMBERS or kind == "string":
                yield _Step(place, _NUMBERS.get(kind, "s"), count)
            elif kind in _PAIRS and kind not in sections:
                parts = tuple(
                    _Step(f"{place}.{part}", "i" if kind == "duration" else "I", None) for part in _PAIRS[kind]
                )
                yield from parts if count is None else (_Step(place, "", count, parts),)
            elif count is None:
                yield from self._plan(_place(kind, name, sections), sections, f"{place}.", deepest - 1)
            else:
                parts = tuple(self._plan(_place(kind, name, sections), sections, f"{place}.", deepest - 1))
                if not _least(parts):  # so that a claimed length cannot be longer than the message
                    raise DefinitionError(f"{name} has an array of {kind}, which has no content")
                yield _Step(place, "", count, parts)


def _least(steps: tuple[_Step, ...]) -> int:
    """The bytes that fields have at least."""
    total = 0
    for _, kind, count, parts in steps:
        each = _least(parts) if parts else 4 if kind == "s" else struct.calcsize(kind)
        total += 4 if count == -1 else each * (1 if count is None else count)
    return total


def _sections(name: str, definition: str) -> dict[str, str]:
    """By name, the definition of a type and of those that it needs."""
    first, *others = re.split(r"^={20,}[ \t\r]*\n", definition, flags=re.MULTILINE)
    found = {short(name): first}
    for other in others:
        head, _, body = other.partition("\n")
        if head.startswith("MSG:"):
            found[short(head.removeprefix("MSG:").strip())] = body
    return {**({} if "std_msgs/Header" in found else {"std_msgs/Header": KNOWN["std_msgs/Header"]}),
            "builtin_interfaces/Time": KNOWN["builtin_interfaces/Time"], **found}  # fmt: skip


def _fields(name: str, definition: str) -> Iterator[tuple[str, int | None, str]]:
    """Type, length and name of each field; -1 for an array of any length, None for one value."""
    for line in definition.splitlines():
        line = line.partition("#")[0].strip()
        if not line:
            continue
        found = _FIELD.fullmatch(line)
        if found is None:
            raise DefinitionError(f"{name} has a line {line[:40]!r}")
        kind, array, field, rest = found.groups()
        if rest.lstrip().startswith("="):
            continue  # a constant
        length = (array or "").strip("[]")
        yield kind, None if array is None else -1 if not length or length.startswith("<=") else int(length), field


def _place(kind: str, within: str, sections: Mapping[str, str]) -> str:
    """The full name of a type that another one names."""
    kind = short(kind)
    if "/" in kind:
        return kind
    return "std_msgs/Header" if kind == "Header" else f"{within.rpartition('/')[0]}/{kind}"


def _read(steps: tuple[_Step, ...], data: bytes, at: int, aligned: int | None, order: str, found: Values) -> int:
    """Take the fields of ``steps`` from ``at`` on, and return where they end.

    Numbers stand at multiples of their size from ``aligned`` on; anywhere where that is None.
    """
    for name, kind, count, parts in steps:
        number = 1 if count is None else count
        if number < 0:
            number, at = _number(data, at, aligned, order, "I")
        if parts:
            for _ in range(number):
                at = _read(parts, data, at, aligned, order, found)
        elif kind == "s":
            texts = []
            for _ in range(number):
                length, at = _number(data, at, aligned, order, "I")
                if at + length > len(data):
                    raise struct.error(f"a text of {counted(length, 'byte')} in {len(data)}")
                texts.append(data[at : at + length].rstrip(b"\0").decode("utf-8", "replace"))
                at += length
            found[name] = texts[0] if count is None else tuple(texts)
        else:
            size = struct.calcsize(kind)
            if number and aligned is not None:
                at += (aligned - at) % size
            if at + number * size > len(data):
                raise struct.error(f"{counted(number, 'number')} of {counted(size, 'byte')} in {len(data)}")
            values = struct.unpack_from(f"{order}{number}{kind}", data, at)
            at += number * size
            found[name] = values[0] if count is None else values
    return at


def _number(data: bytes, at: int, aligned: int | None, order: str, kind: str) -> tuple[int, int]:
    size = struct.calcsize(kind)
    if aligned is not None:
        at += (aligned - at) % size
    return struct.unpack_from(f"{order}{kind}", data, at)[0], at + size
