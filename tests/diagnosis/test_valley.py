"""Along a valley numbers move together that a log hardly tells apart."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from flown_logs import fly, hold

from auv_torchrl.diagnosis.identify.assess import moved_along
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation, moved_by, walks
from auv_torchrl.diagnosis.identify.following import follow_windows, nudged_chi2
from auv_torchrl.diagnosis.identify.hypotheses import batch, load_settings
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.sure import as_sure
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.effects import get_effect
from auv_torchrl.effects.trial import Valley
from auv_torchrl.vehicle import load_vehicle

SETTINGS = load_settings()
VALLEY = cast("Valley", get_effect("thrust_curve").trial.valley)
CURVE = {"exponent": 1.0, "asymmetry": 0.1}
VEHICLE = get_effect("thrust_curve").apply(hold(load_vehicle("paper")), CURVE)
GAINS = tuple(("thruster_gain", f"gain_{i}") for i in range(1, 7))
LIMITS = tuple(f"limit_{i}" for i in range(1, 7))
LIMIT = 16.0


@pytest.fixture(scope="module")
def limited():
    """A vehicle whose thrusters saturate, and whose curve and gains are known within a few per cent."""
    log = fly(VEHICLE, {"thrust_limit": dict.fromkeys(LIMITS, LIMIT)}, seed=9)
    problem = Problem.of(cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), VEHICLE, SETTINGS)
    widths = {"exponent": 0.025, "asymmetry": 0.0025}
    nuisance = (*problem.nuisance, *(("thrust_curve", name, CURVE[name], width) for name, width in widths.items()))
    covariance = np.diag([width**2 for *_, width in nuisance])
    problem = replace(
        problem, nuisance=nuisance, nuisance_covariance=covariance, nuisance_precision=np.linalg.inv(covariance)
    )
    return follow_windows(problem)


def in_valley(problem, explanation, step):
    """The explanation a step of the leading number further, the numbers beside it moved with it."""
    vehicle = batch(problem.vehicle, [explanation.values(problem.vehicle)])
    return moved_by(problem, explanation, VALLEY.moves(vehicle, step))


@pytest.mark.thorough
def test_a_limit_is_the_same_from_anywhere_along_the_curve_of_thrust(limited):
    """Exponent, dead band, limit and gains make up for each other; fits that begin far apart tell one limit."""
    (problem, follow), told = limited, []
    for by in (-0.02, -0.01, 0.01, 0.02):
        begin = Explanation((Term("thrust_limit", LIMITS, LIMIT * (1 - 1.5 * by)),), dict.fromkeys(GAINS, 1.5 * by))
        fit = fit_by_simulation(problem, in_valley(problem, begin, by), follow)
        (term,), covariance = as_sure(problem, fit)[0].terms, as_sure(problem, fit)[1]
        told.append(term.value)
        deviation = float(np.sqrt(covariance[0, 0]))
        assert term.value == pytest.approx(LIMIT, abs=3 * deviation)
        assert np.ptp(told) < deviation


def test_numbers_that_move_together_leave_one_mark(limited):
    """A step along the valley costs less than one of the same numbers by the mark of each, which switches samples."""
    problem, follow = limited
    fit = fit_by_simulation(problem, Explanation((Term("thrust_limit", LIMITS, LIMIT),)), follow)
    column = {entry[:2]: place for place, entry in enumerate(problem.nuisance)}
    steps = np.array([-0.02, -0.01, 0.01, 0.02])
    moves = [VALLEY.moves(fit.path.vehicle, step) for step in steps.tolist()]
    by_each = [moved_along(problem, fit, {column[key]: by for key, by in some.items()}) for some in moves]
    together = walks(problem, fit, VALLEY, steps)
    rises = nudged_chi2(problem, together, fit.path) - fit.chi2
    assert (rises < 0.8 * (nudged_chi2(problem, by_each, fit.path) - fit.chi2)).all()


def test_commands_pass_the_dead_band_as_before_along_the_valley(limited):
    """Moved along the valley, thrusters start at the same commands to both sides."""
    problem, _ = limited
    moved = in_valley(problem, Explanation(), 0.02).values(problem.vehicle)
    exponent, width = moved["thrust_curve"]["exponent"], moved["dead_band"]["width"]
    full, before = VEHICLE.full_thrust[0].item(), VEHICLE.dead_band[0].item()
    for left, now in ((1.0, 1.0), (1 - CURVE["asymmetry"], 1 - moved["thrust_curve"]["asymmetry"])):
        assert (width / full / now) ** (1 / exponent) == pytest.approx(before / full / left, rel=1e-6)
