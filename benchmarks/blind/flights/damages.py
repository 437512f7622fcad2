"""What can be wrong with a log while its vehicle is what it was: damages of the raw columns that a file holds.

A damage changes columns as they are logged and says by which names an answer tells of it: codes of findings, or
effects. Columns are arrays (T,) by name: ``episode``, ``t`` in s since the start of the episode, measured axes in SI
units, commands. Each damage is drawn at random and gives the new columns, and the names of those that are not true any
more; the columns that it gets stay as they are.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from auv_torchrl.flightlog import POSE, VELOCITY
from auv_torchrl.physics.kinematics import wrap_angle

Rng = np.random.Generator
Columns = dict[str, np.ndarray]
Damaged = tuple[Columns, tuple[str, ...]]  # the columns of the file, and the names of those that are not true
Act = Callable[[Columns, Rng], Damaged]

VELOCITIES = ("u", "v", "w", "r")
STANDSTILL_S = (5.0, 20.0)  # how long a column stands still
EDGE_S = 2.0  # nothing begins or ends so close to the ends of an episode
SPIKE = {"x": 0.2, "y": 0.2, "z": 0.2, "yaw": 0.5}  # m and rad
SPIKED, REPEATED = 0.01, 0.1  # shares of the rows
JUMP, COARSE = 0.1, 0.01  # m
SLOW_ROWS = 4  # 5 Hz in a log of 20 Hz


def constant(*names: str, value: float | None = None) -> Act:
    """Columns that hold their first value, or one that is given, all along; no name stands for all measurements."""

    def act(columns: Columns, rng: Rng) -> Damaged:
        still = names or _measured(columns)
        hold = {name: np.full_like(columns[name], columns[name][0] if value is None else value) for name in still}
        return {**columns, **hold}, still

    return act


def frozen(*names: str) -> Act:
    """One of the columns stands still for a while within an episode."""

    def act(columns: Columns, rng: Rng) -> Damaged:
        name = str(rng.choice(names))
        rows = _rows_of_an_episode(columns, rng)
        t = columns["t"][rows]
        room = max(t[-1] - t[0] - 2 * EDGE_S, 0.0)
        length = min(rng.uniform(*STANDSTILL_S), room)
        begin = t[0] + EDGE_S + rng.uniform(0.0, 1.0) * (room - length)
        still = rows[(t >= begin) & (t <= begin + length)]
        return _changed(columns, name, still, columns[name][still[:1]]), (name,)

    return act


def turned(*angles: float) -> Act:
    """The heading is off by one of the angles in rad."""

    def act(columns: Columns, rng: Rng) -> Damaged:
        return {**columns, "yaw": np.asarray(wrap_angle(columns["yaw"] + rng.choice(angles)))}, ("yaw",)

    return act


def times(names: tuple[str, ...], factor: float) -> Act:
    """Columns in another unit, or of the other sign."""

    def act(columns: Columns, rng: Rng) -> Damaged:
        return {**columns, **{name: factor * columns[name] for name in names}}, names

    return act


def spikes(columns: Columns, rng: Rng) -> Damaged:
    """Single values of one column are far off."""
    name = str(rng.choice(list(SPIKE)))
    count = len(columns["t"])
    rows = rng.choice(count, max(1, round(SPIKED * count)), replace=False)
    spiked = columns[name][rows] + SPIKE[name] * rng.choice((-1.0, 1.0), len(rows))
    return _changed(columns, name, rows, np.asarray(wrap_angle(spiked)) if name == "yaw" else spiked), (name,)


def repeats(columns: Columns, rng: Rng) -> Damaged:
    """Rows repeat all measurements of the row before."""
    return _held(columns, _latest(_begins(columns) | (rng.random(len(columns["t"])) >= REPEATED)), _measured(columns))


def slow_sensor(columns: Columns, rng: Rng) -> Damaged:
    """All measurements come at a lower rate than the rows and are held in between."""
    index, first = np.arange(len(columns["t"])), _latest(_begins(columns))
    return _held(columns, index - (index - first) % SLOW_ROWS, _measured(columns))


def jump(columns: Columns, rng: Rng) -> Damaged:
    """From one moment within an episode on, a position is off by a constant."""
    name = str(rng.choice(("x", "y", "z")))
    rows = _rows_of_an_episode(columns, rng)
    begin = rows[int(rng.uniform(0.2, 0.8) * len(rows))]
    after = np.arange(begin, len(columns["t"]))
    return _changed(columns, name, after, columns[name][after] + JUMP * rng.choice((-1.0, 1.0))), (name,)


def coarse(columns: Columns, rng: Rng) -> Damaged:
    """Positions are rounded."""
    names = ("x", "y", "z")
    return {**columns, **{name: COARSE * np.round(columns[name] / COARSE) for name in names}}, names


def one_sided(columns: Columns, rng: Rng) -> Damaged:
    """Commands are logged from 0 to 1, with rest at 0.5."""
    names = tuple(name for name in columns if name.startswith("cmd_"))
    return {**columns, **{name: (columns[name] + 1) / 2 for name in names}}, names


def scaled_velocity(columns: Columns, rng: Rng) -> Damaged:
    """Velocities are far too small or far too large."""
    factor = float(rng.choice((rng.uniform(0.4, 0.7), rng.uniform(1.4, 2.5))))
    return times(("u", "v", "w"), factor)(columns, rng)


def late_velocity(columns: Columns, rng: Rng) -> Damaged:
    """Velocities lag behind the pose."""
    index, first = np.arange(len(columns["t"])), _latest(_begins(columns))
    step = float(np.median(np.diff(columns["t"])))
    return _held(columns, np.maximum(index - round(rng.uniform(0.3, 0.6) / step), first), VELOCITIES)


def nothing(columns: Columns, rng: Rng) -> Damaged:
    """The columns as they are."""
    return dict(columns), ()


def _measured(columns: Columns) -> tuple[str, ...]:
    return tuple(name for name in POSE + VELOCITY if name in columns)


def _changed(columns: Columns, name: str, rows: np.ndarray, values: np.ndarray | float) -> Columns:
    column = columns[name].copy()
    column[rows] = values
    return {**columns, name: column}


def _rows_of_an_episode(columns: Columns, rng: Rng) -> np.ndarray:
    number = columns["episode"]
    return np.flatnonzero(number == rng.choice(np.unique(number)))


def _begins(columns: Columns) -> np.ndarray:
    """Whether a row is the first of its episode, (T,), bool."""
    return np.concatenate(([True], np.diff(columns["episode"]) != 0))


def _latest(true: np.ndarray) -> np.ndarray:
    """The last row up to each at which something was true, (T,); 0 before."""
    return np.maximum.accumulate(np.where(true, np.arange(len(true)), 0))


def _held(columns: Columns, source: np.ndarray, names: tuple[str, ...]) -> Damaged:
    """Columns of which each row has what stands in its source row."""
    return {**columns, **{name: columns[name][source] for name in names}}, names


POSES = ("x", "y", "z", "yaw")
BOTH = POSES + VELOCITIES
HEAVE, HORIZONTAL = "heave", "horizontal"  # where a fault can show
ALL = frozenset((HEAVE, HORIZONTAL))
FOOT, CENTIMETRE, KNOT = 0.3048, 0.01, 0.514444  # m, m, m/s


@dataclass(frozen=True)
class Damage:
    """One way to damage a log, and how an answer names it."""

    name: str
    act: Act  # gives new columns, those it gets stay
    codes: tuple[str, ...]  # of findings, one of which names it,
    effects: tuple[str, ...] = ()  # as does one of these effects
    partly: tuple[str, ...] = ()  # effects that are no wrong cause beside what names it, such as "thruster_gain 5 6"
    mentions: bool = False  # the findings must mention every damaged column
    hides: frozenset[str] = frozenset()  # where a fault shows no more in what is left of the log
    axes: tuple[str, ...] = POSES  # what is flown with it
    healthy: bool = False  # the fault is in the healthy log too


def shows_fault(damage: Damage, fault: str, values: dict[str, float]) -> bool:
    """Whether the rest of a damaged log still shows a fault of these values."""
    if fault == "thruster_gain":
        vertical = all(values.get(f"gain_{i}", 1.0) == 1.0 for i in range(1, 5))
        shows = {HEAVE} if vertical else {HORIZONTAL}
    else:
        shows = FAULTS[fault]
    return not shows <= damage.hides


def can_show(damage: Damage, fault: str) -> bool:
    """Whether there is a size of the fault that shows beside the damage."""
    return not FAULTS[fault] <= damage.hides


def damaged(columns: Columns, damage: Damage, rng: Rng) -> Damaged:
    """The columns with the damage, and the names of those that it changed.

    Raises:
        ValueError: for a log that lacks a column that the damage needs.
    """
    if missing := set(damage.axes) - set(columns):
        raise ValueError(f"{damage.name} needs {', '.join(sorted(missing))}: the log has {', '.join(columns)}")
    return damage.act(columns, rng)


FAULTS = {  # of the library that stay visible beside a damage, and where
    "thruster_gain": {HEAVE, HORIZONTAL},  # wherever the thruster pushes
    "thruster_swap": {HORIZONTAL},
    "current": {HORIZONTAL},
    "buoyancy": {HEAVE},
    "payload": {HEAVE},
    "command_delay": {HEAVE, HORIZONTAL},
}


_ONLY_HEAVE, _ONLY_HORIZONTAL = frozenset((HEAVE,)), frozenset((HORIZONTAL,))
_DISAGREE = ("pose_velocity_disagree",)
_LATE = ("pose_delay", "command_delay")  # held values are older than their rows

DAMAGES = {
    damage.name: damage
    for damage in (
        Damage("depth_zero", constant("z", value=0.0), ("constant_column",), ("depth_scale",),
               mentions=True, hides=_ONLY_HEAVE),
        Damage("depth_constant", constant("z"), ("constant_column",), ("depth_scale",),
               mentions=True, hides=_ONLY_HEAVE),
        Damage("depth_frozen", frozen("z"), ("frozen",), mentions=True),
        Damage("column_frozen", frozen("x", "y", "yaw"), ("frozen",), mentions=True),
        Damage("all_constant", constant(), ("constant_column", "frozen"), mentions=True, hides=ALL),
        Damage("horizontal_zero", constant("x", "y", value=0.0), ("constant_column",), mentions=True,
               hides=_ONLY_HORIZONTAL),
        Damage("heading_backwards", turned(np.pi), ("heading_offset",), ("heading_bias",)),
        Damage("heading_quarter", turned(-np.pi / 2, np.pi / 2), ("heading_offset",), ("heading_bias",)),
        Damage("feet", times(("x", "y", "z"), 1 / FOOT), ("length_unit",), ("position_scale",), ("depth_scale",),
               hides=ALL),
        Damage("centimetres", times(("x", "y", "z"), 1 / CENTIMETRE), ("length_unit",), ("position_scale",),
               ("depth_scale",), hides=ALL),
        Damage("knots", times(("u", "v", "w"), 1 / KNOT), ("speed_unit",), ("velocity_scale",), hides=ALL,
               axes=VELOCITIES),
        Damage("clock_doubled", times(("t",), 2.0), ("time_unit",), ("clock_scale",), hides=ALL),
        Damage("clock_halved", times(("t",), 0.5), ("time_unit",), ("clock_scale",), hides=ALL),
        # Where z alone is negated, no log of poses can tell it from two reversed vertical thrusters.
        Damage("z_up", times(("z",), -1.0), ("z_up", "z_up_or_reversed", "wrong_frame"), ("depth_scale",),
               ("thruster_gain 5 6",), hides=_ONLY_HEAVE),
        Damage("spikes", spikes, ("outliers", "position_spike"), mentions=True),
        Damage("held_samples", repeats, ("held_samples",), (), _LATE),
        Damage("slow_sensor", slow_sensor, ("held_samples",), (), _LATE),
        Damage("jump", jump, ("jump", "position_jump"), mentions=True),
        Damage("coarse", coarse, ("coarse",), mentions=True),
        Damage("commands_one_sided", one_sided, ("one_sided_commands",), hides=ALL),
        Damage("velocity_negated", times(VELOCITIES, -1.0), (*_DISAGREE, "wrong_frame"), ("velocity_scale",),
               hides=ALL, axes=BOTH),
        Damage("velocity_scaled", scaled_velocity, (*_DISAGREE, "speed_unit"), ("velocity_scale",), hides=ALL,
               axes=BOTH),
        Damage("velocity_late", late_velocity, _DISAGREE, hides=ALL, axes=BOTH),
        Damage("healthy_with_fault", nothing, ("healthy_not_healthy",), hides=ALL, healthy=True),
    )
}  # fmt: skip
