"""What shows before effects are looked for: sensors that contradict each other, and a moment at which a gap begins.

Effects are looked for along the motion that was measured. Where a late position and a Doppler log, or a turned compass
and a Doppler log, tell of two motions, there is no such motion until the right change of a sensor is known. So each
change of a sensor is tried by what matters first: whether some force makes the vehicle follow all that was measured.

A vehicle that changes during its log has a moment before which the simulator is right and behind which it is not.
"""

from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.following import follow_freely, follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import Candidate, Settings, batch
from auv_torchrl.diagnosis.identify.paths import WindowPath
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.actuation import actuate_prepared, coefficients
from auv_torchrl.diagnosis.motion.smooth import misfit
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import (
    AGREES_AS_WELL,
    AGREES_BETTER,
    BLOCK_S,
    FEWEST_BLOCKS,
    FEWEST_WINDOWS,
    LARGER,
    MOSTLY_LOST,
    ONSET_CLEAR,
    SPEAKS,
    TRIED_WINDOWS,
)
from auv_torchrl.effects import EFFECTS, Origin
from auv_torchrl.sensors import FELT, MOTION, report_otherwise
from auv_torchrl.vehicle import Vehicle


def follow_agreeing(problem: Problem) -> tuple[Problem, WindowPath]:
    """The windows followed under the nominal vehicle, or where it cannot follow them, under one with another sensor."""
    problem, follow = follow_windows(problem)
    if problem.followed.mean() > MOSTLY_LOST or not tells_twice(problem):
        return problem, follow
    sensor = agreeing_sensor(problem)
    if sensor is None:
        return problem, follow
    problem, follow = follow_windows(problem, sensor)
    fitted = fit_by_simulation(problem, sensor, follow).explanation  # a value nearby makes outliers of good samples
    return follow_windows(problem, replace(fitted, nuisance={}))


def tells_twice(problem: Problem) -> bool:
    """Whether sensors could contradict each other: a force follows any motion that each of them tells of alone."""
    here = set(problem.windows.channels)
    return any(len({MOTION[d], MOTION[d + 6], *FELT[d : d + 1]} & here) > 1 for d in problem.layout.dof)


def agreeing_sensor(problem: Problem) -> Explanation | None:
    """The change of one sensor under which windows are followed best; None where none helps much.

    A compass that is turned to port agrees with positions as well as a Doppler log that is turned to starboard.
    Thrusters tell which it is: under the other one a force is missing.
    """
    rows = np.unique(np.linspace(0, len(problem.windows) - 1, TRIED_WINDOWS).astype(int))
    some = problem.windows.subset(rows)
    candidates = _that_show(problem)

    def followed(candidate: Candidate | None) -> tuple[float, float]:
        vehicle = batch(problem.vehicle, [{candidate.effect: candidate.values} if candidate else {}])
        state = follow_freely(problem, some, vehicle)
        missing = np.median(((state.bins / problem.floor) ** 2).mean((1, 2)))
        return float(np.median(misfit(some, state.residual, problem.sigma))), float(np.nan_to_num(missing, nan=np.inf))

    best: dict[str, tuple[float, float, Candidate]] = {}
    for candidate in candidates:
        tried = (*followed(candidate), candidate)
        if candidate.effect not in best or tried[0] < best[candidate.effect][0]:
            best[candidate.effect] = tried
    least = min((badness for badness, *_ in best.values()), default=np.inf)
    if not least < AGREES_BETTER * followed(None)[0]:
        return None
    near_best = [tried for tried in best.values() if tried[0] <= AGREES_AS_WELL * least]
    return Explanation().with_candidate(min(near_best, key=lambda tried: tried[1])[-1], problem.vehicle)


def _that_show(problem: Problem) -> list[Candidate]:
    """Changes of sensors that change a channel of the log: under all others it is followed as under none."""
    changes = [candidate for candidate in problem.candidates if EFFECTS[candidate.effect].origin is Origin.SENSING]
    if not changes:
        return []
    after = coefficients(batch(problem.vehicle, [{change.effect: change.values} for change in changes]))
    shows = report_otherwise(coefficients(batch(problem.vehicle, [{}])), after, problem.windows.channels)
    return [change for change, its in zip(changes, shows, strict=True) if its]


@dataclass(frozen=True)
class Onset:
    """A moment of a log, and the windows that lie wholly before and behind it."""

    log_s: float  # s into the log, episodes one after another
    episode: int  # its number
    episode_s: float  # s since the start of that episode
    before: np.ndarray  # (W,) bool
    behind: np.ndarray  # (W,) bool


def find_onset(problem: Problem, follow: WindowPath) -> Onset | None:
    """The moment at which the missing force sets in, None where it is not small before and large behind.

    The force in each degree of freedom is taken as white with one size before the moment and another behind it, and
    the moment is where that is most likely. None, too, where the vehicle sets in then: nothing shows before it moves.
    """
    windows, layout = problem.windows, problem.layout
    count, width = blocks(problem)
    bins = follow.state.bins[:, : count * width]
    scatter, floor = force_scatter(problem, follow)
    force = bins.reshape(len(bins), count, width, -1).mean(2) / scatter
    time = windows.time[:, None] + np.arange(count) * width * layout.steps_per_bin * windows.dt
    owner = np.repeat(np.arange(len(windows)), count)
    order = np.lexsort((time.ravel(), windows.episode[owner]))
    force = force.reshape(len(owner), -1)
    order = order[np.isfinite(force[order]).all(1)]  # a window that nothing follows says nothing of when
    energy = np.cumsum(force[order] ** 2 + floor, axis=0)
    total = len(energy)
    if total <= 2 * FEWEST_BLOCKS:
        return None
    splits = np.arange(FEWEST_BLOCKS, total - FEWEST_BLOCKS)[:, None]
    before = energy[splits[:, 0] - 1] / splits
    behind = (energy[-1] - energy[splits[:, 0] - 1]) / (total - splits)
    whole = energy[-1] / total
    gain = 0.5 * (total * np.log(whole) - splits * np.log(before) - (total - splits) * np.log(behind))
    gain = np.where(behind > before, gain, 0.0).sum(1)
    best = int(np.argmax(gain))
    if gain[best] < ONSET_CLEAR or not (behind[best] > LARGER * before[best]).any():
        return None
    first = order[splits[best, 0]]
    window, within = owner[first], float(time.ravel()[first])
    episode = windows.episode[window]
    end = windows.time + windows.steps * windows.dt
    passed = sum(end[windows.episode == earlier].max(initial=0.0) for earlier in range(episode))
    here = windows.episode == episode
    early = (windows.episode < episode) | (here & (end <= within))
    late = (windows.episode > episode) | (here & (windows.time >= within + BLOCK_S))  # it is known to a block
    if early.sum() < FEWEST_WINDOWS or late.sum() < FEWEST_WINDOWS or _wakes_up(windows, follow, early, late):
        return None
    return Onset(float(passed) + within, int(windows.number[window]), within, early, late)


def _wakes_up(windows: Windows, follow: WindowPath, early: np.ndarray, late: np.ndarray) -> bool:
    """Whether what the thrusters change and how the vehicle moves both grow from ``early`` to ``late`` windows (W,).

    By as much as the missing force must: what is wrong with a vehicle shows in proportion to them.
    """
    actuation = actuate_prepared(windows, follow.coefficients)
    thrust = actuation.targets(slice(0, len(windows)), np.arange(windows.steps))[0][:, 0]  # (W, S, n)
    speed, mass = follow.states[:, :-1, 7:], follow.coefficients.mass_matrix[0]
    driven = [thrust[some].reshape(-1, thrust.shape[-1]).var(0).sum() for some in (early, late)]
    moving = [np.einsum("wsi,ij,wsj", speed[some], mass, speed[some]) / some.sum() for some in (early, late)]
    return all(behind > LARGER * before for before, behind in (driven, moving))


def blocks(problem: Problem) -> tuple[int, int]:
    """How many blocks of a window the force is averaged over, and how many bins each has, :data:`BLOCK_S` of them."""
    layout = problem.layout
    width = min(max(1, round(BLOCK_S / (layout.steps_per_bin * problem.windows.dt))), layout.bins)
    return layout.bins // width, width


def force_scatter(problem: Problem, follow: WindowPath) -> tuple[Floats, float]:
    """What the mean force in :func:`blocks` scatters by, (D,) or (W, count, D), and its square that is noise.

    White noise is the same everywhere, and it takes no size. Other errors come with manoeuvres, which begin and end: a
    force that they account for tells of no change.
    """
    if problem.windows.whitening is None:
        return problem.wide, 0.0
    covariance = problem.freedom(follow.state, problem.wide).inverse
    first, axes = len(problem.layout.start), len(problem.layout.dof)
    count, width = blocks(problem)
    scatter = np.empty((len(covariance), count, axes))
    for block, axis in np.ndindex(count, axes):
        at = first + np.arange(block * width, (block + 1) * width) * axes + axis
        scatter[:, block, axis] = np.sqrt(covariance[:, at[:, None], at].mean((1, 2)))
    return scatter, 1.0


def is_absent(problem: Problem, onset: Onset, explanation: Explanation, vehicle: Vehicle, settings: Settings) -> bool:
    """Whether an explanation of what lies behind an onset is wrong before it: then the vehicle did change."""
    early = Problem.of(problem.windows.subset(onset.before), vehicle, settings, problem.known)
    early, follow = follow_windows(early)
    without = fit_by_simulation(early, Explanation(nuisance=explanation.nuisance), follow, rounds=0)
    with_it = fit_by_simulation(early, explanation, follow, rounds=0)
    return without.chi2 + SPEAKS < with_it.chi2
