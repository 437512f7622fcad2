"""The vehicle that predicts healthy flights best, where none follows them within noise and disturbance.

Real flights leave more than any coefficients explain: tethers, wakes, filters in the sensors. A fit against noise and
disturbance then bends coefficients to make up for that, and flies worse than one of predictions over seconds.
"""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.calibrate.coefficients import Calibrated, calibrate_coefficients
from auv_torchrl.diagnosis.calibrate.left_open import under_own_floor
from auv_torchrl.diagnosis.calibrate.nuisance import Centred, Nuisance, guesses
from auv_torchrl.diagnosis.calibrate.output_error import errors, measure_scale, pseudo_huber
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.problem import Known, Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import WORTH_A_CORRECTION
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import FlightLog
from auv_torchrl.vehicle import Vehicle


def predicts_better(
    log: FlightLog, vehicle: Vehicle, than: Vehicle, settings: Settings, coefficients: tuple[Coefficient, ...]
) -> tuple[Centred, Known, float] | None:
    """A vehicle that predicts windows of healthy flights better than another one, with what they leave open of it.

    The number is its chi-square per number, under the floor of the settings.

    None where none does, or where each half of the flights is not predicted better by what the other half tells.

    Args:
        log: the flights, joined.
        vehicle: as its file says, empty batch.
        than: as it was calibrated against noise and disturbance, empty batch.
        settings: of the diagnosis.
        coefficients: what is uncertain in the file; empty for all that effects declare.
    """
    coefficients = coefficients or _guessed(vehicle)
    corrected = calibrate_coefficients(log, vehicle, coefficients, settings)
    if corrected.known is None or not _is_nearer(log, corrected.vehicle, than, settings):
        return None
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)
    problem, follow = follow_windows(Problem.of(windows, corrected.vehicle, settings, corrected.known))
    judged = fit_by_simulation(problem, Explanation(), follow, rounds=0)
    problem = under_own_floor(problem, follow)
    slack, nothing = corrected.known.slack, np.zeros(len(corrected.known.slack))
    known = replace(
        corrected.known,
        floor=problem.known.floor if problem.known else corrected.known.floor,
        noise=problem.sigma,
        rough_noise=problem.rough_noise,
        of_itself=False,
    )
    file = _file_from(corrected, vehicle)
    centred = Centred(corrected.vehicle, Nuisance(slack, nothing, (), nothing), file, known.slack_covariance)
    return centred, known, judged.chi2 / judged.quadratic.numbers


def _file_from(corrected: Calibrated, vehicle: Vehicle) -> Floats:
    """Where the numbers (k,) of the vehicle's file are from those of the corrected one, factors counted from there."""
    values = {(effect.name, member): p.value for effect in corrected.effects for member, p in effect.parameters.items()}
    found = []
    for effect, member, *_ in corrected.known.slack if corrected.known else ():
        p = EFFECTS[effect].member_parameters(vehicle)[member]
        nominal = p.nominal_value(vehicle, member)
        away = values.get((effect, member), nominal) - nominal
        found.append(-away * nominal / (nominal + away) if p.is_factor and nominal + away else -away)
    return np.array(found)


def _guessed(vehicle: Vehicle) -> tuple[Coefficient, ...]:
    found = []
    for effect, member, nominal, width in guesses(vehicle):
        p = EFFECTS[effect].member_parameters(vehicle)[member]
        found.append(Coefficient(effect, member, nominal, width, p.low, p.high, p.unit))
    return tuple(found)


def _is_nearer(log: FlightLog, vehicle: Vehicle, than: Vehicle, settings: Settings) -> bool:
    """Whether windows of 5 s are predicted better, in units of what the better of the two leaves."""
    windows = cut_windows(log, 5.0, settings.lead_s)
    left = [errors(windows, one, [{}])[0] for one in (vehicle, than)]
    scale = np.minimum(*(measure_scale(windows, one)[0] for one in left))
    cost: list[Floats] = [(pseudo_huber(one, scale) ** 2 * windows.present[..., None]).sum() for one in left]
    return bool(np.sqrt(cost[0]) < (1 - WORTH_A_CORRECTION) * np.sqrt(cost[1]))
