"""ArduPilot's JSON simulator interface, both ways, without sockets: servo packets come in, a line of JSON goes out.

Read off ArduPilot's ``libraries/SITL/SIM_JSON.cpp``. Its reader of the answer is no JSON parser: it looks for a key as
text and expects ``[`` right behind ``":``, so that :func:`answer_line` writes no space there.
"""

import math
import struct
from collections.abc import Sequence
from typing import NamedTuple

_PACKETS = {18458: struct.Struct("<HHI16H"), 29569: struct.Struct("<HHI32H")}  # by magic, each of 40 or 72 bytes
_BY_SIZE = {layout.size: (magic, layout) for magic, layout in _PACKETS.items()}
LARGEST_BYTES = max(_BY_SIZE)
FASTEST_HZ, LAST_FRAME, MOST_US = 2**16 - 1, 2**32 - 1, 2**16 - 1  # what their fields hold

NEUTRAL_US, SWING_US = 1500, 400  # us: full thrust at 1100 and 1900
# us: ArduSub's own vehicle takes only pulses between these two for commands, and so do speed controllers. It sends 0
# where an output is off, and 1000 where SIM_ENGINE_FAIL stops a motor.
PULSE_US = 1000, 2000


class Servos(NamedTuple):
    """What ArduSub sends: the step that it would like, how many answers it has accepted, and its outputs."""

    rate_hz: int
    frame: int
    pwm: tuple[int, ...]  # us, 16 or 32 outputs; 0 where one is off


class Reading(NamedTuple):
    """What the simulated vehicle measures, in ArduPilot's frames: earth NED, body FRD."""

    time_s: float  # of the physics
    gyro: Sequence[float]  # (3,) rad/s, body
    specific_force: Sequence[float]  # (3,) m/s^2, body; (0, 0, -9.81) at rest and level
    position: Sequence[float]  # (3,) m, north, east and down from home
    velocity: Sequence[float]  # (3,) m/s, north, east, down
    quaternion: Sequence[float]  # (4,) w x y z, body to earth


def parse(packet: bytes) -> Servos | None:
    """The servo packet that these bytes are; None where they are none."""
    magic, layout = _BY_SIZE.get(len(packet), (0, None))
    if layout is None:
        return None
    given, rate_hz, frame, *pwm = layout.unpack(packet)
    return Servos(rate_hz, frame, tuple(pwm)) if given == magic else None


def servo_packet(servos: Servos) -> bytes:
    """The bytes that ArduSub sends for 16 or 32 outputs: what a stand-in of the firmware needs."""
    magic, layout = _BY_SIZE[8 + 2 * len(servos.pwm)]
    return layout.pack(magic, servos.rate_hz, servos.frame, *servos.pwm)


def answer_line(reading: Reading, paced: bool = True) -> bytes:
    """The answer to a servo packet.

    Args:
        reading: after the step; Python's own floats, which are written to their last bit.
        paced: whether ArduSub may wait for the wall clock; without it flies as fast as both can.

    Raises:
        ValueError: for a number that is not finite, which ArduSub would take over into its estimates.
    """
    time_s, (p, q, r), (ax, ay, az), (x, y, z), (vn, ve, vd), (w, i, j, k) = reading
    if not math.isfinite(time_s + p + q + r + ax + ay + az + x + y + z + vn + ve + vd + w + i + j + k):
        raise ValueError(f"an answer must hold finite numbers: {reading}")
    sync = "" if paced else ',"no_time_sync":1'
    return (
        f'\n{{"timestamp":{time_s!r},"imu":{{"gyro":[{p!r},{q!r},{r!r}],"accel_body":[{ax!r},{ay!r},{az!r}]}},'
        f'"position":[{x!r},{y!r},{z!r}],"velocity":[{vn!r},{ve!r},{vd!r}],'
        f'"quaternion":[{w!r},{i!r},{j!r},{k!r}]{sync}}}\n'
    ).encode("ascii")


def commands_of(pwm: Sequence[int], outputs: Sequence[int]) -> list[float]:
    """Commands in [-1, 1], as sent, one for each thruster.

    Args:
        pwm: us, of all outputs that came.
        outputs: for each thruster the output that drives it, from 1; beyond those that came it is off.
    """
    return [_command(pwm[output - 1]) if output <= len(pwm) else 0.0 for output in outputs]


def _command(pulse_us: int) -> float:
    if not PULSE_US[0] < pulse_us < PULSE_US[1]:
        return 0.0
    return max(-1.0, min(1.0, (pulse_us - NEUTRAL_US) / SWING_US))
