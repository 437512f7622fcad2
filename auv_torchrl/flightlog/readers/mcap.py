"""MCAP recordings: MAVLink as JSON, as the recorder of BlueOS writes it, or a ROS 2 bag.

BlueOS records what goes over its bus under the same names: a message is at ``mavlink/SYSTEM/COMPONENT/NAME`` and reads
``{"header": {...}, "message": {"type": "ATTITUDE", "roll": ...}}``, with enumerations by name. The same is at
``mavlink/out``, and each field below its message. Fields that MAVLink 2 added to a message may be missing: outputs
beyond the eighth are (github.com/bluerobotics/mavlink-server, src/lib/drivers/zenoh/json.rs).

A file goes from arming to disarming, its times are those of receiving, and there is a channel for every topic whose
payload is an object (github.com/bluerobotics/blueos-recorder, src/service.rs and src/channel_descriptor.rs).
"""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.readers.ardupilot import mavlink
from auv_torchrl.flightlog.readers.bounds import Loss
from auv_torchrl.flightlog.readers.mcap_records import read_messages
from auv_torchrl.flightlog.readers.recording import Channel
from auv_torchrl.flightlog.readers.ros import ros
from auv_torchrl.flightlog.streams.stream import ReadOptions, Streams

_TOPIC = re.compile(r"/?mavlink/([0-9]{1,3})/([0-9]{1,3})/(?:in/|out/)?([A-Z0-9_]+)")
_ALL = re.compile(r"/?mavlink/out")  # under which the bus has every message, beside the topic of its own
_FLAGS = (  # EKF_STATUS_REPORT.flags from the lowest bit
    "EKF_ATTITUDE", "EKF_VELOCITY_HORIZ", "EKF_VELOCITY_VERT", "EKF_POS_HORIZ_REL", "EKF_POS_HORIZ_ABS",
    "EKF_POS_VERT_ABS", "EKF_POS_VERT_AGL", "EKF_CONST_POS_MODE",
)  # fmt: skip
_BITS = {**{name: 1 << i for i, name in enumerate(_FLAGS)}, "MAV_MODE_FLAG_SAFETY_ARMED": 128}
_NUMBERS = {  # https://mavlink.io/en/messages/minimal.html
    "MAV_AUTOPILOT_INVALID": 8, "MAV_AUTOPILOT_ARDUPILOTMEGA": 3, "MAV_AUTOPILOT_PX4": 12,
    **{f"MAV_TYPE_{name}": number for number, name in enumerate((
        "GENERIC", "FIXED_WING", "QUADROTOR", "COAXIAL", "HELICOPTER", "ANTENNA_TRACKER", "GCS", "AIRSHIP",
        "FREE_BALLOON", "ROCKET", "GROUND_ROVER", "SURFACE_BOAT", "SUBMARINE", "HEXAROTOR", "OCTOROTOR", "TRICOPTER",
        "FLAPPING_WING", "KITE", "ONBOARD_CONTROLLER", "VTOL_TAILSITTER_DUOROTOR", "VTOL_TAILSITTER_QUADROTOR",
        "VTOL_TILTROTOR",
    ))},
}  # fmt: skip


@np.errstate(invalid="ignore", over="ignore")  # of numbers in a damaged file
def read(path: Path, options: ReadOptions) -> Streams:
    """The streams of an MCAP file.

    Raises:
        FlightLogError: if it holds neither MAVLink nor ROS messages, or a library is missing.
    """
    loss = Loss()
    received = mavlink.Received(loss)
    seen: dict[Channel, None] = {}
    by_name = False
    for channel, time_ns, data in read_messages(path, _is_mavlink, seen, loss):
        if not by_name and _TOPIC.fullmatch(channel.topic):
            by_name = True
            received = mavlink.Received(loss)  # what came under the common topic comes again under its own
        try:
            decoded = _message(channel.topic, data, by_name)
            if decoded is not None:
                system, name, fields = decoded
                received.add(system, name, time_ns * 1e-9, fields)
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
            loss.add("messages that cannot be read")
    if received:
        return received.streams(path.name, "MAVLink in MCAP", options.system, loss.findings())
    if any(channel.encoding != "json" for channel in seen):
        return ros.read(path, options)
    findings = " ".join(map(str, loss.findings()))
    if any(map(_is_mavlink, seen)) and loss.sentence:
        raise FlightLogError(f"{path.name} holds no MAVLink message that can be read ({findings})")
    raise FlightLogError(
        f"{path.name} holds no MAVLink and no ROS messages: record mavlink/** of the vehicle"
        + (f" ({findings})" if findings else "")
    )


def _is_mavlink(channel: Channel) -> bool:
    return channel.encoding == "json" and bool(_TOPIC.fullmatch(channel.topic) or _ALL.fullmatch(channel.topic))


def _message(topic: str, data: bytes, by_name: bool) -> tuple[int, str, dict[str, Any]] | None:
    """System, name and fields of a message that is wanted, from the topic of its own or from the common one."""
    place = _TOPIC.fullmatch(topic)
    if place is not None:
        system, component, name = int(place[1]), int(place[2]), place[3]
        if component != mavlink.AUTOPILOT or name not in mavlink.WANTED:
            return None
        decoded = json.loads(data, strict=False)  # names come with the zeros behind them
    elif not by_name and _ALL.fullmatch(topic):
        decoded = json.loads(data, strict=False)
        system, name = int(decoded["header"]["system_id"]), str(decoded["message"]["type"])
        if int(decoded["header"]["component_id"]) != mavlink.AUTOPILOT or name not in mavlink.WANTED:
            return None
    else:
        return None
    return system, name, dict.fromkeys(mavlink.ADDED.get(name, ()), 0) | _fields(decoded["message"])


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
