"""The vehicle that predicts healthy flights best, where none follows them within noise and disturbance.

Real flights leave more than any coefficients explain: tethers, wakes, filters in the sensors. A fit against noise and
disturbance then bends coefficients to make up for that, and flies worse than one of predictions over seconds.
"""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.calibrate.coefficients import Gain, calibrate_coefficients
from auv_torchrl.diagnosis.calibrate.left_open import under_own_floor
from auv_torchrl.diagnosis.calibrate.nuisance import Centred, Nuisance, guesses
from auv_torchrl.diagnosis.calibrate.output_error import errors
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient, as_coefficients
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.problem import Known, Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.thresholds import WORTH_A_CORRECTION
from auv_torchrl.diagnosis.validate.predict import HORIZONS_S
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
    coefficients = coefficients or as_coefficients(guesses(vehicle), vehicle)
    corrected = calibrate_coefficients(log, vehicle, coefficients, settings)
    own, about = corrected.known, corrected.about
    if own is None or about is None or not _is_nearer(log, corrected.vehicle, than, settings):
        return None
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)
    problem, follow = follow_windows(Problem.of(windows, corrected.vehicle, settings, own))
    fit = fit_by_simulation(problem, Explanation(), follow, rounds=0)
    problem = under_own_floor(problem, follow)
    floor = np.array(settings.floor_force)
    floor[problem.layout.dof] = problem.floor
    known = replace(own, floor=floor, noise=problem.sigma, rough_noise=problem.rough_noise, of_itself=False)
    widths = {(c.effect, c.member): c.width for c in coefficients}
    width = np.array([widths.get(entry[:2], entry[3]) for entry in known.nuisance])
    file, still = np.zeros_like(width), np.zeros_like(width)
    file[: len(about.file)] = about.file  # what was not fitted is as the file says
    centred = Centred(corrected.vehicle, Nuisance(known.nuisance, width, (), still), file, known.nuisance_covariance)
    return centred, known, fit.excess


def _is_nearer(log: FlightLog, vehicle: Vehicle, than: Vehicle, settings: Settings) -> bool:
    """Whether windows as long as any prediction is fit over are predicted better, and by enough to be worth it."""
    windows = cut_windows(log, HORIZONS_S[-1], settings.lead_s)
    before, after = (errors(windows, one, [{}])[0] for one in (than, vehicle))
    return Gain.of(windows, before, after).share > WORTH_A_CORRECTION
