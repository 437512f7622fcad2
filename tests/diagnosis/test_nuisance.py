"""How the samples change with what is uncertain about a vehicle."""

from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.following import follow_windows, nudged_chi2, path_under
from auv_torchrl.diagnosis.identify.hypotheses import apply_values, load_settings
from auv_torchrl.diagnosis.identify.paths import quadratic
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.vehicle import load_vehicle
from tests.diagnosis.flown_logs import fly, hold

HELD, SETTINGS = hold(load_vehicle("paper")), load_settings()


@pytest.mark.parametrize("mass", [5.0, 11.5, 30.0])
def test_slopes_in_a_mass_are_those_of_a_little_more_of_it(mass):
    """However small the mass is beside what its bounds allow, chi-square changes as its quadratic says, within 5 %."""
    light = apply_values(HELD, {"hull": {"mass": mass}})
    log = fly(light, {"hull": {"mass": 1.1 * mass}}, seed=3, episodes=2, seconds=20.0)
    problem = Problem.of(cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), light, SETTINGS)
    width = 0.1 * mass
    problem = replace(
        problem,
        nuisance=(("hull", "mass", mass, width),),
        nuisance_covariance=np.array([[width**2]]),
        nuisance_precision=np.array([[width**-2.0]]),
    )
    problem, path = follow_windows(problem)
    path = path_under(problem, Explanation(), path)
    q, more = quadratic(problem, path, []), 1e-3 * mass
    trials = [Explanation(nuisance={("hull", "mass"): by}) for by in (more, -more)]
    up, down = nudged_chi2(problem, trials, path)
    assert up - down == pytest.approx(-4 * q.b[0] * more, rel=0.05)
