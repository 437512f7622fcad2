"""The start and the force under which every window follows its samples.

The force is what the simulator misses, in newtons, without differentiating a noisy position. With a wide prior on the
force the fit is a smoother, and its residual is sensor noise. With the narrow prior of a disturbance the same
quantities are the innovations that hypotheses are fitted to. The smoother begins from a rough force: local parabolas
through the samples give the motion, and the simulator misses a force there.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from auv_torchrl.diagnosis.motion.actuation import Actuation, actuate, coefficients, usual_speed
from auv_torchrl.diagnosis.motion.rollout import DIVERGING, accelerations, fly
from auv_torchrl.diagnosis.motion.tangent import Slopes, Tangent, linearise, respond
from auv_torchrl.diagnosis.motion.windows import (
    Floats,
    Windows,
    attitudes,
    body_rate,
    chunks,
    columns_of_motion,
)
from auv_torchrl.diagnosis.thresholds import LOST, SMALL_SWING, TILTS
from auv_torchrl.flightlog import FlightLogError
from auv_torchrl.physics import ActiveTerms, Coefficients, prepare
from auv_torchrl.physics.kinematics import cross, matvec, normalise, rotation_matrix
from auv_torchrl.physics.pushes import wrench_per_unit
from auv_torchrl.sensors import FELT, MOTION, Inverse, motion_of, read
from auv_torchrl.vehicle import Vehicle

PIECE_BINS = 2  # bins of a short piece
MORE_TURNS = 4  # of three rounds, of windows that are lost: twice as many find few more
STILL_FALLS = 0.5  # of the misfit of such a window, below which a turn must bring it: what falls slowly takes long
LOOSE_START = np.array([10.0] * 3 + [0.5, 0.5, 3.2] + [3.0] * 3 + [1.0, 1.0, 10.0])  # weak priors about the guess
USUAL_SPEED = 0.5  # m/s, prior of a speed where an accelerometer alone measures that axis
REACH_S = 0.25  # half width of the parabolas; wider where samples are sparse
LEAST_SAMPLES = 6


@dataclass(frozen=True)
class Layout:
    """Which numbers are free in every window: entries of its start, and a force per bin and degree of freedom."""

    start: np.ndarray  # indices into the 12 numbers of a start
    dof: np.ndarray  # indices into the 6 degrees of freedom
    bins: int
    steps_per_bin: int
    loose: Floats  # (len(start),) standard deviations of the prior of a start about the first guess
    by_specific_force: np.ndarray  # (len(dof),) True where an accelerometer alone measures the axis

    @property
    def size(self) -> int:
        """Free numbers per window."""
        return len(self.start) + self.bins * len(self.dof)

    @property
    def moves_unseen(self) -> bool:
        """Whether the vehicle moves in degrees of freedom that the log does not measure."""
        return len(self.start) > 2 * len(self.dof)

    @staticmethod
    def of(windows: Windows, vehicle: Vehicle, bin_s: float) -> "Layout":
        """The layout for the degrees of freedom in which the vehicle moves, with forces in those that the log measures.

        Raises:
            FlightLogError: if the log measures none of them.
        """
        moves, here = np.flatnonzero(vehicle.free > 0), set(windows.channels)
        followed = np.array([bool({MOTION[d], MOTION[d + 6]} & here) for d in moves])
        seen = followed | np.array([bool(here & set(FELT[d : d + 1])) for d in moves])
        if not seen.any():
            raise FlightLogError(
                f"the log measures {', '.join(windows.channels)} alone, in which the vehicle is held or does not move: "
                "log x, y and yaw, z, or body velocities too"
            )
        per_bin = max(1, round(bin_s / windows.dt))
        start = np.concatenate([moves, moves + 6])
        loose = loose_start(vehicle, usual_speed(windows))[start]
        loose[len(moves) :][seen & ~followed] = USUAL_SPEED
        return Layout(start, moves[seen], -(-windows.steps // per_bin), per_bin, loose, ~followed[seen])

    def away(self, windows: Windows, start: Floats, bins: Floats) -> Floats:
        """Free numbers (W, ..., L) of starts (W, ..., 12) and bins (W, ..., B, D), less the mean of their prior."""
        guess = np.expand_dims(windows.guess, tuple(range(1, start.ndim - 1)))
        return np.concatenate([(start - guess)[..., self.start], bins.reshape(*bins.shape[:-2], -1)], axis=-1)

    def force(self, bins: Floats, steps: int) -> Floats:
        """Force (..., steps, 6) of bins (..., B, D)."""
        full = np.zeros((*bins.shape[:-1], 6))
        full[..., self.dof] = bins
        return np.repeat(full, self.steps_per_bin, axis=-2)[..., :steps, :]


TANGENT = ("inward", "transition", "push", "feel")  # what slopes come from


@dataclass(frozen=True)
class Smoothed:
    """Windows with fitted free numbers, the residual, and its slopes in the free numbers."""

    start: Floats  # (W, 12)
    bins: Floats  # (W, B, D) N, N m
    residual: Floats  # (W, K) measured less predicted, K = m C
    inward: Floats  # (W, n, n) of the true start by the reported one, from which the slopes come
    transition: Floats  # (W, S, n, n) of the tangent, likewise
    push: Floats  # (W, S, n, n / 2), likewise
    feel: Floats  # (W, S + 1, k, n), likewise
    slopes: Slopes

    @property
    def slope(self) -> Floats:
        """Slopes (W, K, L) of the prediction in the L free numbers."""
        return self.slopes.array

    def rows(self, some: slice | np.ndarray) -> "Smoothed":
        """The state of some windows."""
        return _of_fields([field[some] for field in fields(self)], self.slopes.rows(some))


def loose_start(vehicle: Vehicle, speed: float = 0.0) -> Floats:
    """Prior standard deviations (12,) of a start: weak, but no tilt beyond what the thrusters can hold.

    Fins tilt a vehicle at its ``speed`` ahead in m/s.
    """
    c = prepare(vehicle.expand(1)).numpy()
    stiffness = np.abs(c.restoring[0, [3, 4], [1, 0]])  # N m per rad of roll and pitch
    moment = (np.abs(wrench_per_unit(c, ActiveTerms.of(c), speed)[0, 3:5]) * c.full_thrust[0]).sum(-1)
    loose = LOOSE_START.copy()
    with np.errstate(divide="ignore", invalid="ignore"):  # without a righting moment, any tilt may be
        tilt = np.fmin(TILTS * np.maximum(moment, moment.max()) / stiffness, loose[3:5])
    tilt = np.maximum(tilt, SMALL_SWING)  # where no thruster tilts it, the water does
    loose[9:11] *= tilt / loose[3:5]
    loose[3:5] = tilt
    return loose


def noise_per_sample(windows: Windows, sigma: dict[str, float]) -> Floats:
    """Standard deviation (K,) of each number of a window's residual."""
    return np.tile([sigma[channel] for channel in windows.channels], windows.measured.shape[1])


@DIVERGING
def local_slopes(windows: Windows, vehicle: Vehicle, layout: Layout, start: Floats, bins: Floats) -> Smoothed:
    """Residual and slopes at given starts (W, 12) and forces (W, B, D); ``vehicle`` is a batch (1,)."""
    residual, tangent = linearise(windows, vehicle, layout.start, start, layout.force(bins, windows.steps))
    inward = actuate(windows, vehicle).sensors.by_step().start_slopes(start, layout.start)
    along = inward, tangent.transition, tangent.push, tangent.feel
    slopes = slopes_along(windows, vehicle, layout, along)
    return Smoothed(start, bins, residual, *along, slopes)


def slopes_along(
    windows: Windows, vehicle: Vehicle, layout: Layout, along: tuple[Floats, ...], array: Floats | None = None
) -> Slopes:
    """Slopes of windows from the four arrays of a tangent, made when they are read; the ``array`` where it is known."""
    return Slopes(partial(_free_slopes, windows, coefficients(vehicle), layout, *along), array)


@DIVERGING
def _free_slopes(
    windows: Windows,
    c: Coefficients,
    layout: Layout,
    inward: Floats,
    transition: Floats,
    push: Floats,
    feel: Floats,
) -> Floats:
    """Change (W, K, L) of the samples per unit of each free number, along a tangent."""
    n, moves = len(layout.start), layout.start[: len(layout.start) // 2]
    starts = inward @ np.eye(n, layout.size)
    forces = np.zeros((1, windows.steps, len(moves), layout.size))
    for column, (b, d) in enumerate(np.ndindex(layout.bins, len(layout.dof))):
        during = slice(b * layout.steps_per_bin, (b + 1) * layout.steps_per_bin)
        forces[0, during, np.flatnonzero(moves == layout.dof[d]), n + column] = 1.0
    return respond(windows, Tangent.of(windows, c, layout.start, transition, push, feel), starts, forces)


@DIVERGING
def smooth(
    windows: Windows,
    vehicle: Vehicle,
    layout: Layout,
    sigma: dict[str, float],
    force_prior: Floats,
    begin: tuple[Floats, Floats],
    rounds: int = 3,
    bends: bool = True,
) -> Smoothed:
    """Levenberg-Marquardt over the free numbers of all windows, forces held near zero by ``force_prior`` (D,).

    ``begin`` are the starts (W, 12) and bins (W, B, D) to begin from. Windows so short that they hardly bend
    (``bends`` false) keep the slopes that they begin with.
    """
    weight = 1.0 / noise_per_sample(windows, sigma)
    precision = np.concatenate([layout.loose**-2.0, np.tile(force_prior**-2, layout.bins)])

    def cost(state: Smoothed) -> Floats:
        away = layout.away(windows, state.start, state.bins)
        return ((state.residual * weight) ** 2).sum(1) + (precision * away**2).sum(1)

    state = local_slopes(windows, vehicle, layout, *begin)

    def moved_to(start: Floats, bins: Floats) -> Smoothed:
        if bends:
            return local_slopes(windows, vehicle, layout, start, bins)
        residual, _ = flown(actuate(windows, vehicle), layout, start[:, None], bins[:, None])
        return replace(state, start=start, bins=bins, residual=residual[:, 0])

    damping = np.full(len(windows), 1e-4)
    for _ in range(rounds):
        start, bins = state.start.copy(), state.bins.copy()
        for some in chunks(len(windows), state.slope[:1].nbytes):
            slope = state.slope[some] * weight[:, None]
            gram = slope.swapaxes(1, 2) @ slope + np.diag(precision)
            damped = gram + damping[some, None, None] * np.eye(layout.size) * np.einsum("wll->wl", gram)[:, None]
            pull = (slope.swapaxes(1, 2) @ (state.residual[some] * weight)[..., None])[..., 0]
            pull -= precision * layout.away(windows.subset(some), state.start[some], state.bins[some])
            move = np.linalg.solve(damped, pull[..., None])[..., 0]
            start[some, layout.start] += move[:, : len(layout.start)]
            bins[some] += move[:, len(layout.start) :].reshape(bins[some].shape)
        fresh = moved_to(start, bins)
        better = cost(fresh) < cost(state)
        damping = np.where(better, damping * 0.1, damping * 30.0)
        state = fresh if better.all() else replaced(windows, vehicle, layout, fresh, ~better, state.rows(~better))
    return state


def replaced(
    windows: Windows, vehicle: Vehicle, layout: Layout, state: Smoothed, rows: np.ndarray, by: Smoothed
) -> Smoothed:
    """The state of ``windows`` with some of them, by mask or number, from another one of the same vehicle (1,)."""
    merged = [np.copy(field) for field in fields(state)]
    for old, new in zip(merged, fields(by), strict=True):
        old[rows] = new
    slope = None
    if state.slopes.is_held:  # it is worked out again where that state is still needed
        some, slope = by.slope, state.slopes.taken()
        slope[rows] = some
    return _of_fields(merged, slopes_along(windows, vehicle, layout, tuple(merged[3:]), slope))


@DIVERGING
def flown(actuation: Actuation, layout: Layout, start: Floats, bins: Floats) -> tuple[Floats, Floats]:
    """Measured less predicted (W, R, K) and states (W, R, S + 1, 13) at starts (W, R, 12) and bins (W, R, B, D)."""
    windows = actuation.windows
    predicted, states = fly(actuation, start, layout.force(bins, windows.steps))
    return windows.residual(predicted).reshape(*start.shape[:2], -1), states


def _of_fields(arrays: list[Floats], slopes: Slopes) -> Smoothed:
    """The state of these arrays, in the order of :func:`fields`."""
    start, bins, residual, inward, transition, push, feel = arrays
    return Smoothed(start, bins, residual, inward, transition, push, feel, slopes)


def fields(state: Smoothed) -> tuple[Floats, ...]:
    """The arrays of a smoothed state, in order, but for the slopes."""
    return state.start, state.bins, state.residual, state.inward, state.transition, state.push, state.feel


def follow(
    windows: Windows, vehicle: Vehicle, layout: Layout, sigma: dict[str, float], force_prior: Floats, begin: Floats
) -> Smoothed:
    """Smooth from far away: first pieces so short that even a wrong model stays near, then halves, then whole windows.

    Windows that are lost all the same go on while that helps: a vehicle that turns fast bends the way to the minimum.
    ``begin`` is a rough force (W, B, D), see :func:`rough_force`.
    """
    pieces = windows.split(PIECE_BINS * layout.steps_per_bin)
    guess = Inverse.of(coefficients(vehicle), windows.channels).as_reported(pieces.guess).copy()
    guess[:, np.setdiff1d(np.arange(12), layout.start)] = 0.0  # held
    short, pushed = replace(layout, bins=PIECE_BINS), begin.reshape(len(pieces), PIECE_BINS, -1)
    near = smooth(pieces, vehicle, short, sigma, force_prior, (guess, pushed), rounds=2, bends=False)
    half = layout.bins // 2
    if half > PIECE_BINS and half % PIECE_BINS == 0:
        halves, short = windows.split(half * layout.steps_per_bin), replace(layout, bins=half)
        near = smooth(halves, vehicle, short, sigma, force_prior, _joined(near, len(halves)), rounds=2)
    state = smooth(windows, vehicle, layout, sigma, force_prior, _joined(near, len(windows)))
    left = misfit(windows, state.residual, sigma)
    lost = left > LOST
    for _ in range(MORE_TURNS if lost.any() else 0):
        on = state.start[lost], state.bins[lost]
        again = smooth(windows.subset(lost), vehicle, layout, sigma, force_prior, on)
        state = replaced(windows, vehicle, layout, state, lost, again)
        before, left = left, misfit(windows, state.residual, sigma)
        lost &= (left > LOST) & (left < STILL_FALLS * before)
        if not lost.any():
            break
    return state


def _joined(pieces: Smoothed, count: int) -> tuple[Floats, Floats]:
    """Starts (count, 12) and forces (count, B, D) of longer windows, each of as many pieces."""
    return pieces.start.reshape(count, -1, 12)[:, 0], pieces.bins.reshape(count, -1, pieces.bins.shape[-1])


@DIVERGING
def misfit(windows: Windows, residual: Floats, sigma: dict[str, float]) -> Floats:
    """Root mean square (W,) of the residual of each window in units of the noise; infinite where it diverged."""
    scaled = (residual / noise_per_sample(windows, sigma)) ** 2
    mean = scaled.sum(1) / np.maximum(windows.numbers_of_each, 1.0)
    return np.sqrt(np.where(np.isfinite(mean), mean, np.inf))


def local_parabolas(windows: Windows, measured: Floats, times: Floats) -> Floats:
    """Value, first and second derivative (W, B, 3, k) of numbers ``measured`` (W, m, k), at ``times`` (B,) s."""
    at = windows.sampled
    away = at[:, None] - times[:, None]  # (W, B, m)
    distance = np.where(windows.present[:, None], np.abs(away), np.inf)
    least = min(LEAST_SAMPLES, distance.shape[-1])
    reach = np.maximum(np.partition(distance, least - 1, axis=-1)[..., least - 1] * 1.01, REACH_S)
    weight = (distance <= reach[..., None]).astype(float)
    powers = np.stack([np.ones_like(away), away, 0.5 * away**2], axis=-1) * weight[..., None]  # (W, B, m, 3)
    gram = powers.swapaxes(-1, -2) @ powers + 1e-12 * np.eye(3)
    return np.linalg.solve(gram, powers.swapaxes(-1, -2) @ measured[:, None])


@DIVERGING
def rough_force(windows: Windows, vehicle: Vehicle, layout: Layout) -> Floats:
    """Missing force (W, B, D) in N and N m per bin; ``vehicle`` is a batch (1,)."""
    centres = (np.arange(layout.bins) + 0.5) * layout.steps_per_bin * windows.dt
    centres = np.minimum(centres, (windows.steps - 0.5) * windows.dt)
    turns = local_parabolas(windows, attitudes(_spread(windows, windows.measured)), centres)
    fits = local_parabolas(windows, windows.measured, centres)  # of angles too, which nobody reads
    value, slope, bend = (_spread(windows, fits[:, :, order]) for order in range(3))  # (W, B, 12) each
    quaternion = normalise(turns[:, :, 0])
    to_body = rotation_matrix(quaternion).swapaxes(-1, -2)
    velocity, rate = value[..., 6:].copy(), slope[..., 6:].copy()
    spinning, turning_up = (body_rate(quaternion, turns[:, :, order]) for order in (1, 2))
    for columns, first, second in (
        (slice(0, 3), matvec(to_body, slope[..., :3]), matvec(to_body, bend[..., :3])),
        (slice(3, 6), spinning, turning_up),
    ):
        turning = cross(spinning, first) if columns.start == 0 else 0.0
        known = np.array([channel in windows.channels for channel in MOTION[6:][columns]])
        velocity[..., columns] = np.where(known, velocity[..., columns], first)
        rate[..., columns] = np.where(known, rate[..., columns], second - turning)
    motion = np.concatenate([value[..., :3], quaternion, velocity], axis=-1)
    by_step = np.repeat(motion, layout.steps_per_bin, axis=1)[:, : windows.steps]
    actuation = actuate(windows, vehicle)
    rate[..., :3] = _with_specific_force(windows, actuation.c, fits[:, :, 0], motion, rate[..., :3])
    predicted = accelerations(actuation, by_step)[:, 0]
    missing = np.repeat(rate, layout.steps_per_bin, axis=1)[:, : windows.steps] - predicted
    missing = actuation.sensors.true_rate(missing, by_step)
    force = matvec(actuation.c.mass_matrix[0], missing)[..., layout.dof]
    edges = np.arange(0, windows.steps, layout.steps_per_bin)
    counts = np.diff(np.append(edges, windows.steps))
    return np.add.reduceat(force, edges, axis=1) / counts[:, None]


def _with_specific_force(windows: Windows, c: Coefficients, fits: Floats, motion: Floats, rate: Floats) -> Floats:
    """Accelerations (W, B, 3), from specific force, in fits (W, B, C), along axes that no other channel measures."""
    rate = rate.copy()
    for axis, name in enumerate(FELT):
        if name in windows.channels and not {MOTION[axis], MOTION[6 + axis]} & set(windows.channels):
            weight = read(c.rows((slice(None), None)), (name,), motion_of(motion))[..., 0]
            rate[..., axis] = fits[..., windows.channels.index(name)] - weight
    return rate


def _spread(windows: Windows, values: Floats) -> Floats:
    """Values (W, B, C) of the channels as columns of all twelve, zero where not measured."""
    full = np.zeros((*values.shape[:-1], 12))
    moved, columns = columns_of_motion(windows.channels)
    full[..., columns] = values[..., moved]
    return full
