"""Many vehicles simulated over many windows at once, and what their sensors report at the times of the samples."""

from collections.abc import Callable
from functools import partial

import numpy as np

from auv_torchrl.diagnosis.motion.actuation import Actuation, oldest
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.physics import Coefficients, rates
from auv_torchrl.physics.kinematics import least_turn
from auv_torchrl.physics.thrusters import thrust_follower
from auv_torchrl.sensors import ages, felt_along, motion_of, read

ROWS_AT_ONCE = 3000  # rows of a chunk: what stays in the cache of a laptop
# A candidate that diverges predicts NaN and loses.
DIVERGING = np.errstate(over="ignore", invalid="ignore", divide="ignore")
Reading = Callable[[Floats, Floats | None], Floats]  # what is reported of a motion (..., 12), and of a load (...)


@DIVERGING
def fly(actuation: Actuation, start: Floats, force: Floats | None = None) -> tuple[Floats, Floats]:
    """Predicted samples (W, R, m, C) of ``R`` vehicles over all windows, and their states (W, R, S + 1, 13).

    Args:
        actuation: what the vehicles (R,) do with the commands of the windows.
        start: (W, R, 12) pose and velocity at the start as reported, see :class:`~auv_torchrl.sensors.Inverse`.
        force: (W, R, S, 6) in N and N m, body frame, in addition to the vehicle's own; None for none.

    Each of the three may have one row that serves all rows of the others.
    """
    windows = actuation.windows
    steps = windows.steps + late_steps(windows, actuation.c)
    rows = max(len(actuation.whole), start.shape[1], 1 if force is None else force.shape[1])
    width, samples, states = max(1, ROWS_AT_ONCE // rows), [], []
    for first in range(0, len(windows), width):
        chunk = slice(first, min(first + width, len(windows)))
        pushed = None if force is None else _lasting(force[chunk], steps)
        flown = Run(actuation, chunk, steps).all(begin(actuation, chunk, start, rows), pushed)
        samples.append(sample(windows, chunk, actuation.c, flown, actuation.load(chunk, flown.shape[2])))
        states.append(flown[:, :, : windows.steps + 1])
    return np.concatenate(samples), np.concatenate(states)


def _lasting(force: Floats, steps: int) -> Floats:
    """A force (w, R, S, 6) during ``steps`` steps; the last value goes on."""
    missing = steps - force.shape[2]
    return np.concatenate([force, np.repeat(force[:, :, -1:], missing, axis=2)], axis=2) if missing else force


def begin(actuation: Actuation, chunk: slice, start: Floats, rows: int) -> Floats:
    """States (w, rows, 13) at the start of some windows."""
    first = np.broadcast_to(start[chunk], (chunk.stop - chunk.start, rows, 12))
    return actuation.sensors.true_start(first)


class Run:
    """The simulation of some windows; rows of one vehicle share its thrust."""

    def __init__(self, actuation: Actuation, chunk: slice, steps: int):
        self._actuation = actuation
        self._targets = _by_part(actuation.targets(chunk, np.arange(steps), actuation.substeps))
        self._thrust = actuation.thrust[chunk]
        self._time = actuation.windows.time[chunk, None] - oldest(actuation.windows, actuation.c)

    def all(self, body: Floats, force: Floats | None) -> Floats:
        """States (w, rows, S + 1, 13) from ``body`` (w, rows, 13) on, pushed by a force (w, rows, S, 6)."""
        return self._actuation.steps.run(body, self._thrust, self._targets, self._time, force)[0]

    def each(self, body: Floats, force: Floats) -> Floats:
        """States (w, S, rows, 13) one grid step after ``body`` (w, S, rows, 13), each pushed by its force likewise."""
        steps = body.shape[1]
        time = self._time[:, None] + self._actuation.windows.dt * np.arange(steps)[:, None]
        targets = self._targets.swapaxes(1, 2)[:, :, :, None]
        given = (body, self._thrusts(), targets, time, force[:, :, :, None])
        flat = (np.reshape(array, (-1, *array.shape[2:])) for array in given)
        return self._actuation.steps.run(*flat)[0][:, :, 1].reshape(body.shape)

    def _thrusts(self) -> Floats:
        """Thrust (w, S, R, n) in N at the start of each grid step."""
        c, terms, targets = self._actuation.c, self._actuation.terms, self._targets
        h = self._actuation.windows.dt / self._actuation.substeps
        thrust = np.broadcast_to(self._thrust, targets[:, :, 0, 0].shape)
        found = np.empty((len(targets), targets.shape[2], *thrust.shape[1:]))
        after = thrust_follower(c, terms, h)
        for step in range(targets.shape[2]):
            found[:, step] = thrust
            for part in range(targets.shape[3] if terms.lag or terms.servos else 0):
                thrust = after(thrust, targets[:, :, step, part])
        return found


def _by_part(targets: list[Floats]) -> Floats:
    """Targets (w, R, S, P, n) of ``P`` parts of grid steps; equal parts are not copied."""
    if all(part is targets[0] for part in targets):
        one = targets[0][..., None, :]
        return np.broadcast_to(one, (*one.shape[:-2], len(targets), one.shape[-1]))
    return np.stack(targets, axis=-2)


def accelerations(actuation: Actuation, motion: Floats) -> Floats:
    """(W, R, S, 6), as reported, of the vehicles of ``actuation`` along a reported ``motion`` (W, S, 13)."""
    windows, c, terms = actuation.windows, actuation.c, actuation.terms
    (target,) = actuation.targets(slice(0, len(windows)), np.arange(windows.steps))
    thrust = target
    if terms.lag or terms.servos:
        now, thrust = actuation.thrust, np.empty_like(target)
        halfway, after = (thrust_follower(c, terms, elapsed) for elapsed in (windows.dt / 2, windows.dt))
        for step in range(windows.steps):
            thrust[:, :, step] = halfway(now, target[:, :, step])
            now = after(now, target[:, :, step])
    time = windows.time[:, None, None] + (np.arange(windows.steps) + 0.5) * windows.dt - oldest(windows, c)[:, None]
    sensors = actuation.sensors.shared().by_step()
    true = sensors.true_state(motion[:, None])
    rate = rates(c, terms, true, thrust, time)
    return sensors.reported_rate(rate, true, motion[:, None])


def ahead(windows: Windows, c: Coefficients) -> Floats:
    """Grid steps (R, C) by which the reports of each channel are younger than the oldest ones."""
    return (oldest(windows, c)[:, None] - ages(c, windows.channels)) / windows.dt


def late_steps(windows: Windows, c: Coefficients) -> int:
    """Grid steps behind the end of a window in which its youngest reports are measured, where others are late."""
    return int(np.ceil(ahead(windows, c).max() - 1e-9))


def sample(windows: Windows, chunk: slice, c: Coefficients, states: Floats, load: Floats | None = None) -> Floats:
    """Reports of the sensors on ``states`` (w, R, steps + 1, 13) at the times of the samples, (w, R, m, C).

    ``load`` (w, R, steps + 1) is the share of full thrust that thrusters give; None where no sensor depends on it.
    """
    by_step = c.rows((slice(None), None))  # (R, 1, ...): steps are a batch axis
    motion, specific = motion_of(states), windows.specific_force
    at, later = (windows.index + windows.fraction)[chunk, None], ahead(windows, c)
    reported = np.empty((*states.shape[:2], at.shape[-1], len(specific)))
    if not specific.all():
        names = tuple(name for name, alone in zip(windows.channels, specific, strict=True) if not alone)
        angular, reading = windows.angular[~specific], partial(read, by_step, names)
        reported[..., ~specific] = (
            _at_their_times(reading, angular, motion, load, at[..., None] + later[:, None, ~specific])
            if later.any()
            else _at_once(reading, angular, motion, load, at)
        )
    if specific.any():
        reported[..., specific] = mean_specific_forces(
            windows, by_step, motion, at[..., None] + later[:, None, specific]
        )
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
    """Reports (w, R, m, C) where each channel is read at its own grid positions ``at`` (w, R, m, C)."""
    reported = reading(motion, load)
    reported[..., angular] = np.unwrap(reported[..., angular], axis=2)  # interpolation must not cross the cut at pi
    columns = (_read(reported[..., column], at[..., column]) for column in range(len(angular)))
    return np.stack(list(columns), axis=-1)


def mean_specific_forces(windows: Windows, by_step: Coefficients, motion: Floats, at: Floats) -> Floats:
    """Specific force along a ``motion`` (w, R, L, 12), averaged around grid positions ``at`` (w, R or 1, m, k).

    ``k`` counts the channels of the accelerometer, in their order.
    """
    means = felt_along(by_step, windows.specific_force_channels, motion, windows.dt)
    total = np.concatenate([np.zeros_like(means[:, :, :1]), np.cumsum(means, axis=2)], axis=2)
    columns = (_around(windows, total[..., place], at[..., place]) for place in range(total.shape[-1]))
    return np.stack(list(columns), axis=-1)


def _around(windows: Windows, total: Floats, at: Floats) -> Floats:
    """Means around grid positions ``at`` (w, R or 1, m) of a series with the running sum ``total`` (w, R, L)."""
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
