"""From records of a system to the changes of its model: the whole way in one call."""

from collections.abc import Callable, Sequence

from auv_torchrl.sysid.model import Model
from auv_torchrl.sysid.path import Problem
from auv_torchrl.sysid.prior import Candidate, Prior
from auv_torchrl.sysid.select import Selection, select
from auv_torchrl.sysid.smooth import smooth
from auv_torchrl.sysid.windows import Disturbance, Windows

NOISE_MATTERS = 0.1  # relative change of the noise of a channel from which hypotheses are weighed again


def identify(
    model: Model,
    windows: Windows,
    disturbance: Disturbance,
    candidates: Sequence[Candidate],
    prior: Prior | None = None,
    known_noise: bool = False,
    progress: Callable[[str], None] = lambda step: None,
) -> Selection:
    """Find which candidates a log asks for.

    Noise is measured under the nominal model, and again under the best one: a model that is far off leaves some of its
    error in the noise. Where that changes the noise, the search goes on under the new one.

    Args:
        model: the simulator.
        windows: of the log.
        disturbance: force that may act on the sound system.
        candidates: changes to try.
        prior: of the nuisance parameters; by default independent, with their tolerances.
        known_noise: whether the noise of the windows stands.
        progress: called with each step in words.
    """
    progress("smoothing")
    problem = smooth(Problem.of(model, windows, disturbance), model.nominal, known_noise).problem
    selection = select(problem, candidates, prior, progress=progress)
    best = selection.best
    if not best.names:
        return selection
    progress("smoothing again")
    again = smooth(Problem.of(model, windows, disturbance, best.values), best.values, known_noise).problem
    before, after = problem.windows.noise.white, again.windows.noise.white
    if (abs(after / before - 1) > NOISE_MATTERS).any():
        return select(again, candidates, prior, best, progress)
    return selection
