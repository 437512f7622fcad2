"""How a log is damaged: functions that take the raw columns of a log and give new ones.

Columns are arrays (T,) by name: ``episode``, ``t`` in s since the start of the episode, measured axes in SI units,
commands. Each damage is drawn at random and gives the new columns, and the names of those that are not true any more;
the columns that it gets stay as they are.
"""

from collections.abc import Callable

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
