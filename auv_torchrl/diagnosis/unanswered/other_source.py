"""A channel that moves, but not with the vehicle: replayed, or of another source.

A sensor may contradict another one of the same motion. Which of the two is false is told by all others: without the
false one they leave nothing to explain, or far less than without the other.

Where no other sensor tells of the motion, the thrust does: along the measured motion such a channel tells of a force
that undoes what the thrusters push. So of each degree of freedom the share of the thrust that shows is fitted in every
window: about 1 in a vehicle that answers, and 0 where the channel tells nothing; of faulty thrusters a part shows. All
other channels must then be those of the vehicle as it should be: faults hide the thrust as well, but no other channel
leaves them out. Nor does the log as a whole, if exchanged plugs bring the thrust back.
"""

import sys
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.axes import hold_attitude
from auv_torchrl.diagnosis.identify.before_effects import follow_agreeing
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.paths import WindowPath, nuisance_does
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.localize.attribute import in_pieces
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import Z95
from auv_torchrl.diagnosis.unanswered.stillness import WHOLE, Stillness, channels_of, hardly_moves
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import FlightLog, FlightLogError
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.pushes import wrench_per_share
from auv_torchrl.sensors import FELT, MOTION
from auv_torchrl.vehicle import Vehicle

TELLING = 40  # windows, 80 s: they tell about how much all others leave
LEAST = 1e-9  # of a sum of squares: a vehicle that no disturbance moves leaves none
SURE = 5.0  # log odds from a moment on, beside which all other channels must fit
SOURCES = (0, 1), (2,), (3, 4), (5,)  # degrees of freedom that one sensor measures
ABOUT = 0.2  # of the thrust, by which the share that shows in a window of a sound vehicle is off at most
BEFORE = 3  # windows before the first that is off, which are left out too: thrust may show by chance
OF_POSITION, HEADING = ("x", "y"), "yaw"  # positions tell of a speed ahead by the heading alone
# What is of one source.
SENSORS = ("x", "y"), ("z",), ("roll", "pitch"), ("yaw",), ("u", "v", "w"), ("p", "q", "r"), FELT
CONTRADICTED = 0.05  # of the samples of a sensor: glitches of one that is alive make fewer of them outliers
PARTIES = 2  # sensors of a contradiction: which one is false is told by what the others leave


@dataclass(frozen=True)
class Suspect:
    """Channels that may be of another source."""

    stretches: tuple[Stillness, ...]  # in which they may be so: all along or from a moment on
    contradicts: bool  # whether another sensor tells of another motion, and not the thrust alone

    @property
    def channels(self) -> tuple[str, ...]:
        """Their names."""
        return channels_of(self.stretches)


def find_other_source(problem: Problem, follow: WindowPath) -> tuple[Suspect, ...]:
    """Channels that may be of another source, the likeliest first.

    Args:
        problem: with the vehicle as the file or healthy flights know it.
        follow: the measured motion.
    """
    return (*_contradicted(problem), *_unmoved(problem, follow))


def in_all_flight(
    suspect: Suspect, log: FlightLog, problem: Problem, sensor: Explanation, settings: Settings
) -> Suspect | None:
    """A suspect of a part of a log, with the stretches of held-out flight, too; None where all flight clears it.

    ``sensor`` is the change of a sensor under which that part was followed, or none. The part and its moment were
    chosen as the worst: held-out flight was not, and where thrust shows there, the channel follows the vehicle.
    """
    if suspect.contradicts:  # then it does all along
        return suspect
    everywhere = find_other_source(*follow_windows(_cut(log, problem, settings), sensor))
    return next((one for one in everywhere if one.channels == suspect.channels), None)


def _contradicted(problem: Problem) -> Iterator[Suspect]:
    """The sensors that no motion can agree with, as others tell of the same motion: those with the most outliers.

    An accelerometer tells of a motion, too, by how a speed changes.
    """
    windows = problem.windows
    measured, outlying = (windows.trust > 0).sum((0, 1)), problem.outlying.sum((0, 1))
    share = dict(zip(windows.channels, (outlying / np.maximum(measured, 1)).tolist(), strict=True))
    worst = sorted(SENSORS, key=lambda sensor: -max(share.get(name, 0.0) for name in sensor))
    for sensor in worst[:PARTIES]:
        names, rest = set(sensor) & set(share), set(share) - set(sensor)
        told_twice = all(rest & {*_channels(windows, d := _freedom(name)), *FELT[d : d + 1]} for name in names)
        if told_twice and any(share[name] > CONTRADICTED for name in names):
            yield Suspect(tuple(Stillness(name) for name in sorted(names)), contradicts=True)


def _unmoved(problem: Problem, follow: WindowPath) -> Iterator[Suspect]:
    """The channels in which the thrust does not show: all of them, or those of the one source where that is surest."""
    share, deviation = shares_shown(problem, follow)
    windows, sure = problem.windows, []
    for dof in SOURCES:
        columns = [column for column, d in enumerate(problem.layout.dof) if d in dof]
        names = {name for column in columns for name in _channels(windows, int(problem.layout.dof[column]))}
        odds = _odds_behind(share[:, columns], deviation[:, columns])
        begin = int(odds.argmax())
        if not (names and odds[begin] > SURE):
            continue
        gone = {*dof, *(SOURCES[0] if HEADING in names else ())}
        about = ABOUT if _others_tell(problem, follow, gone) else 0.0
        if none_shows(share[begin:, columns], deviation[begin:, columns], about):
            first = _answers_until(share[:, columns], deviation[:, columns])
            sure.append((HEADING in names, float(odds[begin]), first, names))
    if not sure:
        return
    *_, first, names = max(sure, key=lambda one: one[:2])  # a false heading makes positions false, too, not vice versa
    if set().union(*(one[-1] for one in sure)) >= set(windows.channels):
        names, first = set(windows.channels), max(one[-2] for one in sure)
    elif HEADING in names:
        names |= set(OF_POSITION) & set(windows.channels)
    stretches = tuple(entry for name in sorted(names) for entry in _entries(windows, name, first))
    yield Suspect(stretches, contradicts=False)


def share_of_held(log: FlightLog, vehicle: Vehicle, settings: Settings) -> float | None:
    """How far a vehicle that is held moves, of how far its commands should move it; None of one that swims.

    A vehicle that holds its place moves little, too, but for each thrust that does not move it something else must
    push against it: there, thrust shows in the motion. Of one that is held it shows in no degree of freedom.
    """
    share = hardly_moves(log, vehicle, settings)
    if share is None:
        return None
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)
    shown, deviation = shares_shown(*follow_agreeing(Problem.of(windows, hold_attitude(log, vehicle), settings)))
    odds = [float(_odds_behind(shown[:, [k]], deviation[:, [k]])[0]) for k in range(shown.shape[1])]
    return share if min(odds) > -SURE and sum(odds) > SURE else None


@dataclass(frozen=True)
class Left:
    """What a log leaves to explain of the vehicle of a problem."""

    excess: float  # chi-square per number
    is_nothing: bool


def left_by(log: FlightLog, problem: Problem, settings: Settings) -> Left:
    """What a log leaves; all of it, where it is too short to say so."""
    try:
        own, follow = follow_windows(_cut(log, problem, settings, TELLING))
    except FlightLogError:
        return Left(np.inf, is_nothing=False)
    fit = fit_by_simulation(own, Explanation(), follow)
    return Left(fit.excess, nuisance_does(own, fit))


def _cut(log: FlightLog, problem: Problem, settings: Settings, most: int = sys.maxsize) -> Problem:
    """The problem of another log of the same vehicle, of so many windows of it at most."""
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s).thinned(most)
    return Problem.of(windows, problem.vehicle, settings, problem.known)


def blamed(false: Sequence[Stillness]) -> tuple[Stillness, ...]:
    """Less the positions that a false heading makes false."""
    turned = any(entry.channel == HEADING for entry in false)
    return tuple(entry for entry in false if not (turned and entry.channel in OF_POSITION))


@DIVERGING
def shares_shown(problem: Problem, follow: WindowPath) -> tuple[Floats, Floats]:
    """Of the thrust in each degree of freedom the share (W, D) that a window shows, and its standard deviation.

    About 1 before anything was seen, with a deviation of 1.
    """
    dof = problem.layout.dof
    still = prepare(changed(follow.vehicle, gain=0.0 * follow.vehicle.gain)).numpy()
    share, deviation = np.ones((len(problem.windows), len(dof))), np.ones((len(problem.windows), len(dof)))

    def cut(some: slice) -> Floats:
        each = follow.course.rows(some).forces(still)  # (w, 1, S, 6), what is missing without thrust
        return np.concatenate([each * (np.arange(6) == d) for d in dof], axis=1)

    for some, parts in in_pieces(problem, follow, len(dof), cut):
        whole, finite = parts.by_window
        known = problem.followed[some] & finite
        inverse = np.linalg.inv(np.where(known[:, None, None], whole[:, 1:, 1:], 0.0) + np.eye(len(dof)))
        gone = (inverse @ np.where(known[:, None], whole[:, 0, 1:], 0.0)[..., None])[..., 0]
        share[some], deviation[some] = 1.0 - gone, np.sqrt(np.diagonal(inverse, axis1=1, axis2=2))
    return share, deviation


def _answers_until(share: Floats, deviation: Floats) -> int:
    """The first windows of which shares (W, D) are about 1, more of them than not, less a few: how many there are."""
    answers = (np.abs(share - 1) < ABOUT + deviation).all(1)
    return max(0, int(np.concatenate([[0], np.cumsum(np.where(answers, 1, -1))]).argmax()) - BEFORE)


def _odds_behind(share: Floats, deviation: Floats) -> Floats:
    """Log odds (W,) that of shares (W, D) none shows, over all of it, from each window on.

    Whatever else moves the channel, a false source or an unknown force, is as large under both: how large is not known.
    """
    weight = _seen(deviation)
    none, all_of_it = (np.cumsum((weight * (share - shown) ** 2).sum(1)[::-1])[::-1] + LEAST for shown in (0.0, 1.0))
    count = np.cumsum((weight > 0).sum(1)[::-1])[::-1]
    return 0.5 * count * np.log(all_of_it / none)


def _seen(deviation: Floats) -> Floats:
    """How much windows tell of shares, as inverse variances (W, D): what they know, less what was assumed of them."""
    seen: Floats = np.maximum(deviation**-2.0 - 1.0, 0.0)
    return seen


def none_shows(share: Floats, deviation: Floats, about: float) -> bool:
    """Whether the mean of shares (W, D) is 0 within ``about`` and its 95 % interval.

    Where a part of the thrust shows, the channel follows the vehicle, and something is wrong with the vehicle.
    """
    weight = _seen(deviation)
    mean = (weight * share).sum() / weight.sum()
    variance = (weight * (share - mean) ** 2).sum() / (weight > 0).sum() / weight.sum()
    return bool(abs(mean) < about + Z95 * np.sqrt(variance))


def _others_tell(problem: Problem, follow: WindowPath, gone: Collection[int]) -> bool:
    """Whether all thrusters that push in the degrees of freedom that are ``gone`` push in one that is left, too.

    A fault of theirs would then show in what is left. Where nothing left tells of them, a part of the thrust that shows
    may be their fault; else it is chance, as where the same manoeuvre is replayed.
    """
    pushes = wrench_per_share(follow.coefficients, ActiveTerms.of(follow.coefficients))[0] != 0  # (6, n)
    kept = [d for d in problem.layout.dof if d not in gone]
    return bool(pushes[kept].any(0)[pushes[list(gone)].any(0)].all())


def _freedom(channel: str) -> int:
    """The degree of freedom that a channel tells of."""
    return FELT.index(channel) if channel in FELT else MOTION.index(channel) % 6


def _channels(windows: Windows, d: int) -> tuple[str, ...]:
    """The channels that tell of a place or a speed in a degree of freedom."""
    tell = (*OF_POSITION, MOTION[6 + d]) if d < len(OF_POSITION) else (MOTION[d], MOTION[6 + d])
    return tuple(name for name in tell if name in windows.channels)


def _entries(windows: Windows, channel: str, first: int) -> Iterator[Stillness]:
    """All windows from one on, as stretches of their episodes; most windows are all of the log."""
    if len(windows) - first >= WHOLE * len(windows):
        yield Stillness(channel)
        return
    for number in np.unique(windows.number[first:]).tolist():
        times = windows.time[first:][windows.number[first:] == number]
        yield Stillness(channel, number, float(times.min()), np.inf)
