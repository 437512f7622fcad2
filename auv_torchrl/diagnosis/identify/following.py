"""Windows that follow the log under an explanation, each from a start and with a disturbance of its own."""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.hypotheses import batch
from auv_torchrl.diagnosis.identify.paths import WindowPath, force_of_nuisance, nuisance_now, quadratic
from auv_torchrl.diagnosis.identify.problem import HealthyPrior, Problem
from auv_torchrl.diagnosis.motion.actuation import actuate, coefficients
from auv_torchrl.diagnosis.motion.noise import sensor_noise, whiten
from auv_torchrl.diagnosis.motion.reduce import Freedom, chi_square, settle
from auv_torchrl.diagnosis.motion.smooth import (
    Layout,
    Smoothed,
    flown,
    follow,
    local_slopes,
    misfit,
    noise_per_sample,
    replaced,
    rough_force,
)
from auv_torchrl.diagnosis.motion.windows import Floats, Windows, affordable
from auv_torchrl.diagnosis.thresholds import (
    DIVERGED,
    FEW_LOST,
    FOLLOWED,
    HEIRS,
    LEAVES_LITTLE,
    LOST,
    LOST_START,
    MANY_OUTLIERS,
    MOSTLY_LOST,
    OUTLIER,
    SETTLING,
    STUCK,
    TELLS,
    UNTOLD,
)
from auv_torchrl.vehicle import Vehicle

NOTHING = Explanation()


def follow_windows(problem: Problem, explanation: Explanation = NOTHING) -> tuple[Problem, WindowPath]:
    """The windows under an explanation, by default none, with a wide force, and the problem with what that shows.

    It shows outliers, the noise, where windows begin, and in which of them the motion is known.

    The force changes faster where bins of the usual length cannot follow, as under a limit cycle, and memory allows it.
    """
    problem = replace(
        problem,
        windows=problem.given,
        layout=Layout.of(problem.given, problem.vehicle, problem.settings.bin_s),
        sigma=problem.believed(problem.rough_noise),
    )
    vehicle = batch(problem.vehicle, [explanation.values(problem.vehicle)])
    if problem.given.errors.coloured:
        begin = problem.given.guess, rough_force(problem.given, vehicle, problem.layout)
        problem = replace(problem, windows=whiten(problem.given, vehicle, problem.layout, problem.sigma, begin))
    problem, state = _weigh_outliers(problem, vehicle, follow_freely(problem, problem.windows, vehicle))
    while (
        np.median(misfit(problem.windows, _beside_offsets(problem.windows, state.residual), problem.sigma)) > FOLLOWED
        and problem.layout.steps_per_bin > 2
    ):
        steps = problem.layout.steps_per_bin  # windows are whole numbers of bins: half as long, or the next divisor
        finer = max(k for k in range(1, steps // 2 + 1) if steps % k == 0)
        layout = Layout.of(problem.windows, problem.vehicle, finer * problem.windows.dt)
        if layout.bins > problem.windows.measured.shape[1]:  # nothing tells of a force between two samples
            break
        if len(problem.windows) > affordable(problem.windows.trust[0].size, layout.size, problem.given.errors.coloured):
            break
        problem = replace(problem, layout=layout)
        state = follow_freely(problem, problem.windows, vehicle)
    followed = _are_followed(problem, vehicle, state)
    sigma = problem.sigma
    if problem.windows.whitening is None:
        measured = sensor_noise(problem.windows, state, problem.sigma, problem.wide)
        sigma = problem.believed({n: min(measured.get(n, size), size) for n, size in problem.sigma.items()})
    states = flown(actuate(problem.windows, vehicle), problem.layout, *_one_row(state)[:2])[1]
    path = WindowPath(explanation, vehicle, state, states[:, 0], problem.windows)
    problem = replace(problem, sigma=sigma, followed=followed, seen_start=state.start)
    return _with_nuisance_of(problem, path), path


def followed_as_before(problem: Problem, before: Problem, path: WindowPath) -> Problem:
    """The problem of another vehicle, with what following the same windows has shown ``before``, and their path.

    A wide force follows whatever the vehicle is, so that the motion, the outliers and the noise are the same.
    """
    shown = "windows", "layout", "sigma", "followed", "seen_start"
    return _with_nuisance_of(replace(problem, **{name: getattr(before, name) for name in shown}), path)


def _with_nuisance_of(problem: Problem, path: WindowPath) -> Problem:
    """The problem with the nuisance parameters of which its windows tell, and the size of their force."""
    if problem.known is not None:
        problem = hold_unseen(problem, problem.known, path)
    return replace(problem, nuisance_size=force_of_nuisance(problem, path))


def _are_followed(problem: Problem, vehicle: Vehicle, state: Smoothed) -> np.ndarray:
    """Windows (W,) in which the motion is known: the free force leaves noise, or little of what the vehicle misses.

    A vehicle whose plugs are exchanged tumbles, and its thrust changes faster than a force per bin. That force leaves
    many times the noise then, and still a hundredth of what the vehicle misses without it.
    """
    left = misfit(problem.windows, _beside_offsets(problem.windows, state.residual), problem.sigma)
    without = np.zeros_like(state.bins)
    missed, _ = flown(actuate(problem.windows, vehicle), problem.layout, state.start[:, None], without[:, None])
    followed: np.ndarray = left < np.maximum(LOST, LEAVES_LITTLE * misfit(problem.windows, missed[:, 0], problem.sigma))
    return followed


def _weigh_outliers(problem: Problem, vehicle: Vehicle, state: Smoothed) -> tuple[Problem, Smoothed]:
    """Take weight from samples that no force could have reached, and follow their windows again.

    The loss is redescending: beyond the threshold a sample counts the less the farther it is off, so that what is
    left of chi-square is about the rest. Samples are fit where the simulator's error plays no part; later, a
    large residual may be the simulator's.
    """
    windows = problem.windows
    far = np.abs(_beside_offsets(windows, state.residual)) / noise_per_sample(windows, problem.sigma)
    far = np.where(np.isfinite(far), far, 0.0)
    some = (far > OUTLIER).any(1) & ((far > OUTLIER).mean(1) < MANY_OUTLIERS)
    if not some.any():
        return problem, state
    factor = (OUTLIER / np.maximum(far, OUTLIER)) ** 2
    factor = np.where(some[:, None], factor, 1.0).reshape(windows.trust.shape)
    problem = replace(problem, windows=replace(windows, trust=windows.trust * factor))
    again = follow_freely(problem, problem.windows.subset(some), vehicle)
    return problem, replaced(problem.windows, vehicle, problem.layout, state, some, again)


def _beside_offsets(windows: Windows, residual: Floats) -> Floats:
    """What is left (W, K), less what a channel that is felt is off by throughout: that is no motion, and no outlier."""
    if not windows.specific_force.any():
        return residual
    left = residual.reshape(windows.trust.shape).copy()
    for column in np.flatnonzero(windows.specific_force):
        seen = (windows.trust[..., column] > 0) & np.isfinite(left[..., column])
        if seen.any():
            left[..., column] -= np.where(seen, np.median(left[..., column][seen]), 0.0)
    return left.reshape(residual.shape)


def follow_freely(problem: Problem, windows: Windows, vehicle: Vehicle, prior: Floats | None = None) -> Smoothed:
    """Some windows under a vehicle (1,), with a force held by a ``prior`` (D,), by default a wide one."""
    begin = rough_force(windows, vehicle, problem.layout)
    return follow(windows, vehicle, problem.layout, problem.sigma, problem.wide if prior is None else prior, begin)


def path_under(problem: Problem, explanation: Explanation, start: WindowPath) -> WindowPath:
    """The windows under another explanation, from what is left of the force when the explanation is taken out."""
    vehicle = batch(problem.vehicle, [explanation.values(problem.vehicle)])
    explained = start.course.forces(coefficients(vehicle))[:, 0, :, problem.layout.dof]
    edges = np.arange(0, problem.windows.steps, problem.layout.steps_per_bin)
    counts = np.diff(np.append(edges, problem.windows.steps))
    explained = np.moveaxis(explained, 0, -1)  # an index array behind a slice puts its axis first
    bins = start.state.bins - np.add.reduceat(explained, edges, axis=1) / counts[:, None]
    state = local_slopes(problem.windows, vehicle, problem.layout, start.state.start, bins)
    path = settle_path(problem, explanation, vehicle, state)
    lost = misfit(problem.windows, path.state.residual, problem.sigma) > LOST
    if lost.any() and lost.mean() < MOSTLY_LOST:  # the start was no good; it may be under the right vehicle
        fresh = follow_freely(problem, problem.windows.subset(lost), vehicle, problem.floor)
        path = settle_path(
            problem, explanation, vehicle, replaced(problem.windows, vehicle, problem.layout, path.state, lost, fresh)
        )
    return hand_on(problem, path)


def hand_on(problem: Problem, path: WindowPath) -> WindowPath:
    """Windows that got stuck begin anew: where a free force had them begin, or where the one before them ends."""
    windows = problem.windows
    follows = (windows.episode[:, None] == windows.episode) & (windows.start[:, None] == windows.start + windows.steps)
    before = np.where(follows.any(1), follows.argmax(1), -1)
    chi2 = chi2_by_window(problem, path.state)
    lost = np.flatnonzero(_astray(chi2))
    if len(lost) and _stuck(problem, chi2).mean() <= MOSTLY_LOST:
        path = _begun_anew(problem, path, lost, problem.seen_start[lost])
    for _ in range(HEIRS):
        chi2 = chi2_by_window(problem, path.state)
        stuck, astray = _stuck(problem, chi2), _astray(chi2)
        heirs = np.flatnonzero((before >= 0) & ((stuck & ~stuck[before]) | (astray & ~astray[before])))
        if not len(heirs) or stuck.mean() > MOSTLY_LOST:
            break
        ends = path.course.sensors.reported_start(path.states[:, -1])  # (W, 12), as the start of what follows
        fresh = _begun_anew(problem, path, heirs, ends[before[heirs]])
        if fresh is path:
            break
        path = fresh
    return path


def _stuck(problem: Problem, chi2: Floats) -> np.ndarray:
    """(W,) windows that leave more, by their ``chi2`` (W,), than an explanation that is about right would."""
    return ~(chi2 < STUCK * problem.windows.numbers_of_each)


def _astray(chi2: Floats) -> np.ndarray:
    """(W,) windows that leave far more than others, whatever the explanation misses in all of them."""
    return ~(chi2 < LOST_START * np.median(chi2))


def some_diverged(problem: Problem, *bases: WindowPath) -> bool:
    """Whether some windows, but few, diverge in one of these."""
    astray = [chi2_by_window(problem, path.state) >= DIVERGED for path in bases]
    return any(lost.any() for lost in astray) and all(lost.mean() < FEW_LOST for lost in astray)


def chi2_by_window(problem: Problem, state: Smoothed) -> Floats:
    """What each window leaves (W,), its free numbers paid for."""
    return chi_square(problem.windows, problem.layout, problem.freedom(state), *_one_row(state))[:, 0]


def _begun_anew(problem: Problem, path: WindowPath, rows: np.ndarray, starts: Floats) -> WindowPath:
    """The path with some windows settled from other starts (rows, 12), where that is better."""
    layout, state = problem.layout, path.state
    some = problem.windows.subset(rows)
    fresh = local_slopes(some, path.vehicle, layout, starts, np.zeros_like(state.bins[rows]))
    freedom = Freedom.of(some, layout, fresh.slope, problem.sigma, problem.floor)
    start, bins, residual, _ = settle(some, path.vehicle, layout, freedom, *_one_row(fresh), SETTLING)
    chi2 = chi_square(some, layout, freedom, start, bins, residual)[:, 0]
    better = chi2 < chi2_by_window(problem, state)[rows]
    if not better.any():
        return path
    fresh = replace(fresh, start=start[:, 0], bins=bins[:, 0], residual=residual[:, 0])
    state = replaced(problem.windows, path.vehicle, problem.layout, state, rows[better], fresh.rows(better))
    return settle_path(problem, path.explanation, path.vehicle, state)


def nudge(problem: Problem, explanation: Explanation, start: WindowPath) -> WindowPath:
    """The windows under an explanation that differs a little from that of ``start``."""
    vehicle, state = batch(problem.vehicle, [explanation.values(problem.vehicle)]), start.state
    fresh = settle(problem.windows, vehicle, problem.layout, problem.freedom(state), *_one_row(state)[:2])
    return WindowPath(explanation, vehicle, *_taken_on(state, fresh), problem.windows)


def nudged_chi2(problem: Problem, explanations: list[Explanation], start: WindowPath, steps: int = 1) -> Floats:
    """Chi-square (R,), that of nuisance parameters included, of explanations that differ a little from ``start``."""
    vehicles = batch(problem.vehicle, [explanation.values(problem.vehicle) for explanation in explanations])
    freedom = problem.freedom(start.state)
    starts = np.repeat(start.state.start[:, None], len(explanations), axis=1)
    bins = np.repeat(start.state.bins[:, None], len(explanations), axis=1)
    *settled, _ = settle(problem.windows, vehicles, problem.layout, freedom, starts, bins, steps=steps)
    nuisance = np.stack([nuisance_now(problem, explanation) for explanation in explanations])
    chi2 = chi_square(problem.windows, problem.layout, freedom, *settled).sum(0)
    return chi2 + ((nuisance @ problem.nuisance_precision) * nuisance).sum(-1)


def settle_path(problem: Problem, explanation: Explanation, vehicle: Vehicle, state: Smoothed) -> WindowPath:
    """The windows under an explanation, settled from a state near by whose residual is that of the vehicle."""
    settled = settle_state(problem, vehicle, state, problem.freedom(state))
    return WindowPath(explanation, vehicle, *settled, problem.windows)


def settle_state(problem: Problem, vehicle: Vehicle, state: Smoothed, freedom: Freedom) -> tuple[Smoothed, Floats]:
    """The state after steps of its free numbers, and the motion (W, S + 1, 13) that it goes through."""
    return _taken_on(state, settle(problem.windows, vehicle, problem.layout, freedom, *_one_row(state), SETTLING))


def _taken_on(state: Smoothed, settled: tuple[Floats, ...]) -> tuple[Smoothed, Floats]:
    """The state with what :func:`settle` found for it, and the motion."""
    start, bins, residual, states = (field[:, 0] for field in settled)
    return replace(state, start=start, bins=bins, residual=residual), states


def _one_row(state: Smoothed) -> tuple[Floats, Floats, Floats]:
    return state.start[:, None], state.bins[:, None], state.residual[:, None]


def hold_unseen(problem: Problem, known: HealthyPrior, follow: WindowPath) -> Problem:
    """The problem with nuisance parameters as wide as ``known`` only along directions of which its windows tell.

    Healthy flights leave open what changes no motion, as twice the inertia with twice the thrust and drag. Such a
    direction costs a fit nothing to first order, and the fit would go to its bound for no reason. The intervals of the
    fitted values take the whole width (:func:`auv_torchrl.diagnosis.identify.sure.as_sure`).

    Windows tell as much of a nuisance parameter whose effect they are followed under: what is asked is the nominal
    vehicle along their motion.
    """
    A = quadratic(replace(problem, nuisance=known.nuisance), follow, [], around=NOTHING, chosen=problem.followed).A
    if not np.isfinite(A).all():
        return problem
    size, direction = np.linalg.eigh(known.nuisance_covariance)
    root = direction * np.sqrt(np.maximum(size, 0.0))
    information, along = np.linalg.eigh(root.T @ A @ root)  # in standard deviations of nuisance parameters
    share = np.where(information < TELLS, UNTOLD, 1.0)
    held = root @ along * share
    covariance = held @ held.T
    widths = np.sqrt(np.diag(covariance)).tolist()
    nuisance = tuple((*entry[:3], width) for entry, width in zip(known.nuisance, widths, strict=True))
    precision = np.linalg.inv(covariance)
    return replace(problem, nuisance=nuisance, nuisance_covariance=covariance, nuisance_precision=precision)
