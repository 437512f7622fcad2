"""MCAP recordings: MAVLink as JSON, as the recorder of BlueOS writes it, or a ROS 2 bag.

BlueOS records what goes over its bus under the same names: a message is at ``mavlink/SYSTEM/COMPONENT/NAME`` and reads
``{"header": {...}, "message": {"type": "ATTITUDE", "roll": ...}}``, with enumerations by name. The same is at
``mavlink/out``, and each field below its message. Fields that MAVLink 2 added to a message may be missing: outputs
beyond the eighth are (github.com/bluerobotics/mavlink-server, src/lib/drivers/zenoh/json.rs).
"""

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.readers import mavlink, ros
from auv_torchrl.flightlog.readers.reader import library
from auv_torchrl.flightlog.streams.stream import ReadOptions, Streams

MAGIC = b"\x89MCAP"
_TOPIC = re.compile(r"/?mavlink/(\d+)/(\d+)/(?:in/|out/)?([A-Z0-9_]+)")
_ALL = re.compile(r"/?mavlink/out")  # under which the bus has every message, beside the topic of its own
_FLAGS = (  # EKF_STATUS_REPORT.flags from the lowest bit
    "EKF_ATTITUDE", "EKF_VELOCITY_HORIZ", "EKF_VELOCITY_VERT", "EKF_POS_HORIZ_REL", "EKF_POS_HORIZ_ABS",
    "EKF_POS_VERT_ABS", "EKF_POS_VERT_AGL", "EKF_CONST_POS_MODE",
)  # fmt: skip
_BITS = {**{name: 1 << i for i, name in enumerate(_FLAGS)}, "MAV_MODE_FLAG_SAFETY_ARMED": 128}
_NUMBERS = {"MAV_AUTOPILOT_INVALID": 8, "MAV_AUTOPILOT_ARDUPILOTMEGA": 3, "MAV_TYPE_GCS": 6, "MAV_TYPE_SUBMARINE": 12}


def read(path: Path, options: ReadOptions) -> Streams:
    """The streams of an MCAP file.

    Raises:
        FlightLogError: if it holds neither MAVLink nor ROS messages, or a library is missing.
    """
    cut: list[str] = []
    received = mavlink.Received()
    encodings: set[str] = set()
    broken, by_name = 0, False
    for topic, encoding, time_ns, data in _messages(path, cut):
        encodings.add(encoding)
        if encoding != "json":
            continue
        if not by_name and _TOPIC.fullmatch(topic):
            by_name = True
            received = mavlink.Received()  # what came under the common topic comes again under its own
        try:
            told = _message(topic, data, by_name)
        except (ValueError, KeyError, TypeError, AttributeError):
            broken += 1
            continue
        if told is not None:
            system, name, fields = told
            received.add(system, name, time_ns * 1e-9, fields)
    if not received:
        if encodings - {"json"}:
            return ros.read(path, options)
        raise FlightLogError(f"{path.name} holds no MAVLink and no ROS messages: record mavlink/** of the vehicle")
    findings = []
    if cut or broken:
        sentence = f"the file is cut or damaged: {cut[0] if cut else f'{broken} messages cannot be read'}"
        findings.append(Finding(Severity.WARNING, "damaged_file", sentence, "Copy it from the vehicle again"))
    return received.streams(path.name, "MAVLink in MCAP", options.system, findings)


def _messages(path: Path, cut: list[str]) -> Iterator[tuple[str, str, int, bytes]]:
    """Topic, encoding, time and content, as far as the file can be read."""
    reader = library("mcap.stream_reader", f"an MCAP recording ({path.name})")
    records = library("mcap.records", f"an MCAP recording ({path.name})")
    channels: dict[int, tuple[str, str]] = {}
    with path.open("rb") as file:
        stream = iter(reader.StreamReader(file).records)
        while True:
            try:
                record = next(stream)
            except StopIteration:
                return
            except Exception as error:  # of a file that is cut or damaged: whatever lies in it
                cut.append(" ".join(f"{type(error).__name__} {error}".split())[:100])
                return
            if isinstance(record, records.Channel):
                channels[record.id] = (record.topic, record.message_encoding)
            elif isinstance(record, records.Message) and record.channel_id in channels:
                yield (*channels[record.channel_id], record.log_time, record.data)


def _message(topic: str, data: bytes, by_name: bool) -> tuple[int, str, dict[str, Any]] | None:
    """System, name and fields of a message that is wanted, from the topic of its own or from the common one."""
    place = _TOPIC.fullmatch(topic)
    if place is not None:
        system, component, name = int(place[1]), int(place[2]), place[3]
        if component != mavlink.AUTOPILOT or name not in mavlink.WANTED:
            return None
        told = json.loads(data, strict=False)  # names come with the zeros behind them
    elif not by_name and _ALL.fullmatch(topic):
        told = json.loads(data, strict=False)
        system, name = int(told["header"]["system_id"]), str(told["message"]["type"])
        if int(told["header"]["component_id"]) != mavlink.AUTOPILOT or name not in mavlink.WANTED:
            return None
    else:
        return None
    return system, name, dict.fromkeys(mavlink.ADDED.get(name, ()), 0) | _fields(told["message"])


def _fields(message: Mapping[str, Any]) -> dict[str, Any]:
    """The fields as MAVLink has them: numbers and texts."""
    found = {"type" if name == "mavtype" else name: value for name, value in message.items() if name != "type"}
    return {name: _value(name, value) for name, value in found.items()}


def _value(name: str, value: Any) -> Any:
    if isinstance(value, Mapping):
        value = value.get("bits", value.get("type", 0))
    if name in mavlink.TEXTS:
        letters = value if isinstance(value, str) else "".join(chr(c) if isinstance(c, int) else str(c) for c in value)
        return letters.partition("\0")[0]
    if isinstance(value, str):
        return _NUMBERS.get(value, sum(_BITS.get(word.strip(), 0) for word in value.split("|")))
    if not isinstance(value, int | float):
        raise TypeError(name)
    return value
