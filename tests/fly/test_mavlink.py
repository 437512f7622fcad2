"""Our few messages are those of pymavlink, both ways, and whatever else comes is left out."""

import struct

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from auv_torchrl.fly.mavlink import LAYOUTS, Parser, packet, text_of

FULL = {  # a value for each field that is sent or read
    "HEARTBEAT": {"custom_mode": 19, "type": 12, "autopilot": 3, "base_mode": 209, "system_status": 4},
    "RC_CHANNELS_OVERRIDE": {f"chan{n}_raw": 1100 + n for n in range(1, 9)} | {"target_system": 1},
    "MANUAL_CONTROL": {"x": -1000, "y": 7, "z": 500, "r": 1000, "target": 1},
    "COMMAND_LONG": {"param1": 1.0, "command": 400, "target_system": 1, "target_component": 1},
    "SET_MODE": {"custom_mode": 19, "target_system": 1, "base_mode": 1},
    "PARAM_REQUEST_READ": {"param_index": -1, "param_id": b"FRAME_CONFIG", "target_system": 1},
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_number_seed_and_order_of_the_fields_are_those_of_the_protocol(name):
    """Fields at the end that nobody here needs are left out, as MAVLink 2 allows."""
    layout, theirs = LAYOUTS[name], mavlink.mavlink_map[LAYOUTS[name].number]
    assert (theirs.msgname, theirs.crc_extra) == (name, layout.seed)
    assert theirs.unpacker.format.startswith("<")
    offset, values = struct.calcsize(layout.format), struct.unpack(layout.format, bytes(struct.calcsize(layout.format)))
    assert len(values) == len(layout.fields)
    flat = [
        f"{field}{n}" if length and "s" not in kind else field
        for field, length, kind in zip(theirs.ordered_fieldnames, theirs.array_lengths, theirs.fieldtypes, strict=True)
        for n in range(length if length and kind != "char" else 1)
    ]
    assert offset <= theirs.unpacker.size and len(flat) >= len(layout.fields)


@pytest.mark.parametrize("name", FULL)
def test_pymavlink_reads_what_is_sent(name):
    """As the firmware does."""
    read, *rest = mavlink.MAVLink(None).parse_buffer(packet(name, 255, 190, 7, **FULL[name])) or [None]
    assert read is not None and not rest
    told = read.to_dict()
    assert read.get_srcSystem() == 255 and read.get_srcComponent() == 190
    for field, value in FULL[name].items():
        assert told[field] == (value.decode() if isinstance(value, bytes) else value)


THEIRS = [
    mavlink.MAVLink_local_position_ned_message(1234, 1, -2, 3, 0.5, 0.25, -0.125),
    mavlink.MAVLink_attitude_message(1235, 0.5, -0.25, 3, 0.125, 1, -1),
    mavlink.MAVLink_odometry_message(
        77, 20, 12, 1, 2, 3, [1, 0, 0, 0.5], 4, 5, 6, 7, 8, 9, [0.0] * 21, [0.5] * 21, 3, 1, 50
    ),
    mavlink.MAVLink_vision_position_estimate_message(78, 1, 2, 3, 0.5, 0.25, 0.125, [1.0] * 21, 2),
    mavlink.MAVLink_named_value_float_message(5, b"PilotGain", 0.75),
    mavlink.MAVLink_param_value_message(b"FRAME_CONFIG", 2.0, 9, 1, 0),
    mavlink.MAVLink_statustext_message(4, b"PreArm: leak"),
    mavlink.MAVLink_command_ack_message(400, 4),
]


@pytest.mark.parametrize("message", THEIRS, ids=lambda message: message.get_type())
@pytest.mark.parametrize("old", [False, True], ids=["2", "1"])
def test_what_a_vehicle_sends_is_read(message, old):
    """As pymavlink packs it, in MAVLink 2 and, where the message fits, 1."""
    if old and message.id > 255:
        return
    data = message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1), force_mavlink1=old)
    (read,) = Parser().feed(data)
    told = message.to_dict()
    assert (read.name, read.system, read.component) == (told.pop("mavpackettype"), 1, 1)
    for field, value in read.fields.items():
        if isinstance(value, bytes):
            assert text_of(value) == told[field]
        elif field in told:
            assert value == told[field]
    if read.name == "ODOMETRY":
        assert [read.fields[f"q{axis}"] for axis in "wxyz"] == [1, 0, 0, 0.5]


def test_messages_are_found_between_garbage_and_in_pieces():
    """Whatever stands between them, however they are cut, and damaged ones are counted."""
    draws = np.random.default_rng(0)
    sent, stream = 0, b""
    for number in range(300):
        good = packet("HEARTBEAT", 1, 1, number, custom_mode=number)
        kind = number % 4
        if kind == 1:
            stream += bytes(draws.integers(0, 0xFD, draws.integers(0, 40), dtype=np.uint8))
        if kind == 2:
            stream += good[:12] + bytes((good[12] ^ 1,)) + good[13:]
        stream += good
        sent += 1
    parser, found = Parser(), []
    while stream:
        size = int(draws.integers(1, 30))
        found += parser.feed(stream[:size])
        stream = stream[size:]
    assert [message.fields["custom_mode"] for message in found] == list(range(sent))
    assert parser.damaged >= 75


def test_no_bytes_of_any_kind_stop_it():
    """Nor are any but sound messages made of them; what is kept for a packet that is not whole stays small."""
    draws, parser = np.random.default_rng(1), Parser()
    for _ in range(300):
        data = draws.integers(0, 256, 400, dtype=np.uint8)
        data[draws.random(400) < 0.1] = 0xFD
        assert not parser.feed(data.tobytes())
    parser.feed(bytes(300))
    assert parser.feed(packet("HEARTBEAT", 1, 1))


def test_a_field_that_there_is_not_is_refused():
    """With those there are."""
    with pytest.raises(ValueError, match="HEARTBEAT has no mode: there are custom_mode"):
        packet("HEARTBEAT", 1, 1, mode=3)
