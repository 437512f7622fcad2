"""Edits of the raw columns of a log that nobody should make and somebody will."""

from collections.abc import Callable

import numpy as np

Columns = dict[str, np.ndarray]
Rng = np.random.Generator
EXTREME = (0.0, 1e-300, 1e18, -1e18, 1e17, 1e6, 1e300, np.inf, -np.inf, np.nan)


def _some(columns: Columns, rng: Rng) -> list[str]:
    names = [name for name in columns if name != "episode"]
    return [str(name) for name in rng.choice(names, rng.integers(1, len(names) + 1), replace=False)]


def _stretch(columns: Columns, rng: Rng) -> slice:
    begin, end = np.sort(rng.integers(0, len(columns["t"]) + 1, 2))
    return slice(int(begin), int(end))


def _put(columns: Columns, names: list[str], rows, values) -> Columns:
    changed = dict(columns)
    for name in names:
        column = columns[name].astype(float)
        column[rows] = values(column[rows]) if callable(values) else values
        changed[name] = column
    return changed


def _rows(columns: Columns, index) -> Columns:
    return {name: values[index] for name, values in columns.items()}


def nan_block(columns: Columns, rng: Rng) -> Columns:
    return _put(columns, _some(columns, rng), _stretch(columns, rng), np.nan)


def scattered_nan(columns: Columns, rng: Rng) -> Columns:
    return _put(columns, _some(columns, rng), rng.random(len(columns["t"])) < rng.uniform(0, 0.8), np.nan)


def extreme_numbers(columns: Columns, rng: Rng) -> Columns:
    return _put(columns, _some(columns, rng)[:2], rng.random(len(columns["t"])) < rng.choice((0.01, 0.2, 1.0)),
                float(rng.choice(EXTREME)))  # fmt: skip


def time_repeated(columns: Columns, rng: Rng) -> Columns:
    return _put(columns, ["t"], _stretch(columns, rng), lambda t: np.round(t, int(rng.integers(0, 3))))


def time_reversed(columns: Columns, rng: Rng) -> Columns:
    return _put(columns, ["t"], _stretch(columns, rng), lambda t: t[::-1])


def time_far_away(columns: Columns, rng: Rng) -> Columns:
    return {**columns, "t": columns["t"] * rng.choice((1.0, 0.02, 20.0)) + rng.choice((0.0, 1.76e9, -1e12, 1e16))}


def time_jittered(columns: Columns, rng: Rng) -> Columns:
    return {**columns, "t": columns["t"] + rng.uniform(0, 0.2) * rng.random(len(columns["t"]))}


def column_dropped(columns: Columns, rng: Rng) -> Columns:
    gone = set(_some(columns, rng)[: rng.integers(1, 4)])
    return {name: values for name, values in columns.items() if name not in gone}


def tiny(columns: Columns, rng: Rng) -> Columns:
    return _rows(columns, slice(0, int(rng.choice((1, 2, 7, 8, 9, 12, 20, 40, 60)))))


def everything_constant(columns: Columns, rng: Rng) -> Columns:
    return {**columns, **{k: np.full_like(v, v[0]) for k, v in columns.items() if k not in ("t", "episode")}}


def motionless(columns: Columns, rng: Rng) -> Columns:
    """Exactly zero measurements, or commands, or both."""
    which = rng.integers(3)
    still = [k for k in columns if k not in ("t", "episode") and which != (0 if k.startswith("cmd") else 1)]
    return {**columns, **{k: np.zeros_like(columns[k]) for k in still}}


def rows_doubled(columns: Columns, rng: Rng) -> Columns:
    count = len(columns["t"])
    return _rows(columns, np.sort(np.concatenate((np.arange(count), rng.integers(0, count, count // 3 + 1)))))


def rows_lost(columns: Columns, rng: Rng) -> Columns:
    return _rows(columns, np.flatnonzero(rng.random(len(columns["t"])) < rng.uniform(0.05, 1.0)))


def rows_shuffled(columns: Columns, rng: Rng) -> Columns:
    return _rows(columns, rng.permutation(len(columns["t"])))


def other_units(columns: Columns, rng: Rng) -> Columns:
    factors = {"yaw": 57.3, "roll": 57.3, "r": 57.3, "t": 1000.0, "z": 0.1, "cmd_1": 100.0, "x": 1000.0, "u": 3.6}
    return {**columns, **{k: columns[k] * factors[k] for k in factors if k in columns and rng.random() < 0.5}}


def drowned_in_noise(columns: Columns, rng: Rng) -> Columns:
    size = float(rng.choice((0.05, 1.0, 100.0)))
    noise = {k: columns[k] + size * rng.standard_normal(len(columns["t"])) for k in _some(columns, rng)}
    return {**columns, **{k: v for k, v in noise.items() if k != "t" and not k.startswith("cmd")}}


def commands_swapped(columns: Columns, rng: Rng) -> Columns:
    names = [k for k in columns if k.startswith("cmd_")]
    return {**columns, **{k: columns[str(o)] for k, o in zip(names, rng.permutation(names), strict=True)}}


def commands_saturated(columns: Columns, rng: Rng) -> Columns:
    factor = float(rng.choice((0.001, 5.0, -1.0)))
    return {**columns, **{k: np.clip(factor * v, -1, 1) for k, v in columns.items() if k.startswith("cmd_")}}


def odd_episodes(columns: Columns, rng: Rng) -> Columns:
    count = len(columns["t"])
    kinds = (
        np.arange(count),
        np.full(count, -3),
        np.arange(count) // 30,
        np.full(count, 1e15),
        rng.integers(0, 3, count),
    )
    return {**columns, "episode": kinds[rng.integers(len(kinds))]}


EDITS: dict[str, Callable[[Columns, Rng], Columns]] = {
    edit.__name__: edit
    for edit in (
        nan_block, scattered_nan, extreme_numbers, time_repeated, time_reversed, time_far_away, time_jittered,
        column_dropped, tiny, everything_constant, motionless, rows_doubled, rows_lost, rows_shuffled, other_units,
        drowned_in_noise, commands_swapped, commands_saturated, odd_episodes,
    )
}  # fmt: skip
