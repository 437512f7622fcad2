"""What the columns of a table are called elsewhere, and what each is taken for: one table for reading and for telling.

A name is compared in small letters, with ``_`` for everything that is no letter or digit, so that ``Depth [m]`` is
``depth_m``. A unit may follow each name. A name that could mean two things is not read: :data:`UNCLEAR` says what the
column would have to be. To add a name is to add one entry to one of the two.
"""

import re
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from auv_torchrl.vehicle import DEGREES_OF_FREEDOM
from auv_torchrl.vehicle.fields import GRAVITY

CHANNELS = {
    "t": "time in s", "episode": "number of the episode",
    "x": "position north in m", "y": "position east in m", "z": "depth in m, positive down",
    "roll": "roll in rad", "pitch": "pitch in rad, nose up", "yaw": "heading in rad, clockwise from north",
    "u": "velocity forward in m/s", "v": "velocity to starboard in m/s", "w": "velocity down the body in m/s",
    "p": "roll rate in rad/s, body", "q": "pitch rate in rad/s, body", "r": "yaw rate in rad/s, body",
    "ax": "specific force forward in m/s2", "ay": "specific force to starboard in m/s2",
    "az": "specific force down the body in m/s2",
    **{f"cmd_{name}": f"demand of {name} in [-1, 1]" for name in DEGREES_OF_FREEDOM},
    "battery": "battery in V",
}  # fmt: skip
NUMBERED = "[1-9][0-9]{0,2}"  # thrusters, from 1
THRUSTER = "command of thruster {} in [-1, 1]"
COMMANDS = "commands of thrusters in [-1, 1]"
QUATERNION = "quaternion_{}"  # four of them make roll, pitch and yaw


class Way(StrEnum):
    """How the values of a column become those of its channel."""

    SCALED = "scaled"  # by the unit
    TIME = "time"  # dates, clocks, and counts since 1970 in a unit that their size tells
    HEADING = "heading"  # in degrees or radians, if the values can be one of them alone
    DEPTH = "depth"  # positive down
    PULSE = "pulse"  # of a speed controller
    QUATERNION = "quaternion"


class Unit(NamedTuple):
    """A unit as people write it behind a name."""

    names: str  # regular expression
    factor: float  # of the format's unit
    shown: str


LENGTHS = (
    Unit("m|met(?:er|re)s?", 1.0, "m"), Unit("cm", 0.01, "cm"), Unit("mm", 0.001, "mm"),
    Unit("ft|feet", 0.3048, "feet"),
)  # fmt: skip
ANGLES = (Unit("rad(?:ians?)?", 1.0, "rad"), Unit("degs?|degrees?", np.pi / 180, "degrees"))
SPEEDS = (Unit("m_s|mps", 1.0, "m/s"), Unit("cm_s", 0.01, "cm/s"), Unit("mm_s", 0.001, "mm/s"))
RATES = (
    Unit("rad_s|rads|rad_?ps", 1.0, "rad/s"), Unit("deg_s|dps|degs|deg_?ps|degrees_s", np.pi / 180, "degrees/s"),
)  # fmt: skip
ACCELERATIONS = (Unit("m_s_?2|mps2|mss", 1.0, "m/s2"), Unit("g", GRAVITY, "g"))
TIMES = (
    Unit("s|secs?|seconds?", 1.0, "s"), Unit("ms|msecs?|millis(?:econds)?", 1e-3, "ms"),
    Unit("us|usecs?|micros(?:econds)?", 1e-6, "us"), Unit("ns|nsecs?|nanos(?:econds)?", 1e-9, "ns"),
)  # fmt: skip
VOLTS = (Unit("v|volts?", 1.0, "V"), Unit("mv|millivolts?", 1e-3, "mV"))
SHARES = (Unit("pct|percent", 0.01, "per cent"),)
PULSES = (Unit("us", 1.0, "us"),)


class Synonym(NamedTuple):
    """Names that can mean one channel of the format and nothing else."""

    names: str  # regular expression of the whole name without its unit
    channel: str  # with ``{}`` for what the first group holds
    units: tuple[Unit, ...] = ()
    unit: str = ""  # of ``units``, where the name says none; empty where the name must say one
    way: Way = Way.SCALED


_AXIS = "surge|sway|heave|roll|pitch|yaw"
_COUNT = "0?([1-9][0-9]?)"  # of a thruster or an output, perhaps with a leading 0
SYNONYMS = (
    Synonym("time|time_?stamp|date_?time|elapsed(?:_time)?", "t", TIMES, "s", Way.TIME),
    Synonym("t", "t", TIMES),
    Synonym("episode(?:_(?:id|nr|no|number|index))?", "episode", (), "1"),
    Synonym("x", "x", LENGTHS), Synonym("y", "y", LENGTHS), Synonym("z", "z", LENGTHS),
    Synonym("north", "x", LENGTHS, "m"), Synonym("east", "y", LENGTHS, "m"), Synonym("down", "z", LENGTHS, "m"),
    Synonym("depth", "z", LENGTHS, "m", Way.DEPTH),
    Synonym("(roll|pitch|yaw)", "{}", ANGLES, "rad"),
    Synonym("heading|hdg", "yaw", ANGLES, "", Way.HEADING),
    Synonym("q_?([wxyz])|quat(?:ernion)?_?([wxyz])", QUATERNION, (), "", Way.QUATERNION),
    Synonym("([uvw])", "{}", SPEEDS), Synonym("([pqr])", "{}", RATES), Synonym("(a[xyz])", "{}", ACCELERATIONS),
    Synonym("battery|battery_voltage|batt(?:ery)?_?volts?|vbatt?", "battery", VOLTS, "V"),
    Synonym(f"(?:cmd|command)_?{_COUNT}", "cmd_{}", SHARES, "1"),
    Synonym(f"(?:thruster|motor)_?{_COUNT}_(?:cmd|command)", "cmd_{}", SHARES, "1"),
    Synonym(f"(?:cmd|command)_(?:thruster|motor)_?{_COUNT}", "cmd_{}", SHARES, "1"),
    Synonym(f"(?:cmd|command)_?({_AXIS})", "cmd_{}", SHARES, "1"),
    Synonym(f"({_AXIS})_(?:cmd|command)", "cmd_{}", SHARES, "1"),
    Synonym(f"(?:pwm|servo)(?:_?out(?:put)?)?_?{_COUNT}(?:_raw|_pwm)?", "cmd_{}", PULSES, "us", Way.PULSE),
    Synonym(f"(?:thruster|motor|esc|output)_?{_COUNT}_(?:pwm|raw)", "cmd_{}", PULSES, "us", Way.PULSE),
    Synonym(f"(?:thruster|motor|esc|output)_?{_COUNT}", "cmd_{}", PULSES, "", Way.PULSE),
    Synonym(f"pwm_(?:thruster|motor|esc)_?{_COUNT}", "cmd_{}", PULSES, "us", Way.PULSE),
)  # fmt: skip
_OF_CONTROLLER = "what a controller wants or works out, no measurement"
UNCLEAR = (
    (".*(?:set_?point|target|reference|desired|error).*|ref_.*", _OF_CONTROLLER),
    (".*force.*|.*thrust_.*", "a force that somebody worked out: commands are cmd_1 ... in [-1, 1], as they were sent"),
    ("alt(?:itude)?(?:_.*)?|height(?:_.*)?", "counts upwards, from the ground or the surface: z would have to be the "
     "depth in m, positive down"),
    ("z_?up|pos(?:ition)?_?z|p_?z", "up or down is not said: z would have to be the depth in m, positive down"),
    ("pos(?:ition)?_?[xy]|p_?[xy]", "the frame is not said: x and y would have to be north and east in m"),
    ("lat(?:itude)?|lon(?:g(?:itude)?)?|lng", "x and y would have to be north and east of a start, in m"),
    ("v(?:el(?:ocity)?)?_?[xyz]|vel_.*", "body or earth is not said: u, v, w would have to be velocities forward, to "
     "starboard and down the body in m/s"),
    ("(?:surge|sway|heave)(?:_(?:speed|velocity|vel))?", "u, v, w would have to be velocities forward, to starboard "
     "and down the body in m/s; demands would be cmd_surge ... in [-1, 1]"),
    ("(?:depth|climb|descent|vertical|z)_?(?:rate|speed|velocity)", "a velocity of the earth's vertical: w would have "
     "to be that down the body in m/s"),
    ("(?:roll|pitch|yaw)_?(?:rate|speed|velocity)(?:_.*)?|(?:gyro|omega|imu_gyro).*[xyz](?:_.*)?|w_?[xyz]", "axes or "
     "unit are not said: p, q, r would have to be rates about the body's axes forward, to starboard, down, in rad/s"),
    ("(?:acc|accel|acceleration|imu_acc|imu_accel)_?[xyz](?:_.*)?", "axes or gravity are not said: ax, ay, az would "
     "have to be specific forces along the body, (0, 0, -9.8) m/s2 at rest"),
    ("q(?:uat(?:ernion)?)?_?[0-4]", "the order is not said: name the quaternion qw, qx, qy, qz"),
    ("orientation_[wxyz]", "the frame is not said: qw, qx, qy, qz would have to turn the body (forward, starboard, "
     "down) into north, east, down"),
    ("(?:thruster|motor|esc|output|m|th)_?[0-9]+(?:_.*)?|rpm.*|throttle.*", "a command, a pulse, a force or a speed: "
     "cmd_1 ... would have to be commands in [-1, 1] as they were sent, pwm1 ... pulses in us"),
    ("(?:pwm|servo)(?:_?out(?:put)?)?_?0(?:_.*)?|cmd_?0", "thrusters are numbered from 1"),
    ("(?:chan|ch|rc|rcin)_?[0-9]+(?:_.*)?|(?:stick|joy).*", "a stick, not what the thrusters were sent: give cmd_1 ... "
     "in [-1, 1], or pwm1 ... in us"),
    ("press(?:ure)?(?:_.*)?", "z would have to be the depth in m, positive down: pressure above the surface over "
     "density times gravity"),
    ("p|q|r|u|v|w|x|y|z|t", "one capital letter may be a force or a temperature: the format's names are small"),
)  # fmt: skip
NOT_KNOWN = "not known"


class Match(NamedTuple):
    """What a name says."""

    channel: str
    unit: Unit | None  # None where the name says none and the values must
    way: Way


def folded(column: str) -> str:
    """A name in small letters, with ``_`` for all that is no letter or digit."""
    spelt = column.replace("°", "deg").replace("µ", "u").replace("μ", "u").replace("²", "2")
    return re.sub(r"[^a-z0-9]+", "_", spelt.lower()).strip("_")


def is_known(column: str) -> bool:
    """Whether the format has a column of this very name."""
    return column in CHANNELS or re.fullmatch(f"cmd_{NUMBERED}", column) is not None


def described(channel: str) -> str:
    """What a channel of the format is."""
    return CHANNELS.get(channel) or THRUSTER.format(channel.removeprefix("cmd_"))


def match(column: str) -> Match | None:
    """What a name that is not the format's own can only mean; None where it is not known, or not clear."""
    name = folded(column)
    for synonym in SYNONYMS:
        units = "|".join(f"(?P<unit_{i}>{unit.names})" for i, unit in enumerate(synonym.units))
        found = re.fullmatch(f"(?:{synonym.names})(?:_(?:{units}))?" if units else synonym.names, name)
        if not found:
            continue
        given = (unit for i, unit in enumerate(synonym.units) if found[f"unit_{i}"])
        usual = next((unit for unit in synonym.units if unit.shown == synonym.unit), None)
        unit = next(given, usual) or (Unit("", 1.0, "1") if synonym.unit == "1" else None)
        if unit is None and synonym.way in (Way.SCALED, Way.PULSE):
            continue  # the same name may stand for another unit, or for another quantity
        group = next((g for g in found.groups()[: _groups(synonym.names)] if g), "")
        return Match(synonym.channel.format(group), unit, synonym.way)
    return None


def unclear(column: str) -> str:
    """Why a column that is not understood is not; :data:`NOT_KNOWN` where nothing is known of its name."""
    name = folded(column)
    return next((why for pattern, why in UNCLEAR if re.fullmatch(pattern, name)), NOT_KNOWN)


def _groups(pattern: str) -> int:
    return re.compile(pattern).groups


def near(column: str) -> str:
    """A name of the format of which this one is a slip of the pen; empty where it may be another thing.

    A slip is a letter doubled or exchanged with the next one, a plural, and in a long name one letter wrong, missing
    or too many: "pith" is no pitch. It never touches a digit, and names of up to three letters have none.
    """
    name = folded(column)
    return next((other for other in _SPELT if len(other) > 3 and _is_slip(name, other)), "")


_SPELT = (*CHANNELS, "time", "timestamp", "depth", "heading")
_LONG = 8  # letters from which a wrong one is a slip: "reading" is no "heading"


def _is_slip(name: str, other: str) -> bool:
    if re.sub("[^0-9]", "", name) != re.sub("[^0-9]", "", other) or name[:1] != other[:1]:
        return False
    long = len(other) >= _LONG
    for i in range(len(other)):
        swapped = other[:i] + other[i + 1 : i + 2] + other[i] + other[i + 2 :]
        if name in (swapped, other[: i + 1] + other[i:], f"{other}s"):
            return True
        if long and re.fullmatch(f"{re.escape(other[:i])}[a-z]?{re.escape(other[i + 1 :])}", name):
            return True
        if long and len(name) == len(other) + 1 and name[:i] + name[i + 1 :] == other:
            return True
    return False
