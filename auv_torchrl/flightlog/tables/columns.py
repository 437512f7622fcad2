"""Which columns a flight log has, and which of them can be used."""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.log import ACCELERATION, AXES, POSE, VELOCITY
from auv_torchrl.flightlog.tables.synonyms import NOT_KNOWN, NUMBERED, near
from auv_torchrl.quantities import counted
from auv_torchrl.vehicle import DEGREES_OF_FREEDOM

DEMANDS = tuple(f"cmd_{name}" for name in DEGREES_OF_FREEDOM)  # through the vehicle's mixer
KNOWN = ("t", "episode", *AXES, *DEMANDS, "battery")
_NAMED = 5  # unknown columns that a message names


class Chosen(NamedTuple):
    """The columns of a log that are used."""

    axes: tuple[str, ...]  # measured, out of AXES
    commands: tuple[str, ...]  # cmd_1 to cmd_n, or some of DEMANDS


def choose_columns(
    name: str, found: Iterable[str], thrusters: int | None, refused: Mapping[str, str] | None = None
) -> Chosen:
    """The columns of the log ``name`` that are used; all names are checked against the format and the vehicle.

    Args:
        name: of the log, for people.
        found: the columns that it has.
        thrusters: of the vehicle; None takes as many as there are commands.
        refused: by column that is not understood, why.

    Raises:
        FlightLogError: for a column that is not understood, no time, no commands or both kinds, no measured axis, or
            another number of thrusters than the vehicle has; all of these in one line.
    """
    used = tuple(found)
    numbered = _numbered(used)
    strange = [column for column in used if column not in KNOWN and column not in numbered]
    lacking = [why for why, _ in missing(used, thrusters)]
    if strange:
        lacking.append(_unknown(strange, refused or {}))
    if lacking:
        raise FlightLogError(f"{name} has {'; it has '.join(lacking)}")
    axes = tuple(axis for axis in AXES if axis in used)
    return Chosen(axes, tuple(numbered) or tuple(column for column in DEMANDS if column in used))


def missing(found: Iterable[str], thrusters: int | None) -> Iterator[tuple[str, str]]:
    """What a log with these columns has or lacks so that nothing can be diagnosed, and in one word, what."""
    used = set(found)
    numbered = _numbered(used)
    if "t" not in used:
        yield "no column t: give the time of each row in seconds", "time"
    demands = [column for column in DEMANDS if column in used]
    wanted = f"cmd_1 to cmd_{thrusters or 'n'}"
    count = thrusters or len(numbered)
    if numbered and demands:
        yield (
            f"both {numbered[0]} and {demands[0]}: keep the thruster commands, list the others under extra", "commands"
        )  # fmt: skip
    elif not numbered and not demands:
        yield f"no commands: give {wanted}, or {', '.join(DEMANDS)}", "commands"
    elif numbered and [_number(column) for column in numbered] != list(range(1, count + 1)):
        has = f", the vehicle has {counted(thrusters, 'thruster')}" if thrusters else ""
        yield f"{', '.join(numbered)}{has}: give {wanted}, or the vehicle that was flown", "commands"
    if not used & (set(AXES) - set(ACCELERATION)):
        yield f"no motion, it measures nothing: give some of {', '.join(POSE)} or of {', '.join(VELOCITY)}", "motion"


def _numbered(found: Iterable[str]) -> list[str]:
    """The commands of thrusters, in their order."""
    return sorted((column for column in found if re.fullmatch(f"cmd_{NUMBERED}", column)), key=_number)


def _number(column: str) -> int:
    return int(column.removeprefix("cmd_"))


def _unknown(strange: list[str], refused: Mapping[str, str]) -> str:
    unclear = []
    for column in strange[:_NAMED]:
        why = refused.get(column, NOT_KNOWN)
        close = near(column) if why == NOT_KNOWN else ""
        reason = f" (did you mean {close}?)" if close else f" ({why})" if why != NOT_KNOWN else ""
        unclear.append(f"{column[:40]!r}{reason}")
    more = f" and {len(strange) - _NAMED} more" if len(strange) > _NAMED else ""
    return (
        f"columns that are not known or not clear: {', '.join(unclear)}{more}: rename them, or ignore them by "
        f"{extra_of(strange)}; known are {', '.join(KNOWN)} and cmd_1, cmd_2, ..."
    )


def extra_of(columns: Iterable[str]) -> str:
    """The setting of a command line that ignores these columns."""
    names = (
        column if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", column) else "'" + column.replace("'", "\\'") + "'"
        for column in columns
    )  # fmt: skip
    return f"extra=[{','.join(names)}]"
