"""Channels that do not follow the vehicle: stuck but noisy, on deck, of another source, replayed."""

from collections.abc import Callable

import numpy as np

from benchmarks.blind.flights.damages import Act, Columns, Damage, Damaged, Rng
from benchmarks.blind.flights.sensor_sets import SENSOR_SETS

CODES = (  # of findings that tell of it
    "does_not_answer",
    "not_of_this_vehicle",
    "nothing_moves",
    "stands",
    "held",
    "nothing_follows",
    "constant_column",
    "frozen",
)
PART = (0.5, 0.8)  # of the log that stands still, where it is not all of it
WALK = 0.05  # rad per root of a second, of a heading that is not the vehicle's
POSITIONS, ATTITUDE, VELOCITIES = ("x", "y", "z"), ("roll", "pitch", "yaw"), ("u", "v", "w")


def _over_a_part(names: tuple[str, ...], false: Callable[[Columns, str, Rng], np.ndarray]) -> Act:
    """Columns that are false all along, or from some row to the end."""

    def act(columns: Columns, rng: Rng) -> Damaged:
        count = len(columns["t"])
        first = 0 if rng.random() < 0.5 else round((1 - rng.uniform(*PART)) * count)
        there = tuple(name for name in names if name in columns)
        changed = {name: columns[name].copy() for name in there}
        for name in there:
            changed[name][first:] = false(columns, name, rng)[first:]
        return {**columns, **changed}, there

    return act


def _stuck(sensors: str) -> Callable[[Columns, str, Rng], np.ndarray]:
    """The value at the start, with the noise of the channel, held as the channel is."""

    def false(columns: Columns, name: str, rng: Rng) -> np.ndarray:
        channel, count = SENSOR_SETS[sensors].channels[name], len(columns["t"])
        noise = channel.noise * rng.standard_normal(-(-count // channel.every))
        return columns[name][0] + np.repeat(noise, channel.every)[:count]

    return false


def _walk(columns: Columns, name: str, rng: Rng) -> np.ndarray:
    """A slow walk, of a source that is not the vehicle."""
    step = WALK * np.sqrt(float(np.median(np.diff(columns["t"]))))
    return columns[name][0] + np.cumsum(step * rng.standard_normal(len(columns["t"])))


def _replayed(columns: Columns, name: str, rng: Rng) -> np.ndarray:
    """What the channel was half a log before."""
    return np.roll(columns[name], len(columns["t"]) // 2)


def kinds(sensors: str) -> dict[str, Damage]:
    """What can stand still with a set of sensors."""
    stuck, measured = _stuck(sensors), tuple(SENSOR_SETS[sensors].channels)
    acts: dict[str, tuple[tuple[str, ...], Callable[[Columns, str, Rng], np.ndarray]]] = {
        "depth_stuck": (("z",), stuck),
        "heading_of_another": (("yaw",), _walk),
        "depth_replayed": (("z",), _replayed),
        "on_deck": (measured, stuck),
    }
    if sensors == "stock":
        acts["attitude_stuck"] = (ATTITUDE, stuck)
    if sensors == "dvl":
        acts["velocity_stuck"] = (VELOCITIES, stuck)
    if sensors == "mocap":
        acts["position_stuck"] = (POSITIONS, stuck)
        acts["pose_replayed"] = ((*POSITIONS, *ATTITUDE), _replayed)
    return {name: Damage(name, _over_a_part(*act), CODES, mentions=True, axes=act[0]) for name, act in acts.items()}
