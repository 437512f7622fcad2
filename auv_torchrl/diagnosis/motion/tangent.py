"""The rollout linearised along every window: how samples respond to small changes of starts and forces.

Each step is linearised by finite differences of the physics. The response to any small change is then a product of
small matrices, and no vehicle is simulated again. :class:`Slopes` are the responses to the free numbers of windows, the
largest arrays of a diagnosis: the latest are held, the others are computed again.
"""

import weakref
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.motion.actuation import actuate, sensors_of
from auv_torchrl.diagnosis.motion.rollout import DIVERGING, Run, ahead, begin, late_steps, sample
from auv_torchrl.diagnosis.motion.windows import Floats, Windows, chunks, columns_of_motion
from auv_torchrl.flightlog.log import ANGLES
from auv_torchrl.physics import Coefficients
from auv_torchrl.physics.kinematics import least_turn, quaternion_from_euler
from auv_torchrl.sensors import MOTION, motion_of, moving, read
from auv_torchrl.vehicle import Vehicle

STEP_STATE = 1e-3  # m, rad, m/s, rad/s
STEP_FORCE = np.array([0.1] * 3 + [0.01] * 3)  # N, N m
COLUMNS_AT_ONCE = 64
ANGULAR = np.array([channel in ANGLES for channel in MOTION])
_latest: dict[int, "weakref.ref[Slopes]"] = {}  # the latest asked for is the last
# Bytes of all slopes that are held, beside those in use. A minute of flight has 2 to 10 MB of them, and 20 MB of 15
# channels under a limit cycle. A search compares a dozen explanations. Four times as many saved no time: 91 and 89 s of
# CPU for 3.6 minutes of flight.
HELD = 32 << 20


@dataclass(frozen=True)
class Tangent:
    """Steps of windows, linearised in the ``n`` numbers of the motion that are free (position, angles, velocity)."""

    transition: Floats  # (W, S, n, n) of a step in the state before it
    push: Floats  # (W, S, n, n / 2) of a step in a force on the vehicle during it, per N and N m
    feel: Floats  # (W, S + 1, k, n) of the specific force on ``k`` channels at grid steps by the state there
    slopes: Floats  # (C, n) reports per unit of each number; 0 for a specific force
    moving: Floats  # (k, n) specific force that comes from the rate of each number, per 1/s
    later: Floats  # (C,) grid steps by which the reports of each channel are younger than the oldest ones

    def rows(self, some: slice) -> "Tangent":
        """The tangent of some windows."""
        return replace(self, transition=self.transition[some], push=self.push[some], feel=self.feel[some])

    @staticmethod
    def of(
        windows: Windows, c: Coefficients, entries: np.ndarray, transition: Floats, push: Floats, feel: Floats
    ) -> "Tangent":
        """The tangent of a vehicle ``c`` (1,) from the derivatives along its path."""
        moved, columns = columns_of_motion(windows.channels)
        slopes = np.zeros((len(windows.channels), len(entries)))
        slopes[moved] = sensors_of(c, windows.channels).slopes[0][columns][:, entries]
        names = windows.specific_force_channels
        rates = moving(c.rows((slice(None), None)), names, np.eye(12)[None, entries])[0].T if names else np.zeros(0)
        return Tangent(transition, push, feel, slopes, rates, ahead(windows, c)[0])


@DIVERGING
def linearise(
    windows: Windows, vehicle: Vehicle, entries: np.ndarray, start: Floats, force: Floats
) -> tuple[Floats, Tangent]:
    """Measured less predicted (W, K) at a start (W, 12) under a force (W, S, 6), and the tangent there.

    Args:
        windows: the data.
        vehicle: batch (1,).
        entries: the ``n`` entries of a start that can move, positions before velocities.
        start: pose and velocity as reported.
        force: N and N m, body frame.
    """
    actuation = actuate(windows, vehicle)
    moves = entries[: len(entries) // 2]
    everything = slice(0, len(windows))
    steps = windows.steps + late_steps(windows, actuation.c)
    lasting = force[:, np.minimum(np.arange(steps), force.shape[1] - 1)]
    run = Run(actuation, everything, steps)
    states = run.all(begin(actuation, everything, start[:, None], 1), lasting[:, None])
    pushed = np.repeat(lasting[:, :, None], 1 + len(entries) + len(moves), axis=2)
    pushed[:, :, 1 + len(entries) + np.arange(len(moves)), moves] += STEP_FORCE[moves]
    after = motion_of(run.each(_perturbed(states[:, 0, :-1, None], entries, pushed.shape[2]), pushed))
    change = after[:, :, 1:] - after[:, :, :1]
    change[..., ANGULAR] = least_turn(change[..., ANGULAR])
    change = change[..., entries].swapaxes(2, 3)
    transition = change[..., : len(entries)] / STEP_STATE
    push = change[..., len(entries) :] / STEP_FORCE[moves]
    residual = windows.residual(
        sample(windows, everything, actuation.c, states, actuation.load(everything, states.shape[2]))
    )[:, 0]
    feel = _feel(windows, actuation.c, entries, motion_of(states[:, 0]))
    return residual.reshape(len(windows), -1), Tangent.of(windows, actuation.c, entries, transition, push, feel)


def _feel(windows: Windows, c: Coefficients, entries: np.ndarray, motion: Floats) -> Floats:
    """Derivative (W, L, k, n) of the specific force by each free number of a motion (W, L, 12) that goes on."""
    names = windows.specific_force_channels
    if not names:
        return np.zeros((*motion.shape[:2], 0, len(entries)))
    beside = 0.5 * STEP_STATE * np.eye(12)[entries]
    above, below = (read(c.rows((slice(None), None)), names, motion[:, :, None] + side * beside) for side in (1, -1))
    return (above - below).swapaxes(2, 3) / STEP_STATE


def respond(windows: Windows, tangent: Tangent, start: Floats, force: Floats) -> Floats:
    """Change (W, K, N) of the samples under ``N`` small changes at once.

    Args:
        windows: the data.
        tangent: of these windows.
        start: (W or 1, n, N) change of the true start.
        force: (W or 1, S, n / 2, N) change of the force during each step, N and N m; the last one goes on.
    """
    columns = max(start.shape[-1], force.shape[-1])
    found = np.empty((len(windows), windows.trust[0].size, columns))
    width = min(columns, COLUMNS_AT_ONCE)
    numbers = windows.trust[0].size + tangent.transition[0, :, 0].size
    for some in chunks(len(windows), 8 * numbers * width):
        here, own = windows.subset(some), tangent.rows(some)
        begins, pushes = (array if len(array) == 1 else array[some] for array in (start, force))
        for first in range(0, columns, COLUMNS_AT_ONCE):
            few = slice(first, first + COLUMNS_AT_ONCE)
            found[some, :, few] = _respond(here, own, begins[..., few], pushes[..., few])
    return found


@DIVERGING
def _respond(windows: Windows, tangent: Tangent, start: Floats, force: Floats) -> Floats:
    history = _histories(tangent, start, force)
    steps = history.shape[1] - 1
    here = np.arange(len(windows))[:, None]
    change = np.zeros((*windows.measured.shape, history.shape[-1]))
    for column, slopes in enumerate(tangent.slopes):
        at = windows.index + windows.fraction + tangent.later[column]
        whole = np.minimum(np.floor(at + 1e-9).astype(int), steps)
        part = np.where(windows.present, at - whole, 0.0)[..., None]
        between = bool((part > 1e-6).any())
        for entry in np.flatnonzero(slopes):  # none of what is held
            values = history[here, whole, entry]
            if between:
                values = (1 - part) * values + part * history[here, np.minimum(whole + 1, steps), entry]
            change[:, :, column] += slopes[entry] * values
    if windows.specific_force.any():
        change[:, :, windows.specific_force] = _mean_specific_forces(windows, tangent, history)
    change *= windows.trust[..., None]
    return windows.whitened(change.reshape(len(windows), -1, history.shape[-1]))


def _histories(tangent: Tangent, start: Floats, force: Floats) -> Floats:
    """Change (W, steps + 1, n, N) of the numbers at grid steps; arguments as of :func:`respond`.

    Most columns of free numbers are forces in one bin: nothing happens before the first of them, and nothing pushes
    behind the last.
    """
    transition, push = tangent.transition, tangent.push
    count, steps, n, _ = transition.shape
    held = np.minimum(np.arange(steps), force.shape[1] - 1)
    pushes = np.asarray(force.any((0, 2, 3)))[held]
    first = 0 if start.any() or not pushes.any() else int(pushes.argmax())
    history = np.empty((count, steps + 1, n, max(start.shape[-1], force.shape[-1])))
    history[:, 0], history[:, 1 : first + 1] = start, 0.0
    for k in range(first, steps):
        np.matmul(transition[:, k], history[:, k], out=history[:, k + 1])
        if pushes[k]:
            history[:, k + 1] += push[:, k] @ force[:, held[k]]
    return history


def _mean_specific_forces(windows: Windows, tangent: Tangent, history: Floats) -> Floats:
    """Change (W, m, k, N) of mean specific forces under changes (W, L, n, N) of the numbers at grid steps."""
    # means over steps, added up: halves of neighbours, and changes, of which only the last one stays
    total = np.cumsum(tangent.feel @ history, axis=1)
    total += (tangent.moving / windows.dt - 0.5 * tangent.feel) @ history
    later = tangent.later[windows.specific_force]
    here, channel = np.arange(len(total))[:, None, None], np.arange(len(later))
    at = np.where(windows.present, windows.index + windows.fraction, 0.0)[..., None] + later
    ends = []
    for side in (-1, 1):
        there = np.clip(at + side * windows.around, 0.0, total.shape[1] - 1)
        whole = np.minimum(np.floor(there + 1e-9).astype(int), total.shape[1] - 2)
        part = (there - whole)[..., None]
        ends.append((1 - part) * total[here, whole, channel] + part * total[here, whole + 1, channel])
    return (ends[1] - ends[0]) / (2 * windows.around)


def _perturbed(states: Floats, entries: np.ndarray, rows: int) -> Floats:
    """States (..., 1, 13) in ``rows`` rows, moved by one step in each of ``entries`` from the second row on."""
    numbers = np.repeat(motion_of(states), rows, axis=-2)
    numbers[..., 1 + np.arange(len(entries)), entries] += STEP_STATE
    quaternion = quaternion_from_euler(*np.moveaxis(numbers[..., 3:6], -1, 0))
    return np.concatenate([numbers[..., :3], quaternion, numbers[..., 6:]], axis=-1)


class Slopes:
    """Slopes (W, K, L) of the samples of windows in their free numbers, let go where others need the memory."""

    def __init__(self, make: Callable[[], Floats], array: Floats | None = None, counts: bool = True) -> None:
        self._make = make
        self._array = array
        self._counts = counts
        if array is not None:
            self._hold()

    @property
    def array(self) -> Floats:
        """The slopes, computed again where they were let go; no caller may change them in place."""
        array = self._make() if self._array is None else self._array
        if self._counts:
            self._array = array
            self._hold()
        return array

    @property
    def is_held(self) -> bool:
        """Whether the slopes are in memory."""
        return self._array is not None

    def rows(self, some: slice | np.ndarray) -> "Slopes":
        """Slopes of some windows, cut out of these when they are read."""
        return Slopes(lambda: self.array[some], counts=False)

    def taken(self) -> Floats:
        """The slopes for a caller that changes them in place; this object lets them go."""
        array, self._array = self.array, None
        return array if self._counts else array.copy()

    def _hold(self) -> None:
        """Make these slopes the latest, and let the oldest ones go where all together are too large."""
        if not self._counts:
            return
        _latest.pop(id(self), None)
        _latest[id(self)] = weakref.ref(self)
        held = {key: slopes for key, known in _latest.items() if (slopes := known()) is not None}
        sizes = {key: slopes._array.nbytes for key, slopes in held.items() if slopes._array is not None}
        total = sum(sizes.values())
        for key in [key for key in _latest if key != id(self)]:
            if key not in sizes or total > HELD:
                total -= sizes.get(key, 0)
                if key in held:
                    held[key]._array = None
                del _latest[key]
