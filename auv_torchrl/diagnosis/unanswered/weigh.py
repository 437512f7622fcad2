"""Whether a channel stands still or the vehicle does.

A channel that stands still is held against what a vehicle makes of it: the chi-square of its samples about a constant
of each window, and about the motion of that vehicle, whose start and disturbance are fitted to all channels.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.axes import followable, restricted
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.following import follow_windows, path_under
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.paths import WindowPath
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.actuation import actuate
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.motion.smooth import flown
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.unanswered.stillness import Stillness
from auv_torchrl.flightlog import FlightLog, FlightLogError
from auv_torchrl.flightlog.log import Episode
from auv_torchrl.sensors import CHANNELS
from auv_torchrl.vehicle import Vehicle

CONSTANT, PARABOLA = 0, 2  # degrees: of what stands still, and of what a start and a constant force make
OF_EACH = 3.0  # of chi-square that the start and the disturbance of a window take besides
# Of chi-square about a parabola, what a motion that follows the samples leaves at most: of white noise, ten forces in a
# window of 40 samples take a quarter
FOLLOWS = 0.6
OF_ALL = 20.0  # of chi-square besides: odds of 20,000 to 1
MOST_OF_EACH = 1e6  # of chi-square, at which a window has flown off


def unexplained_by(
    vehicle: Vehicle, log: FlightLog, still: Sequence[Stillness], settings: Settings
) -> tuple[Stillness, ...]:
    """Of what stands still, what a vehicle does not explain: its samples are a constant, and that vehicle moves.

    Args:
        vehicle: as all else shows it, empty batch.
        log: with the channels that stand still.
        still: its stretches.
        settings: of the diagnosis.
    """
    problem = Problem.of(cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s), vehicle, settings)
    problem, follow = follow_windows(problem)
    path = path_under(problem, Explanation(), follow)
    return tuple(entry for entry in still if _lead_of_constant(problem, path, entry) > 0)


def explained_better(problem: Problem, path: WindowPath, still: Sequence[Stillness]) -> bool:
    """Whether a path explains what stands still better than any start and force would: it moves, if little."""
    return any(_lead_of_path(problem, path, entry) > 0 for entry in still)


def _lead_of_constant(problem: Problem, path: WindowPath, entry: Stillness) -> float:
    constant, moving = _chi_squares(problem, path, entry, CONSTANT)
    return float((moving - constant - OF_EACH).sum()) - OF_ALL


def _lead_of_path(problem: Problem, path: WindowPath, entry: Stillness) -> float:
    drifting, moving = _chi_squares(problem, path, entry, PARABOLA)
    return float((FOLLOWS * drifting - moving).sum()) - OF_ALL


@DIVERGING
def _chi_squares(problem: Problem, path: WindowPath, entry: Stillness, degree: int) -> tuple[Floats, Floats]:
    """Chi-square (W,) of a channel about a polynomial of each window, and about a path, in its stretch."""
    windows = path.windows
    if entry.channel not in windows.channels:
        return np.zeros(0), np.zeros(0)
    rows = np.flatnonzero([entry.holds(int(n), float(t)) for n, t in zip(windows.number, windows.time, strict=True)])
    if not len(rows):
        return np.zeros(0), np.zeros(0)
    plain = replace(windows, whitening=None).subset(rows)
    state, column = path.state, windows.channels.index(entry.channel)
    left = flown(actuate(plain, path.vehicle), problem.layout, state.start[rows, None], state.bins[rows, None])[0]
    sigma = problem.sigma[entry.channel]
    moving = ((left.reshape(plain.trust.shape)[..., column] / sigma) ** 2).sum(1)
    still = _about_polynomials(plain, column, degree) / sigma**2
    return still, np.minimum(np.nan_to_num(moving, nan=np.inf), MOST_OF_EACH)


def _about_polynomials(windows: Windows, column: int, degree: int) -> Floats:
    """Sum of squares (W,) of a channel about the polynomial of each window that fits it best, weighted by trust."""
    values, trust = windows.measured[..., column], windows.trust[..., column]
    if windows.angular[column]:
        values = np.unwrap(values, axis=1)
    values = trust * np.where(trust > 0, values - values[:, :1], 0.0)
    powers = trust[..., None] * (windows.sampled[..., None] - windows.steps * windows.dt / 2) ** np.arange(degree + 1)
    base = np.linalg.qr(powers)[0]
    return (values**2).sum(1) - (np.einsum("wmk,wm->wk", base, values) ** 2).sum(1)


def without(log: FlightLog, still: Sequence[Stillness]) -> FlightLog | None:
    """The log without channels that stand still all along, and without trust in the others while they do.

    None where nothing is left that can be followed.
    """
    gone = {entry.channel for entry in still if entry.episode is None}
    kept = tuple(axis for axis in log.axes if axis not in gone)
    if not kept:
        return None
    parts = [entry for entry in still if entry.episode is not None]
    masked = replace(log, episodes=tuple(_masked(episode, parts) for episode in log.episodes))
    try:
        return followable(restricted(masked, kept))
    except FlightLogError:  # what is left needs what is gone, as positions need a heading
        return None


def _masked(episode: Episode, parts: Sequence[Stillness]) -> Episode:
    """The episode with stretches of its channels marked as filled in."""
    own = [entry for entry in parts if entry.episode == episode.number]
    if not own:
        return episode
    filled = np.zeros((len(episode), len(CHANNELS)))
    if episode.filled is not None:
        filled[:, : episode.filled.shape[1]] = episode.filled
    for entry in own:
        filled[entry.covers(episode.t), CHANNELS.index(entry.channel)] = 1.0
    return replace(episode, filled=filled)
