"""Which columns a flight log has, and which of them can be used."""

import difflib
import re
from collections.abc import Iterable

from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.log import ACCELERATION, AXES, POSE, VELOCITY
from auv_torchrl.vehicle import DEGREES_OF_FREEDOM

DEMANDS = tuple(f"cmd_{name}" for name in DEGREES_OF_FREEDOM)  # through the vehicle's mixer
KNOWN = ("t", "episode", *AXES, *DEMANDS, "battery")


def choose_columns(name: str, found: Iterable[str], thrusters: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The measured axes, out of AXES, and the commands, cmd_1 to cmd_n or some of DEMANDS, of the log ``name``.

    All names are checked against the format and the vehicle.

    Raises:
        FlightLogError: for an unknown column, no time, no commands or both kinds, no measured axis,
            or another number of thrusters than the vehicle has.
    """
    used = tuple(found)
    numbered = sorted((column for column in used if re.fullmatch(r"cmd_[1-9]\d{0,2}", column)), key=_number)
    if unknown := [column for column in used if column not in KNOWN and column not in numbered]:
        raise FlightLogError(_unknown(name, unknown))
    if "t" not in used:
        raise FlightLogError(f"{name} has no column t: give the time of each row in seconds")
    demands = tuple(column for column in DEMANDS if column in used)
    if numbered and demands:
        raise FlightLogError(
            f"{name} has both {numbered[0]} and {demands[0]}: keep the thruster commands, list the others under extra"
        )
    if not numbered and not demands:
        raise FlightLogError(f"{name} has no commands: give cmd_1 to cmd_{thrusters}, or {', '.join(DEMANDS)}")
    if numbered and [_number(column) for column in numbered] != list(range(1, thrusters + 1)):
        raise FlightLogError(
            f"{name} has {', '.join(numbered)}, the vehicle has {thrusters} thrusters: give cmd_1 to cmd_{thrusters}, "
            "or the vehicle that was flown"
        )
    axes = tuple(axis for axis in AXES if axis in used)
    if not set(axes) - set(ACCELERATION):
        raise FlightLogError(f"{name} measures nothing: give some of {', '.join(POSE)} or of {', '.join(VELOCITY)}")
    return axes, tuple(numbered) or demands


def _number(column: str) -> int:
    return int(column.removeprefix("cmd_"))


def _unknown(name: str, unknown: list[str]) -> str:
    hints = []
    for column in unknown[:5]:
        close = difflib.get_close_matches(column, KNOWN, n=1)
        hints.append(f"{column[:40]!r}" + (f" (did you mean {close[0]}?)" if close else ""))
    more = f" and {len(unknown) - 5} more" if len(unknown) > 5 else ""
    return (
        f"{name} has unknown columns {', '.join(hints)}{more}: rename them, or list those to ignore under extra; "
        f"known are {', '.join(KNOWN)} and cmd_1, cmd_2, ..."
    )
