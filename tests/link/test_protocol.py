"""Servo packets and answers, as ArduPilot's JSON interface has them."""

import json
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from auv_torchrl.link.protocol import Reading, Servos, answer_line, commands_of, parse, servo_packet
from tests.link.firmware import read_answer

PWM = [1100 + 50 * n for n in range(16)]
FINITE = st.floats(-1e9, 1e9)
VECTOR = st.tuples(FINITE, FINITE, FINITE)
READING = Reading(1.25, (0.1, 0.2, 0.3), (0.0, 0.0, -9.81), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (1.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(("magic", "outputs", "size"), [(18458, 16, 40), (29569, 32, 72)])
def test_a_servo_packet_is_read_as_ardupilot_lays_it_out(magic, outputs, size):
    """Little endian and packed: magic, rate, frame, then the outputs."""
    pwm = (PWM * 2)[:outputs]
    packet = struct.pack("<HHI", magic, 400, 70_000) + b"".join(struct.pack("<H", pulse) for pulse in pwm)
    assert len(packet) == size
    assert parse(packet) == Servos(400, 70_000, tuple(pwm))
    assert servo_packet(Servos(400, 70_000, tuple(pwm))) == packet


@pytest.mark.parametrize(
    "packet",
    [
        b"",
        b"\n{}\n",
        struct.pack("<HHI16H", 18459, 400, 1, *PWM),
        struct.pack(">HHI16H", 18458, 400, 1, *PWM),
        struct.pack("<HHI16H", 29569, 400, 1, *PWM),
        struct.pack("<HHI32H", 18458, 400, 1, *PWM, *PWM),
        struct.pack("<HHI16H", 18458, 400, 1, *PWM)[:-1],
        struct.pack("<HHI16H", 18458, 400, 1, *PWM) + b"\0",
    ],
    ids=["nothing", "text", "magic", "big endian", "other magic, 16", "other magic, 32", "short", "long"],
)
def test_anything_else_is_no_packet(packet):
    """Neither another magic nor another length, nor the magic of the other length."""
    assert parse(packet) is None


@given(st.binary(max_size=80))
def test_no_bytes_are_an_error(packet):
    """What is none is None."""
    servos = parse(packet)
    assert servos is None or servo_packet(servos) == packet


def test_the_answer_is_the_line_that_ardupilot_looks_for():
    """In newlines, without a space before a list, and JSON for everybody else."""
    line = answer_line(READING)
    assert line == (
        b'\n{"timestamp":1.25,"imu":{"gyro":[0.1,0.2,0.3],"accel_body":[0.0,0.0,-9.81]},"position":[1.0,2.0,3.0],'
        b'"velocity":[4.0,5.0,6.0],"quaternion":[1.0,0.0,0.0,0.0]}\n'
    )
    assert json.loads(line)["imu"]["accel_body"] == [0.0, 0.0, -9.81]
    assert json.loads(answer_line(READING, paced=False))["no_time_sync"] == 1


@given(st.tuples(st.floats(0, 1e7), VECTOR, VECTOR, VECTOR, VECTOR, st.tuples(FINITE, FINITE, FINITE, FINITE)))
def test_every_number_of_an_answer_is_read_back_to_its_last_bit(numbers):
    """By a reader that looks for text, as ArduPilot does."""
    assert read_answer(answer_line(Reading(*numbers))) == numbers


@pytest.mark.parametrize("wrong", [float("nan"), float("inf"), -float("inf")])
def test_a_number_that_is_none_is_never_answered(wrong):
    """ArduSub would take it into its estimates."""
    with pytest.raises(ValueError, match="finite"):
        answer_line(READING._replace(velocity=(0.0, wrong, 0.0)))


@pytest.mark.parametrize(
    ("pulse", "command"),
    [(1500, 0.0), (1900, 1.0), (1100, -1.0), (1600, 0.25), (1950, 1.0), (1001, -1.0), (1999, 1.0),
     (0, 0.0), (1000, 0.0), (2000, 0.0), (65535, 0.0), (1, 0.0)],
)  # fmt: skip
def test_a_pulse_is_a_command_and_no_pulse_is_none(pulse, command):
    """Full thrust at 1100 and 1900; an output that is off, or no speed controller would obey, is neutral."""
    assert commands_of([pulse], [1]) == [command]


def test_thrusters_take_the_outputs_that_drive_them():
    """One that has not come stands still."""
    assert commands_of([1500, 1600, 1700], [3, 1, 2, 4]) == [0.5, 0.0, 0.25, 0.0]
