"""What a log leaves open of a vehicle whose file was corrected on it: the coefficients, and what pushes besides.

Slack and floor of the settings are those of a file that is right. Beside a file that was not, effects would be made of
coefficients that the log hardly tells, and of waves.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.calibrate.floor import disturbance_floor
from auv_torchrl.diagnosis.calibrate.nuisance import Centred, Nuisance
from auv_torchrl.diagnosis.calibrate.output_error import Fitted
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.hypotheses import Settings, nuisance_parameters
from auv_torchrl.diagnosis.identify.paths import WindowPath
from auv_torchrl.diagnosis.identify.problem import Known, Problem
from auv_torchrl.effects import EFFECTS
from auv_torchrl.vehicle import Vehicle

PASSES = 4  # coefficients and floor in turn, at most, ...
SETTLED = 0.1  # ... while some floor still grows by this share: windows of two minutes tell it no better


def left_open(fitted: Centred, settings: Settings, channels: Collection[str]) -> Known:
    """Slack of a search on the log that coefficients were corrected on; its floor and noise are still to be measured.

    Args:
        fitted: the vehicle as the log says, see :func:`fitted_about`.
        settings: with the floor to begin from, and slack of what was not fitted.
        channels: of the log.
    """
    nuisance = fitted.nuisance.entries
    effects = {effect for effect, *_ in nuisance}
    said = effects | {name for effect in effects for name in EFFECTS[effect].covers}
    others = [entry for entry in nuisance_parameters(fitted.vehicle, settings, channels) if entry[0] not in said]
    return Known(np.array(settings.floor_force), {}, {}, nuisance, fitted.covariance, of_itself=True).beside(others)


def fitted_about(vehicle: Vehicle, coefficients: Sequence[Coefficient], fitted: Fitted) -> Centred:
    """The vehicle with its coefficients as a log says.

    Args:
        vehicle: as its file says, empty batch.
        coefficients: of it, as the file says.
        fitted: the same (k,) as the log says, and how sure log and file are of them.
    """
    nothing = np.zeros(len(coefficients))
    entries = tuple((c.effect, c.member, c.nominal, c.width) for c in coefficients)
    about = Centred(vehicle, Nuisance(entries, nothing, (), nothing), nothing, fitted.covariance)
    return about.shifted(fitted.values - np.array([c.nominal for c in coefficients]))


def under_own_floor(problem: Problem, follow: WindowPath) -> Problem:
    """The problem with the disturbance that its log shows where nothing else is wrong, if that is more than assumed.

    A fault makes it larger than it is, and shows all the same: one force explains then what many had to.
    """
    known, explanation, path = problem.known, Explanation(), follow
    if known is None:
        return problem
    whole = known.floor
    for _ in range(PASSES):
        fit = fit_by_simulation(problem, explanation, path)
        if not np.isfinite(fit.chi2):
            break
        floor = np.maximum(whole[problem.layout.dof], disturbance_floor([(problem, fit)]))
        settled = bool((np.abs(floor / problem.floor - 1) < SETTLED).all())
        explanation, path, problem = fit.explanation, fit.path, replace(problem, floor=floor)
        if settled:
            break
    own = whole.copy()
    own[problem.layout.dof] = problem.floor
    return replace(problem, known=replace(known, floor=own))
