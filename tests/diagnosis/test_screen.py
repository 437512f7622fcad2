"""Many changes are weighed at once as each would be alone."""

import numpy as np
import pytest
from flown_logs import fly, hold

from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.following import follow_windows, nudged_chi2
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Field, with_each
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.thresholds import SETTLED_TRIALS, TRIED_STEPS
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")
SETTINGS = load_settings()


@pytest.fixture(scope="module")
def seen():
    """A weak thruster's problem, what follows it, and the marks of all changes."""
    log = fly(hold(PAPER), {"thruster_gain": {"gain_2": 0.7}}, seed=3, episodes=2, seconds=12.0)
    problem = Problem.of(cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), hold(PAPER), SETTINGS)
    problem, follow = follow_windows(problem)
    return problem, follow, Field.of(problem, follow)


@pytest.mark.parametrize("beside", [0, 1, 2])
def test_each_change_beside_others_costs_what_it_costs_alone(seen, beside):
    """One solution for all gives the chi-square of every change beside those that are chosen."""
    _, _, field = seen
    responded = np.flatnonzero(field.seen).tolist()
    chosen, others = responded[:: len(responded) // 3][:beside], responded[1::5]
    others = [i for i in others if i not in chosen]
    one_by_one = [field.fit([*chosen, i])[0] for i in others]
    np.testing.assert_allclose(with_each(field, chosen, others), one_by_one, rtol=1e-7)


@pytest.mark.parametrize("reach", [0.1, 0.05, 0.015])
def test_the_best_of_what_is_tried_is_foretold_before_starts_settle(seen, reach):
    """Of values near by, the one that leaves least once starts and disturbance have settled promises to before."""
    problem, follow, _ = seen
    for threshold in (("dead_band", "width"), ("thruster_gain", "gain_2")):
        trials = [Explanation(nuisance={threshold: reach * step}) for step in TRIED_STEPS]
        foretold = nudged_chi2(problem, trials, follow, steps=0)
        settled = nudged_chi2(problem, trials, follow)
        assert np.ptp(settled) > 0
        assert settled.argmin() in foretold.argsort()[:SETTLED_TRIALS]
