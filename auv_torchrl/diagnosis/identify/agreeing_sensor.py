"""Sensors that contradict each other: no force makes a simulator follow both, unless one of them is what is wrong.

Effects are looked for along the motion that was measured. Where a late position and a Doppler log, or a turned compass
and a Doppler log, tell of two motions, there is no such motion until the right change of a sensor is known. So each
change of a sensor is tried by what matters first: whether some force makes the vehicle follow all that was measured.
"""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.following import follow_freely, follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import Candidate, batch
from auv_torchrl.diagnosis.identify.paths import WindowPath
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.smooth import misfit
from auv_torchrl.diagnosis.thresholds import AGREES_ALIKE, AGREES_BETTER, LOOKED_AT, MOSTLY_LOST
from auv_torchrl.effects import EFFECTS, Origin
from auv_torchrl.sensors import FELT, MOTION


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

    A compass that is turned to port and a Doppler log that is turned to starboard agree alike with positions. Thrusters
    tell which it is: under the other one a force is missing.
    """
    rows = np.unique(np.linspace(0, len(problem.windows) - 1, LOOKED_AT).astype(int))
    some = problem.windows.subset(rows)
    candidates = [candidate for candidate in problem.candidates if EFFECTS[candidate.effect].origin is Origin.SENSING]

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
    alike = [tried for tried in best.values() if tried[0] <= AGREES_ALIKE * least]
    return Explanation().with_candidate(min(alike, key=lambda tried: tried[1])[-1], problem.vehicle)
