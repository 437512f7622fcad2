"""A table as people have it in the columns of the format: what each column is taken for, or why it is not.

Each assumption is a finding. What two columns say of one channel must agree, and what could be read in two ways is not
read: the column stays as it is, with the reason.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.log import ANGLES, Floats
from auv_torchrl.flightlog.streams.attitude import euler_angles
from auv_torchrl.flightlog.streams.motors import NEUTRAL, commands_of_pulses, listed
from auv_torchrl.flightlog.tables.cells import NUMBER
from auv_torchrl.flightlog.tables.synonyms import (
    CHANNELS,
    COMMANDS,
    QUATERNION,
    Match,
    Unit,
    Way,
    described,
    is_known,
    match,
    unclear,
)
from auv_torchrl.flightlog.tables.table import Table
from auv_torchrl.physics.kinematics import wrap_angle

PULSE_LOW, PULSE_HIGH = 1100.0, 1900.0  # us, full command backwards and forwards, as ArduSub has them unless told
_BEYOND = 25.0  # us by which trims go further
_PULSES = (700.0, 2300.0)  # us: what speed controllers are sent at all
_MOST_ODD = 0.01  # share of the rows that may be glitches
_EPOCH = (1e9, 4.2e9)  # s since 1970: 2001 to 2103; in the other units the ranges do not meet
_EPOCH_UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}  # per second
_ABOVE = 0.2  # m that a depth gauge may show above the surface
_AGREES = 0.02  # of the spread of a column, by which another one of the same may differ through rounding and delay
_LEAST = 1e-6  # of any unit: columns of one value
_FULL_TURN = 360.5  # degrees and rounding
_TURNED = 6 * np.pi  # a heading beyond this has turned three times in radians; in degrees it is any heading
_WRAP, _ROUNDING = 0.5, 0.01  # rad: between samples, and of writing


class Unclear(ValueError):
    """Values of a column that cannot be what its name says, or can be it in two ways."""


@dataclass(frozen=True)
class Taken:
    """Columns of a file and the channels for which they are taken together; none where they are not used."""

    columns: tuple[str, ...]
    channels: tuple[str, ...]
    how: str  # they are given, or why they are not used
    assumed: bool = True  # False where the name is the format's own
    refused: bool = False  # a column that nobody understands, so that the log is not read with it

    @property
    def sentence(self) -> str:
        """What they are taken for, or why they are not."""
        numbered = len(self.channels) > 1 and all(channel not in CHANNELS for channel in self.channels)
        meant = (COMMANDS,) if numbered else map(described, self.channels)
        return ", ".join(filter(None, (*meant, self.how)))

    def __str__(self) -> str:
        verb = "is" if len(self.columns) == 1 else "are"
        if not self.channels:
            return f"{listed(self.columns)} {verb} left out: {self.how}"
        return f"{listed(self.columns)} {verb} taken for {listed(self.channels)}: {self.sentence}"


@dataclass(frozen=True)
class Understood:
    """A table in the columns of the format, with those that are not understood as they were."""

    table: Table
    taken: tuple[Taken, ...]
    settled: frozenset[str]  # channels whose unit the name of the column says

    @property
    def refused(self) -> Mapping[str, str]:
        """By column that is not understood, why."""
        return {column: taken.how for taken in self.taken if taken.refused for column in taken.columns}


def understand(table: Table) -> Understood:
    """What every column of a table is taken for; columns that a name or their values leave open stay as they are."""
    work = _Work(table)
    own = [column for column in table.columns if is_known(column)]
    for column in own:
        work.keep(column)
    found = {column: match(column) for column in table.columns if column not in own}
    for column, meant in found.items():
        if meant is None:
            work.refuse(column, unclear(column))
        elif meant.way is not Way.QUATERNION:
            work.take(column, meant)
    work.turn({meant.channel: column for column, meant in found.items() if meant and meant.way is Way.QUATERNION})
    return work.done()


class _Work:
    """Collects the columns of the format, from one table."""

    def __init__(self, table: Table) -> None:
        self.table = table
        self.columns: dict[str, Floats] = {}
        self.origin: dict[str, str] = {}  # by channel
        self.taken: list[Taken] = []
        self.settled: set[str] = set()

    def keep(self, column: str) -> None:
        """Take a column that has the format's own name; of a time, dates and size may tell the unit."""
        values, how = self.table.columns[column], ""
        if column == "t" and not self.table.units_known:
            values, how = _seconds(values, self.table.written.get(column, NUMBER), None)
        self.columns[column], self.origin[column] = values, column
        self.taken.append(Taken((column,), (column,), how, assumed=bool(how)))

    def refuse(self, column: str, why: str) -> None:
        """Leave a column as it is, with the reason."""
        self.columns[column] = self.table.columns[column]
        self.taken.append(Taken((column,), (), why, refused=True))

    def take(self, column: str, meant: Match) -> None:
        """Take a column for what its name means, if its values can be that."""
        values = self.table.columns[column]
        if meant.way is Way.PULSE and not np.nan_to_num(values).any():
            self.taken.append(Taken((column,), (), "an output that is off all along"))
            return
        try:
            values, how = _CONVERSIONS[meant.way](values, self.table.written.get(column, NUMBER), meant.unit)
        except Unclear as error:
            self.refuse(column, str(error))
            return
        self._store((column,), {meant.channel: values}, how, meant.unit is not None)

    def turn(self, parts: Mapping[str, str]) -> None:
        """Make roll, pitch and yaw of the four columns of a quaternion."""
        if not parts:
            return
        names = tuple(parts[key] for axis in "wxyz" if (key := QUATERNION.format(axis)) in parts)
        quaternion = np.stack([self.table.columns[column] for column in names], axis=-1)
        there = np.isfinite(quaternion).all(-1)
        if len(names) < 4:
            why = "a quaternion needs four columns, qw, qx, qy, qz"
        elif not there.any() or np.isnan(angles := euler_angles(quaternion))[there].any(-1).mean() > _MOST_ODD:
            why = "no quaternion, its length is not 1"
        else:
            how = "of the quaternion that turns the body (forward, starboard, down) into north, east, down"
            self._store(names, dict(zip(ANGLES, angles.T, strict=True)), how, True)
            return
        for column in names:
            self.refuse(column, why)

    def done(self) -> Understood:
        """The table with the columns that are understood in the format's names."""
        order = {column: place for place, column in enumerate(self.table.columns)}
        taken = _grouped(sorted(self.taken, key=lambda entry: order[entry.columns[0]]))
        added = [
            Finding(Severity.INFO, "column_taken", str(entry), "", entry.columns)
            for entry in taken if entry.assumed and not entry.refused
        ]  # fmt: skip
        table = replace(self.table, columns=self.columns, findings=(*self.table.findings, *added))
        return Understood(table, taken, frozenset(self.settled))

    def _store(self, columns: tuple[str, ...], values: dict[str, Floats], how: str, settled: bool) -> None:
        """Take columns for channels that nothing else gives; what does must say the same."""
        others = {channel: self.origin[channel] for channel in values if channel in self.origin}
        if not all(_agree(channel, self.columns[channel], values[channel]) for channel in others):
            for column in columns:
                both = ", ".join(others)
                why = f"{both} too, beside {', '.join(dict.fromkeys(others.values()))}, and says otherwise: keep one"
                self.refuse(column, why)
            return
        new = {channel: column for channel, column in values.items() if channel not in others}
        if not new:
            same = ", ".join(dict.fromkeys(others.values()))
            self.taken.append(Taken(columns, (), f"says the same as {same}"))
            return
        self.columns.update(new)
        self.origin.update(dict.fromkeys(new, ", ".join(columns)))
        self.settled |= set(new) if settled else set()
        self.taken.append(Taken(columns, tuple(new), how))


def _grouped(taken: Iterable[Taken]) -> tuple[Taken, ...]:
    """Columns that are numbered and given in the same way, or refused for the same reason, together."""
    groups: dict[object, list[Taken]] = {}
    for number, entry in enumerate(taken):
        thruster = len(entry.channels) == 1 and entry.channels[0] not in CHANNELS
        kind = re.sub("[0-9]+", "", entry.columns[0]) if entry.refused else ""
        groups.setdefault((entry.how, entry.assumed, kind) if thruster or kind else number, []).append(entry)
    return tuple(
        replace(
            group[0],
            columns=tuple(column for entry in group for column in entry.columns),
            channels=tuple(channel for entry in group for channel in entry.channels),
        )
        for group in groups.values()
    )


def _agree(channel: str, one: Floats, other: Floats) -> bool:
    """Whether two columns say the same, apart from rounding; of clocks, apart from when they begin."""
    apart = one - other
    if channel in ANGLES:
        apart = wrap_angle(apart)
    if channel == "t" and np.isfinite(apart).any():
        apart = apart - np.nanmedian(apart)
    both = np.isfinite(apart)
    return not both.any() or float(np.sqrt((apart[both] ** 2).mean())) <= _AGREES * float(np.std(one[both])) + _LEAST


def _scaled(values: Floats, written: str, unit: Unit | None) -> tuple[Floats, str]:
    factor = unit.factor if unit else 1.0
    return values * factor, f"given in {unit.shown}" if unit and factor != 1.0 else ""


def _seconds(values: Floats, written: str, unit: Unit | None) -> tuple[Floats, str]:
    """Seconds of dates and clocks, of counts in a unit that is named, or since 1970 in one that their size tells."""
    if written != NUMBER:
        return values, f"given as a {written}"
    if unit is not None and unit.factor != 1.0:
        return values * unit.factor, f"given in {unit.shown}"
    first = next(iter(values[np.isfinite(values)]), 0.0)
    for name, per_second in _EPOCH_UNITS.items():
        if _EPOCH[0] * per_second <= first <= _EPOCH[1] * per_second:
            return values / per_second, f"counted in {name} since 1970"
    return values, ""


def _heading(values: Floats, written: str, unit: Unit | None) -> tuple[Floats, str]:
    """A heading whose unit the name says, or that can be in one unit alone.

    Raises:
        Unclear: if it can be in both.
    """
    if unit is not None:
        return _scaled(values, written, unit)
    size, jump = np.nanmax(np.abs(values), initial=0.0), np.nanmax(np.abs(np.diff(values)), initial=0.0)
    if _TURNED < size < _FULL_TURN:
        return values * np.pi / 180, "given in degrees, as its size shows"
    if size < 2 * np.pi + _ROUNDING and jump > 2 * np.pi - _WRAP:
        return values, "given in rad, as its turns from one end to the other show"
    raise Unclear("degrees or radians cannot be told: name it heading_deg or heading_rad")


def _depth(values: Floats, written: str, unit: Unit | None) -> tuple[Floats, str]:
    """A depth in metres, positive down.

    Raises:
        Unclear: if it is above the surface most of the time.
    """
    if np.nanmedian(values) < -_ABOVE if np.isfinite(values).any() else False:
        raise Unclear("is below 0 as a height is: give the depth, positive down")
    return _scaled(values, written, unit)


def _pulses(values: Floats, written: str, unit: Unit | None) -> tuple[Floats, str]:
    """Commands of pulses in us.

    Raises:
        Unclear: if these are no pulses, or none of the usual range.
    """
    pulses = values[np.isfinite(values) & (values != 0)]
    low, high = float(pulses.min()), float(pulses.max())
    if ((pulses < _PULSES[0]) | (pulses > _PULSES[1])).mean() > _MOST_ODD:
        raise Unclear(f"lies in [{low:g}, {high:g}]: pulses in us are near 1500; commands in [-1, 1] are called cmd_n")
    beyond = (pulses < PULSE_LOW - _BEYOND) | (pulses > PULSE_HIGH + _BEYOND)
    if beyond.mean() > _MOST_ODD:
        raise Unclear(
            f"lies in [{low:g}, {high:g}] us: full command is taken to be {PULSE_LOW:g} and {PULSE_HIGH:g} us; give "
            "cmd_n = (pulse - 1500) / the way to full command"
        )
    how = f"of pulses in us, {NEUTRAL:g} at rest, {PULSE_LOW:g} and {PULSE_HIGH:g} in full"
    return commands_of_pulses(values, PULSE_LOW, PULSE_HIGH), how


_CONVERSIONS: dict[Way, Callable[[Floats, str, Unit | None], tuple[Floats, str]]] = {
    Way.SCALED: _scaled, Way.TIME: _seconds, Way.HEADING: _heading, Way.DEPTH: _depth, Way.PULSE: _pulses,
}  # fmt: skip
