"""Many vehicles over many windows in one batched rollout of the project's physics."""

import numpy as np

from auv_torchrl.diagnosis.motion.actuation import Actuation
from auv_torchrl.diagnosis.motion.samples import late_steps, oldest, sample
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.physics.thrusters import lag_left

ROWS_AT_ONCE = 3000  # rows of a chunk: what stays in the cache of a laptop
DIVERGING = np.errstate(over="ignore", invalid="ignore", divide="ignore")  # such a candidate predicts NaN and loses


@DIVERGING
def fly(actuation: Actuation, start: Floats, force: Floats | None = None) -> tuple[Floats, Floats]:
    """Predicted samples (W, R, m, C) of ``R`` vehicles over all windows, and their states (W, R, S + 1, 13).

    Args:
        actuation: what the vehicles (R,) do with the commands of the windows.
        start: (W, R, 12) pose and velocity at the start as reported, see :class:`~auv_torchrl.sensors.Inverse`.
        force: (W, R, S, 6) in N and N m, body frame, that acts besides what the vehicle does; None for none.

    Any of the three may have one row for all the others'.
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
    """A force (w, R, S, 6) during as many steps; the last one goes on."""
    missing = steps - force.shape[2]
    return np.concatenate([force, np.repeat(force[:, :, -1:], missing, axis=2)], axis=2) if missing else force


def begin(actuation: Actuation, chunk: slice, start: Floats, rows: int) -> Floats:
    """States (w, rows, 13) at the start of some windows."""
    first = np.broadcast_to(start[chunk], (chunk.stop - chunk.start, rows, 12))
    return actuation.sensors.true_start(first)


class Run:
    """Some windows on their way; rows of one vehicle share its thrust."""

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
        left = lag_left(c, h) if terms.lag else 1.0
        for step in range(targets.shape[2]):
            found[:, step] = thrust
            for part in range(targets.shape[3] if terms.lag else 0):
                aim = targets[:, :, step, part]
                thrust = aim + (thrust - aim) * left
        return found


def _by_part(targets: list[Floats]) -> Floats:
    """Targets (w, R, S, P, n) of ``P`` parts of grid steps; where they are the same ones, they are not copied."""
    if all(part is targets[0] for part in targets):
        one = targets[0][..., None, :]
        return np.broadcast_to(one, (*one.shape[:-2], len(targets), one.shape[-1]))
    return np.stack(targets, axis=-2)
