"""Fewer rows of a log that was sampled fast: what is averaged around each, and what was commanded until the next."""

import numpy as np

from auv_torchrl.flightlog.log import Floats
from auv_torchrl.flightlog.signals import integral, interpolate
from auv_torchrl.physics import CONTROL_DT

MOST_PARTS = 10  # of the time between rows in which commands are told apart: 5 ms, within which no thruster answers
SAME_COMMAND = 1e-6  # rounding of sums over an hour, and below what any log writes

Index = np.ndarray


def thinning(steps: Floats) -> int:
    """Keep every k-th sample, so that the interval is about the control step; all where it is longer."""
    return max(1, round(CONTROL_DT / float(np.median(steps))))


def rows_around(length: int, every: int) -> Index:
    """Positions around every ``every``-th one, centred, so that averaging does not delay; (T, odd)."""
    kept = np.arange(0, length, every)
    half = (every - 1) // 2
    around = kept[:, None] + np.arange(-half, half + 1)
    inside = (around[:, 0] >= 0) & (around[:, -1] < length)
    return np.where(inside[:, None], around, kept[:, None])


def mean_until_next(t: Floats, commands: Floats, kept: Index) -> Floats:
    """Commands (T, n) held from row to row, averaged from each kept row to the next one."""
    if len(kept) == len(t):
        return commands
    mean = np.diff(integral(t, commands, held=True)[kept], axis=0) / np.diff(t[kept])[:, None]
    single = np.diff(kept) == 1
    mean[single] = commands[kept[:-1]][single]  # exact where nothing was left out
    return np.concatenate((mean, commands[kept[-1:]]))


def parts_until_next(t: Floats, commands: Floats, kept: Index, parts: int) -> Floats | None:
    """The same, averaged over each of ``parts`` equal parts (T, P, n) of that time; None where they do not differ."""
    if parts == 1:
        return None
    step = np.diff(t[kept])
    starts = t[kept[:-1], None] + step[:, None] * (np.arange(parts) / parts)
    edges = np.append(starts.reshape(-1), t[kept[-1]])
    at_edges = interpolate(edges, t, integral(t, commands, held=True))
    mean = np.diff(at_edges, axis=0).reshape(len(step), parts, -1) / (step / parts)[:, None, None]
    mean = np.concatenate((mean, np.repeat(commands[None, kept[-1:]], parts, axis=1)))
    return mean if np.ptp(mean, axis=1).max() > SAME_COMMAND else None
