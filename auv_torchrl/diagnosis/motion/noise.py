"""Errors of a log that are no white noise, as a covariance of all numbers of a window, and how it is taken out.

Two of them are known before anything is explained. Commands that were logged as snapshots changed at some moment
between two of them, and what the vehicle did until then differs by the force that changed. And the estimates of a
filter go astray slowly, all samples together. Whitened, samples count for as much as is known of them.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.motion.actuation import ACTUATIONS, actuate, usual_speed
from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.motion.smooth import Layout, Smoothed, noise_per_sample
from auv_torchrl.diagnosis.motion.tangent import Tangent, linearise, respond
from auv_torchrl.diagnosis.motion.windows import Floats, Windows, chunks
from auv_torchrl.diagnosis.thresholds import BENT, FLICKERS, LEAST_FREEDOM, LEAST_NOISE
from auv_torchrl.flightlog.log import ANGLES
from auv_torchrl.flightlog.streams.drift import DRIFT_S
from auv_torchrl.physics.kinematics import matvec
from auv_torchrl.physics.pushes import wrench_per_unit
from auv_torchrl.sensors import CHANNELS
from auv_torchrl.sysid.windows import MEDIAN_TO_DEVIATION, THIRD_DIFFERENCE
from auv_torchrl.vehicle import Vehicle

MOMENTS = 101  # at which a command may have changed between two snapshots, to average over
ROUNDING = 12**-0.5  # standard deviation of a rounding error, in steps: no noise is believed below it
AT_ONCE = 4 << 20  # bytes of covariances: a dozen arrays as large are in use while they are worked out


@DIVERGING
def whiten(
    windows: Windows, vehicle: Vehicle, layout: Layout, sigma: dict[str, float], begin: tuple[Floats, Floats]
) -> Windows:
    """The windows with what turns their errors into white noise of ``sigma``.

    Args:
        windows: of a log that says what its errors are.
        vehicle: batch (1,).
        layout: of the free numbers of a window.
        sigma: white noise by channel.
        begin: starts (W, 12) and forces (W, B, D) under which the vehicle moves about as it did.
    """
    windows = replace(windows, whitening=None)  # they may come from a log that was whitened for another vehicle
    ACTUATIONS.clear()  # which hold windows that were whitened before, the largest arrays of all
    groups, k = _groups(windows)
    noise = noise_per_sample(windows, sigma).reshape(k, groups).T[..., None]  # (G, k, 1)
    whitening = np.empty((len(windows), groups, k, k), np.float32)  # the largest array: 7 digits will do
    for some, covariance in colour_in_pieces(windows, vehicle, layout, begin):
        scaled = covariance / (noise * noise.mT)
        inverse = np.linalg.inv(np.linalg.cholesky(np.eye(k) + scaled))
        whitening[some] = noise * inverse / noise.mT
    return replace(windows, whitening=whitening)


def _groups(windows: Windows) -> tuple[int, int]:
    """How many groups of numbers have errors that go together, and how many numbers each: see `Windows.whitening`."""
    samples, channels = windows.trust[0].shape
    return (1, samples * channels) if windows.errors.snapshot_s else (channels, samples)


def colour_in_pieces(
    windows: Windows, vehicle: Vehicle, layout: Layout, begin: tuple[Floats, Floats]
) -> Iterator[tuple[slice, Floats]]:
    """Some windows, and the covariance (w, G, k, k) of what is no white noise in them; arguments as of :func:`whiten`.

    Drifts go together within each channel alone, ``k`` samples of ``G`` channels. What commands do goes together in
    all ``k`` numbers of a window, one group.

    Piece by piece, because some such arrays are in use at once.
    """
    tangent = None
    if windows.errors.snapshot_s:
        start, bins = begin
        _, tangent = linearise(windows, vehicle, layout.start, start, layout.force(bins, windows.steps))
    groups, k = _groups(windows)
    for some in chunks(len(windows), 8 * groups * k**2, AT_ONCE):
        yield some, _colour(windows.subset(some), vehicle, layout, tangent and tangent.rows(some))


@DIVERGING
def _colour(windows: Windows, vehicle: Vehicle, layout: Layout, tangent: Tangent | None) -> Floats:
    """Covariance (w, G, k, k) of what is no white noise, along a tangent where commands were logged as snapshots."""
    drift = drift_covariance(windows)
    if tangent is None:
        return drift
    responses = command_responses(windows, vehicle, layout, tangent)
    bent = np.eye(responses.shape[1]) * (BENT**2 * (responses**2).sum(-1))[:, None]
    covariance = responses @ responses.swapaxes(1, 2) + bent
    w, channels, m, _ = drift.shape
    for column in range(channels):
        covariance.reshape(w, m, channels, m, channels)[:, :, column, :, column] += drift[:, column]
    covariance[~np.asarray(np.isfinite(covariance).all((1, 2)))] = 0.0  # no motion to work it out along
    return covariance[:, None]


def command_responses(windows: Windows, vehicle: Vehicle, layout: Layout, tangent: Tangent) -> Floats:
    """What the force that snapshots of commands do not tell would show, (W, K, S n / 2).

    Each column is a standard deviation of the samples of a window, one for each grid step and degree of freedom,
    independent of the others: the loops of an autopilot act on each axis by itself.
    """
    moves = layout.start[: len(layout.start) // 2]
    unknown = unknown_force(windows, vehicle)[..., moves].reshape(len(windows), 1, -1)
    unit = np.eye(windows.steps * len(moves)).reshape(1, windows.steps, len(moves), -1)
    nothing = np.zeros((1, len(layout.start), unit.shape[-1]))
    return unknown * respond(windows, tangent, nothing, unit)


def unknown_force(windows: Windows, vehicle: Vehicle) -> Floats:
    """Standard deviation (W, S, 6) in N and N m of the force in each grid step that snapshots do not tell.

    A command changed sooner or later than halfway between two snapshots, so that the old force went on or the new one
    came before; and a thruster at the edge of its dead band may have pushed or not.
    """
    actuation = actuate(windows, vehicle)
    (thrust,) = actuation.targets(slice(0, len(windows)), np.arange(-1, windows.steps + 1))
    thrust, c = thrust[:, 0], actuation.c  # (W, S + 2, n)
    allocation = wrench_per_unit(c, actuation.terms, usual_speed(windows))[0]  # (6, n)
    jump = np.diff(matvec(allocation, thrust), axis=1) ** 2  # (W, S + 1, 6) at the edges of the steps
    variance = np.zeros((len(windows), windows.steps, 6))
    for ago, share in enumerate(late_shares(windows.errors.snapshot_s, windows.dt)):
        variance[:, ago:] += share**2 * jump[:, : windows.steps - ago]  # late
        variance[:, : windows.steps - ago] += share**2 * jump[:, 1 + ago :]  # early
    edge = c.dead_band[0]
    flickers = np.abs(thrust[:, 1:-1]) < FLICKERS * edge
    return np.sqrt(variance + flickers * (edge / 2) ** 2 @ (allocation**2).T)


def late_shares(snapshot_s: float, dt: float) -> Floats:
    """Root mean square share of each grid step behind the middle between snapshots before a command changes.

    The change is as likely at any moment between two snapshots.
    """
    late = np.linspace(-0.5, 0.5, MOMENTS) * snapshot_s
    steps = np.arange(max(1, int(np.ceil(snapshot_s / 2 / dt - 1e-3))))
    covered = np.clip(late[:, None] / dt - steps, 0.0, 1.0)
    return np.sqrt((covered**2).mean(0))


def drift_covariance(windows: Windows) -> Floats:
    """Covariance (W, C, m, m) of channels whose error changes at a rate that lasts for a while.

    The rate is a first-order Gauss-Markov process, and its integral what Papoulis (1991, section 10-3) has.
    """
    t = windows.sampled
    first, last = np.minimum(t[:, :, None], t[:, None]), np.maximum(t[:, :, None], t[:, None])
    tau = DRIFT_S
    shape = 2 * tau * first - tau**2 * (1 - np.exp(-first / tau) - np.exp(-last / tau) + np.exp((first - last) / tau))
    trust = np.moveaxis(windows.trust, 2, 1)
    rates = np.array([windows.errors.drift.get(name, 0.0) for name in windows.channels])
    return rates[:, None, None] ** 2 * shape[:, None] * trust[..., None] * trust[..., None, :]


@DIVERGING
def sensor_noise(windows: Windows, state: Smoothed, sigma: dict[str, float], force_prior: Floats) -> dict[str, float]:
    """White noise of each channel, from what is left when a force held by ``force_prior`` (D,) has followed the rest.

    A channel with so few samples that the force follows its noise, too, is left out.
    """
    weight = 1.0 / noise_per_sample(windows, sigma)
    whole, leverage = state.slope, np.empty(state.residual.shape)
    starts = whole.shape[-1] - state.bins[0].size
    precision = np.concatenate([np.full(starts, 1e-6), np.tile(force_prior**-2, state.bins.shape[1])])
    for some in chunks(len(windows), whole[:1].nbytes):
        slope = whole[some] * weight[:, None]
        gram = slope.swapaxes(1, 2) @ slope + np.diag(precision)
        leverage[some] = np.einsum("wkl,wlk->wk", slope, np.linalg.solve(gram, slope.swapaxes(1, 2)))
    left = state.residual.reshape(windows.measured.shape)
    free = np.clip(1 - leverage.reshape(left.shape), 0.05, 1.0)
    noise = {}
    counts = windows.trust**2
    for column, channel in enumerate(windows.channels):
        seen = counts[..., column].sum(1) > 0
        freedom = (free[..., column] * counts[..., column])[seen].sum(1)
        if seen.any() and not freedom.sum() > LEAST_FREEDOM * counts[..., column].sum():
            continue
        squares = (left[seen][..., column] ** 2).sum(1) / freedom
        squares[~np.isfinite(squares)] = np.inf  # of a window that diverged
        size = np.sqrt(np.median(squares)) if seen.any() else 0.0  # the median: a few windows may be badly followed
        noise[channel] = float(max(size, windows.resolution[column] * ROUNDING, LEAST_NOISE))
    return noise


def first_noise(windows: Windows) -> dict[str, float]:
    """Rough white noise of each channel from third differences, which a smooth motion hardly has."""
    noise = {}
    for column, channel in enumerate(windows.channels):
        series = windows.measured[..., column]
        if channel in ANGLES:
            series = np.unwrap(series, axis=1)
        rows = zip(series, windows.trust[..., column] > 0, strict=True)
        third = np.concatenate([np.diff(window[seen], 3) for window, seen in rows if seen.sum() > 3] or [np.zeros(1)])
        scale = MEDIAN_TO_DEVIATION * np.median(np.abs(third)) / THIRD_DIFFERENCE
        floor = 1e-4 if CHANNELS.index(channel) < 6 else 1e-3
        noise[channel] = float(max(scale, floor, windows.resolution[column] * ROUNDING))
    return noise
