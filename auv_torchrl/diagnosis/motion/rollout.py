"""Many vehicles over many windows in one batched rollout of the project's physics.

Thrust depends on commands alone, so it is worked out before the body moves: each window starts with the thrust that
its commands have left behind, and the targets of all its steps are found at once.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.physics import ActiveTerms, Coefficients, prepare
from auv_torchrl.physics.kernel import Steps
from auv_torchrl.physics.thrusters import TARGET_FIELDS, thrust_after, thrust_targets
from auv_torchrl.sensors import Inverse, ages, motion_of, read
from auv_torchrl.vehicle import Vehicle

ROWS_AT_ONCE = 3000  # rows of a chunk: what stays in the cache of a laptop
LEAST_STEP = 0.005  # s; drag stops no vehicle within that: speeds that would need less are noise, and never end
LAG_MEMORY = 6.0  # time constants after which 0.25 % of an old thrust is left


DIVERGING = np.errstate(over="ignore", invalid="ignore", divide="ignore")  # such a candidate predicts NaN and loses


@dataclass(frozen=True)
class Actuation:
    """What ``R`` vehicles do with the logged commands, before any motion."""

    windows: Windows
    c: Coefficients  # (R, ...); their delay is what is left of it behind whole grid steps
    terms: ActiveTerms
    whole: np.ndarray  # (R,) grid steps of delay
    thrust: Floats  # (W, R, n) N, at the start of each window
    substeps: int  # Runge-Kutta steps per grid step

    @cached_property
    def steps(self) -> Steps:
        """The vehicles' equations of motion."""
        return Steps(self.c, self.terms, self.windows.dt / self.substeps)

    @property
    def late(self) -> bool:
        """Whether some commands arrive within a grid step."""
        return bool((self.c.delay > 1e-6 * self.windows.dt).any())

    def targets(self, chunk: slice, steps: np.ndarray, parts: int = 1) -> list[Floats]:
        """Mean thrust target (w, R, S, n) in N during each of ``parts`` parts of grid steps (S,) of some windows."""
        windows = self.windows
        kinds, kind = self._kinds
        grid = np.clip(windows.start[chunk, None] + steps, 0, windows.commands.shape[1] - 1)
        shifts = self.whole[kinds]
        arrived = grid[:, None] - shifts[:, None]  # (w, R or 1, S)
        ages = (0, 1) if self.late else (0,)
        episode = windows.episode[chunk, None, None]
        held = np.stack([windows.held[episode, np.maximum(arrived - age, 0)] for age in ages], axis=-2)
        by_step = self.c.rows((kinds, None))
        each = [thrust_targets(by_step, self.terms, some, windows.dt, parts) for some in np.moveaxis(held, -3, 0)]

        def of_all(targets: Sequence[Floats]) -> Floats:
            mean = _mean(targets)
            shape = (len(mean), len(kind), *mean.shape[2:])
            return np.broadcast_to(mean, shape) if len(kinds) == 1 else mean[:, kind]

        if not self.late:  # all parts are the same
            return [of_all([targets[0] for targets in each])] * parts
        return [of_all(part) for part in zip(*each, strict=True)]

    @cached_property
    def _kinds(self) -> tuple[np.ndarray, np.ndarray]:
        """Vehicles that do different things with a command, and as which of them each does: most change elsewhere."""
        fields = [getattr(self.c, name).reshape(len(self.whole), -1) for name in TARGET_FIELDS]
        numbers = np.concatenate([self.whole[:, None], *fields], axis=1)
        _, kinds, kind = np.unique(numbers, axis=0, return_index=True, return_inverse=True)
        return kinds, kind.reshape(-1)


def actuate(windows: Windows, vehicle: Vehicle) -> Actuation:
    """What vehicles, a batch (R,), do with the commands of windows."""
    return actuate_prepared(windows, prepare(vehicle).numpy())


def actuate_prepared(windows: Windows, c: Coefficients) -> Actuation:
    """Delay the commands and let the lag run up to the start of each window; coefficients of vehicles (R,)."""
    total = np.maximum(c.delay + oldest(windows, c), 0.0)  # late reports see the motion that older commands made
    whole = np.floor(total / windows.dt + 1e-6)
    c = c._replace(delay=np.maximum(total - whole * windows.dt, 0.0))
    silent = np.zeros((len(windows), len(total), c.full_thrust.shape[-1]))
    actuation = Actuation(windows, c, ActiveTerms.of(c), whole.astype(int), silent, _substeps(windows, c))
    if actuation.late:
        actuation = replace(actuation, substeps=max(actuation.substeps, 2))
    if actuation.terms.lag:
        back = int(np.ceil(LAG_MEMORY * c.lag.max() / windows.dt))
        (targets,) = actuation.targets(slice(0, len(windows)), np.arange(-back, 0))
        thrust = targets[:, :, 0]
        for ago in range(1, back):
            thrust = thrust_after(c, actuation.terms, thrust, targets[:, :, ago], windows.dt)
        actuation = replace(actuation, thrust=thrust)
    return actuation


def simulate(windows: Windows, vehicle: Vehicle, start: Floats, force: Floats | None = None) -> Floats:
    """Predicted samples (W, R, m, C) of ``R`` vehicles over all windows, see :func:`fly`."""
    return fly(actuate(windows, vehicle), start, force)[0]


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
    samples, states = [], []
    for chunk in _chunks(len(windows), rows):
        flown = path(actuation, chunk, start, force, steps, rows)
        samples.append(sample(windows, chunk, actuation.c, flown))
        states.append(flown[:, :, : windows.steps + 1])
    return np.concatenate(samples), np.concatenate(states)


def _substeps(windows: Windows, c: Coefficients) -> int:
    """Runge-Kutta steps per grid step that keep order 4 accurate at the speeds that were flown."""
    speed = np.quantile(np.abs(windows.guess[:, 6:]), 0.99, axis=0)
    linear = np.diagonal(c.linear_drag, axis1=-2, axis2=-1)
    rate = (linear + 2 * c.quadratic_drag * speed) * np.diagonal(c.mass_inverse, axis1=-2, axis2=-1)
    most = int(np.ceil(windows.dt / LEAST_STEP))
    return int(np.clip(np.ceil(windows.dt * rate.max() / 1.6), 1, most))


def _chunks(windows: int, rows: int) -> Iterator[slice]:
    width = max(1, ROWS_AT_ONCE // rows)
    for first in range(0, windows, width):
        yield slice(first, min(windows, first + width))


@DIVERGING
def path(actuation: Actuation, chunk: slice, start: Floats, force: Floats | None, steps: int, rows: int) -> Floats:
    """True states (w, R, steps + 1, 13) on the grid: position, quaternion, body velocity."""
    body = begin(actuation, chunk, start, rows)
    pushed = None if force is None else _lasting(force[chunk], steps)
    return Run(actuation, chunk, steps).all(body, pushed)


def _lasting(force: Floats, steps: int) -> Floats:
    """A force (w, R, S, 6) during as many steps; the last one goes on."""
    missing = max(steps - force.shape[2], 0)
    return (
        np.concatenate([force, np.repeat(force[:, :, -1:], missing, axis=2)], axis=2)
        if missing
        else force[:, :, :steps]
    )


def begin(actuation: Actuation, chunk: slice, start: Floats, rows: int) -> Floats:
    """States (w, rows, 13) at the start of some windows."""
    first = np.broadcast_to(start[chunk], (chunk.stop - chunk.start, rows, 12))
    return Inverse.of(actuation.c, actuation.windows.channels).true_start(first)


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
        for step in range(targets.shape[2]):
            found[:, step] = thrust
            if terms.lag:
                for part in range(targets.shape[3]):
                    thrust = thrust_after(c, terms, thrust, targets[:, :, step, part], h)
        return found


def _mean(targets: Sequence[Floats]) -> Floats:
    """Of thrusts, and not of commands, because the dead band is not linear."""
    return targets[0] if len(targets) == 1 else sum(targets[1:], start=targets[0]) / len(targets)


def _by_part(targets: list[Floats]) -> Floats:
    """Targets (w, R, S, P, n) of ``P`` parts of grid steps; where they are the same ones, they are not copied."""
    if all(part is targets[0] for part in targets):
        one = targets[0][..., None, :]
        return np.broadcast_to(one, (*one.shape[:-2], len(targets), one.shape[-1]))
    return np.stack(targets, axis=-2)


def oldest(windows: Windows, c: Coefficients) -> Floats:
    """Age (R,) in s of the latest reports: windows are flown at the times that they tell of."""
    return ages(c, windows.channels).max(-1)


def ahead(windows: Windows, c: Coefficients) -> Floats:
    """Grid steps (R, C) by which the reports of each channel are younger than the oldest ones."""
    return (oldest(windows, c)[:, None] - ages(c, windows.channels)) / windows.dt


def late_steps(windows: Windows, c: Coefficients) -> int:
    """Grid steps behind the end of a window in which its youngest reports are measured, where others are late."""
    return int(np.ceil(ahead(windows, c).max() - 1e-9))


def sample(windows: Windows, chunk: slice, c: Coefficients, states: Floats) -> Floats:
    """What the sensors report of ``states`` (w, R, steps + 1, 13) at the times of the samples: (w, R, m, C)."""
    reported = read(
        c.rows((slice(None), None)), windows.channels, motion_of(states)
    )  # (R, 1, ...): steps are a batch axis
    at, later = (windows.index + windows.fraction)[chunk, None], ahead(windows, c)
    if windows.fraction.any() or later.any():  # interpolation must not cross the cut at pi
        reported[..., windows.angular] = np.unwrap(reported[..., windows.angular], axis=2)
    columns = range(len(windows.channels))
    return np.stack([_read(reported[..., column], at + later[:, column, None]) for column in columns], axis=-1)


def _read(series: Floats, at: Floats) -> Floats:
    """Linear interpolation of ``series`` (w, R, L) at grid positions ``at`` (w, R or 1, m)."""
    at = np.broadcast_to(at, (*series.shape[:2], at.shape[-1]))
    whole = np.minimum(np.floor(at + 1e-9).astype(int), series.shape[-1] - 1)
    here = np.take_along_axis(series, whole, axis=-1)
    part = at - whole
    if not (part > 1e-6).any():
        return here
    ahead = np.take_along_axis(series, np.minimum(whole + 1, series.shape[-1] - 1), axis=-1)
    return here + part * (ahead - here)
