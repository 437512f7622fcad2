"""The parameters of ArduSub that this program knows: what it takes them for, and what they may be.

Ranges are those of https://ardupilot.org/sub/docs/parameters.html. A parameter that is no finite number is left out
wherever parameters enter, so that nothing is compared with it or advised from it.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from enum import Enum, auto
from typing import NamedTuple

from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.quantities import counted
from auv_torchrl.text import printable

Values = Mapping[str, float]

NOT_FINITE, OUT_OF_RANGE = "parameter_not_finite", "parameter_out_of_range"  # codes
MOST_PARAMETERS = 10_000  # of a vehicle; ArduSub has some 1,500
_NAME = re.compile(r"[A-Z_][A-Z0-9_]{0,15}", re.ASCII)  # 16 bytes in MAVLink and in PARM
_LISTED = 6  # parameters that a finding names


class Use(Enum):
    """What a parameter does to a log."""

    MEANING = auto()  # changes how commands or sensors are to be read
    VALUE = auto()  # is used in reading the log, and is no fault where it differs between two flights
    OWN = auto()  # the vehicle writes it itself: counters, and what it calibrates at each start


class Parameter(NamedTuple):
    """Parameters of one kind."""

    names: str  # regular expression of all of the name
    use: Use
    low: float = -math.inf
    high: float = math.inf
    whole: bool = False  # whether only whole numbers mean something
    but: tuple[float, ...] = ()  # of the range, what means nothing
    more: tuple[float, ...] = ()  # beside the range, what means something
    unit: str = ""

    def allows(self, value: float) -> bool:
        """Whether a value is documented."""
        inside = self.low <= value <= self.high and value not in self.but and (not self.whole or value % 1 == 0)
        return inside or value in self.more

    @property
    def allowed(self) -> str:
        """The documented values in words."""
        if self.whole and self.high - self.low <= 2:
            return " or ".join(f"{v:g}" for v in range(int(self.low), int(self.high) + 1) if v not in self.but)
        more = "".join(f" or {value:g}" for value in self.more)
        unit = f" {self.unit}" if self.unit else ""
        return f"{'a whole number from ' if self.whole else ''}{self.low:g} to {self.high:g}{more}{unit}"


PARAMETERS = (
    Parameter(r"FRAME_CONFIG", Use.MEANING, 0, 7, whole=True),
    Parameter(r"MOT_\d+_DIRECTION", Use.MEANING, -1, 1, whole=True, but=(0.0,)),
    Parameter(r"MOT_PWM_(MIN|MAX)", Use.MEANING, 0, 2000, unit="us"),  # 0 takes RC3_MIN and RC3_MAX
    Parameter(r"MOT_PWM_\w+|MOT_\d*_?CPLNG\w*|MOT_FV_CPLNG_K", Use.MEANING),
    Parameter(r"SERVO\d+_FUNCTION", Use.MEANING, -1, 255, whole=True),
    Parameter(r"SERVO\d+_(MIN|MAX|TRIM)", Use.MEANING, 500, 2200, unit="us"),
    Parameter(r"SERVO\d+_REVERSED", Use.MEANING, 0, 1, whole=True),
    Parameter(r"RC3_(MIN|MAX)", Use.VALUE, 800, 2200, unit="us"),
    Parameter(r"AHRS_ORIENTATION|COMPASS_ORIENT\d?", Use.MEANING, 0, 43, whole=True, more=(100, 101, 102)),  # custom
    Parameter(r"AHRS_TRIM_[XYZ]", Use.MEANING, -0.1745, 0.1745, unit="rad"),  # 10 degrees
    Parameter(r"COMPASS_USE\d?", Use.MEANING, 0, 1, whole=True),
    Parameter(r"VISO_ORIENT", Use.MEANING, 0, 43, whole=True),
    Parameter(r"VISO_POS_[XYZ]", Use.MEANING, -5, 5, unit="m"),
    Parameter(r"BARO_PRIMARY", Use.MEANING, 0, 2, whole=True),
    Parameter(r"INS_(GYRO|ACCEL)_FILTER", Use.VALUE, 0, 256, unit="Hz"),
    Parameter(r"BARO_SPEC_GRAV", Use.VALUE, 0.95, 1.3),  # fresh water, and the Dead Sea
    Parameter(r"COMPASS_MOTCT", Use.OWN, 0, 2, whole=True),
    Parameter(r"COMPASS_MOT\d?_[XYZ]", Use.OWN, -1000, 1000, unit="mG/A"),
    Parameter(r"COMPASS_DEC|COMPASS_(OFS|DIA|ODI|MOT)\w*|INS_\w*(OFF|SCAL|TEMP|_ID)\w*", Use.OWN),
    Parameter(r"BARO\d?_(GND_PRESS|GND_TEMP|DEVID)|GND_(ABS_PRESS|TEMP)|\w*_DEV_ID\d?", Use.OWN),
    Parameter(r"STAT_\w+|MIS_TOTAL|FENCE_TOTAL|RALLY_TOTAL|SYS_NUM_RESETS|FORMAT_VERSION", Use.OWN),
)
_PATTERNS = tuple((re.compile(entry.names, re.ASCII), entry) for entry in PARAMETERS)


def parameter(name: str) -> Parameter | None:
    """The entry of a parameter; None for one that this program has no use for."""
    return next((entry for pattern, entry in _PATTERNS if pattern.fullmatch(name)), None)


def moves(name: str) -> bool:
    """Whether a parameter changes how commands or sensors are to be read."""
    entry = parameter(name)
    return entry is not None and entry.use is Use.MEANING


def is_name(name: str) -> bool:
    """Whether a text can be the name of a parameter."""
    return _NAME.fullmatch(name) is not None


def known(*sources: Values) -> dict[str, float]:
    """The parameters of several sources that are finite numbers; a later source goes before an earlier one."""
    return {
        name: float(value)
        for source in sources
        for name, value in source.items()
        if is_name(name) and math.isfinite(value)
    }


def read_parameters(file: str, given: Iterable[tuple[str, float]]) -> tuple[dict[str, float], tuple[Finding, ...]]:
    """The parameters of a file, each as it was given last, and findings about those that cannot be used.

    Args:
        file: what they were read from, for people.
        given: names and values in the order in which they were written.
    """
    found: dict[str, float] = {}
    odd: dict[str, float] = {}
    no_names: dict[str, None] = {}
    left_out = 0
    for name, value in given:
        if not is_name(name):
            no_names[name] = None
        elif not math.isfinite(value):
            odd[name] = value
        elif name in found or len(found) < MOST_PARAMETERS:
            found[name] = float(value)
        else:
            left_out += 1
        if len(no_names) + len(odd) > MOST_PARAMETERS:
            break
    return found, tuple(_unusable(file, odd, list(no_names), left_out))


def _unusable(file: str, odd: Values, no_names: list[str], left_out: int) -> Iterator[Finding]:
    if odd:
        listed = _listed([f"{name} is {value:g}" for name, value in odd.items()])
        sentence = f"parameters in {file} are no finite numbers and are left out: {listed}"
        remedy = "Set them anew on the vehicle, or give them with params="
        yield Finding(Severity.WARNING, NOT_FINITE, sentence, remedy)
    if no_names:
        listed = _listed([f"'{printable(name, 40)}'" for name in no_names])
        sentence = f"parameters in {file} have names that no parameter has and are left out: {listed}"
        yield Finding(
            Severity.WARNING, "parameter_name", sentence, "The file is damaged: copy it from the vehicle again"
        )
    if left_out:
        more = counted(left_out, "further one is", "further ones are")
        sentence = f"{file} holds more than {MOST_PARAMETERS:,} parameters; {more} left out"
        yield Finding(Severity.WARNING, "too_many_parameters", sentence)


def check_ranges(parameters: Values) -> Iterator[Finding]:
    """A finding where parameters that this program reads are outside what is documented."""
    outside = []
    for name, value in parameters.items():
        entry = parameter(name)
        if entry is not None and not entry.allows(value):
            outside.append(f"{name} is {value:g} ({entry.allowed})")
    if outside:
        sentence = f"parameters are outside of what is documented for them: {_listed(outside)}"
        yield Finding(Severity.WARNING, OUT_OF_RANGE, sentence, "Set them to what the vehicle needs")


def _listed(entries: list[str]) -> str:
    more = f" and {len(entries) - _LISTED} more" if len(entries) > _LISTED else ""
    return ", ".join(entries[:_LISTED]) + more
