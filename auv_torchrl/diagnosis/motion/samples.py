"""What the sensors of many vehicles report of a motion, at the times of a log's samples."""

from collections.abc import Callable
from functools import partial

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.physics import Coefficients
from auv_torchrl.physics.kinematics import least_turn
from auv_torchrl.sensors import ages, felt_along, motion_of, read

Reading = Callable[[Floats, Floats | None], Floats]  # what is reported of a motion (..., 12), and of a load (...)


def oldest(windows: Windows, c: Coefficients) -> Floats:
    """Age (R,) in s of the latest reports: windows are flown at the times that they tell of."""
    return ages(c, windows.channels).max(-1)


def ahead(windows: Windows, c: Coefficients) -> Floats:
    """Grid steps (R, C) by which the reports of each channel are younger than the oldest ones."""
    return (oldest(windows, c)[:, None] - ages(c, windows.channels)) / windows.dt


def late_steps(windows: Windows, c: Coefficients) -> int:
    """Grid steps behind the end of a window in which its youngest reports are measured, where others are late."""
    return int(np.ceil(ahead(windows, c).max() - 1e-9))


def sample(windows: Windows, chunk: slice, c: Coefficients, states: Floats, load: Floats | None = None) -> Floats:
    """What the sensors report of ``states`` (w, R, steps + 1, 13) at the times of the samples: (w, R, m, C).

    ``load`` (w, R, steps + 1) is the share of their full thrusts that thrusters give; None where no sensor feels it.
    """
    by_step = c.rows((slice(None), None))  # (R, 1, ...): steps are a batch axis
    motion, felt = motion_of(states), windows.felt
    at, later = (windows.index + windows.fraction)[chunk, None], ahead(windows, c)
    reported = np.empty((*states.shape[:2], at.shape[-1], len(felt)))
    if not felt.all():
        names = tuple(name for name, alone in zip(windows.channels, felt, strict=True) if not alone)
        angular, reading = windows.angular[~felt], partial(read, by_step, names)
        reported[..., ~felt] = (
            _at_their_times(reading, angular, motion, load, at[..., None] + later[:, None, ~felt])
            if later.any()
            else _at_once(reading, angular, motion, load, at)
        )
    if felt.any():
        reported[..., felt] = felt_samples(windows, by_step, motion, at[..., None] + later[:, None, felt])
    return reported


def _at_once(reading: Reading, angular: np.ndarray, motion: Floats, load: Floats | None, at: Floats) -> Floats:
    """Reports (w, R, m, C) of the states about grid positions ``at`` (w, 1, m) alone: all are of the same age."""
    low = np.minimum(np.floor(at + 1e-9).astype(int), motion.shape[2] - 1)
    part = (at - low)[..., None]

    def reports(steps: np.ndarray) -> Floats:
        pushing = None if load is None else np.take_along_axis(load, steps, axis=2)
        return reading(_rows(motion, steps), pushing)

    here = reports(low)
    if not (part > 1e-6).any():
        return here
    change = reports(np.minimum(low + 1, motion.shape[2] - 1)) - here
    change[..., angular] = least_turn(change[..., angular])  # not across the cut at pi
    return here + part * change


def _rows(motion: Floats, steps: np.ndarray) -> Floats:
    """States (w, R, m, 12) of a motion (w, R, L, 12) at grid ``steps`` (w, 1, m), each copied in one piece."""
    w, rows, length, _ = motion.shape
    first = length * np.arange(w * rows).reshape(w, rows, 1)
    return np.take(motion.reshape(w * rows * length, -1), first + steps, axis=0)


def _at_their_times(reading: Reading, angular: np.ndarray, motion: Floats, load: Floats | None, at: Floats) -> Floats:
    """The same where each channel is read at grid positions ``at`` (w, R, m, C) of its own."""
    reported = reading(motion, load)
    reported[..., angular] = np.unwrap(reported[..., angular], axis=2)  # interpolation must not cross the cut at pi
    columns = (_read(reported[..., column], at[..., column]) for column in range(len(angular)))
    return np.stack(list(columns), axis=-1)


def felt_samples(windows: Windows, by_step: Coefficients, motion: Floats, at: Floats) -> Floats:
    """What is felt along a ``motion`` (w, R, L, 12) on the mean around grid positions ``at`` (w, R or 1, m, k).

    ``k`` are the channels that are felt, in their order.
    """
    means = felt_along(by_step, windows.felt_channels, motion, windows.dt)
    total = np.concatenate([np.zeros_like(means[:, :, :1]), np.cumsum(means, axis=2)], axis=2)
    columns = (_around(windows, total[..., place], at[..., place]) for place in range(total.shape[-1]))
    return np.stack(list(columns), axis=-1)


def _around(windows: Windows, total: Floats, at: Floats) -> Floats:
    """Means around grid positions ``at`` (w, R or 1, m) of what adds up to ``total`` (w, R, L) at grid steps."""
    low, high = (np.clip(at + side * windows.around, 0.0, total.shape[-1] - 1) for side in (-1, 1))
    return (_read(total, high) - _read(total, low)) / (2 * windows.around)


def _read(series: Floats, at: Floats) -> Floats:
    """Linear interpolation of ``series`` (w, R, L) at grid positions ``at`` (w, R or 1, m)."""
    whole = np.minimum(np.floor(at + 1e-9).astype(int), series.shape[-1] - 1)
    here = np.take_along_axis(series, whole, axis=-1)
    part = at - whole
    if not (part > 1e-6).any():
        return here
    ahead = np.take_along_axis(series, np.minimum(whole + 1, series.shape[-1] - 1), axis=-1)
    return here + part * (ahead - here)
