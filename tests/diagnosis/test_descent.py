"""Many coefficients are fitted at once, from several beginnings."""

from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl.diagnosis.calibrate import output_error
from auv_torchrl.diagnosis.calibrate.output_error import (
    Descent,
    as_values,
    fit_coefficients,
    measure_scale,
    simulate_errors,
)
from auv_torchrl.diagnosis.calibrate.parameters import read_uncertainty
from auv_torchrl.diagnosis.identify.hypotheses import apply_values
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.vehicle import load_vehicle
from tests.diagnosis.flown_logs import fly, hold

GIVEN = hold(load_vehicle("paper"))
WEAK = 0.25  # of the thrust in the file, as where a pilot's commands are scaled down
TRUTH = {
    "thruster_gain": {f"gain_{k}": WEAK * share for k, share in enumerate((1.0, 0.9, 1.1, 1.05, 0.95, 1.0), start=1)},
    "hull": {"linear_surge": 12.0, "linear_sway": 20.0},
}
UNCERTAIN = read_uncertainty(
    {"thruster_gain": {"gain": 0.4}, "hull": {"linear_surge": 30.0, "linear_sway": 50.0}, "buoyancy": {"force": 3.0}},
    GIVEN,
)


@pytest.fixture(scope="module")
def windows():
    return cut_windows(fly(GIVEN, TRUTH, seed=777001, episodes=3, seconds=31.0), 10.0, 1.5)


def test_thrusters_of_a_quarter_of_the_thrust_are_found(windows):
    """Gains of 0.25 that a file has as 1 within 0.4 come out within their error, four deviations at most."""
    fitted = fit_coefficients(windows, GIVEN, UNCERTAIN)
    true = np.array([TRUTH.get(c.effect, {}).get(c.member, c.nominal) for c in UNCERTAIN])
    assert (np.abs(fitted.values - true) < 4 * np.sqrt(np.diag(fitted.covariance)) + 0.02 * np.abs(true)).all()


def test_descents_begin_at_the_file_and_where_all_thrusters_are_weak():
    """Along what the file leaves open most, which is all gains together; without such gains at the file alone."""
    file, weak = Descent.starting_points(Descent(cut_windows(fly(GIVEN, {}, episodes=1), 10.0, 1.5), GIVEN, UNCERTAIN))
    gains = np.array([c.effect == "thruster_gain" for c in UNCERTAIN])
    np.testing.assert_array_equal(file, [c.nominal for c in UNCERTAIN])
    np.testing.assert_array_equal(weak[~gains], file[~gains])
    assert np.ptp(weak[gains]) < 1e-9
    assert 0 < weak[gains][0] < 0.5


def test_ends_are_compared_by_what_they_leave_and_not_by_their_own_scale(windows):
    """An end that leaves errors ten times as large costs as little by itself, and is far less likely."""
    descent = Descent(windows, GIVEN, UNCERTAIN)
    end = descent.descend(descent.starting_points()[1])
    worse = replace(end, error=10 * end.error, scale=10 * end.scale)
    costs = [descent.cost(one.error, one.at, one.start, one.scale, one.memory) for one in (end, worse)]
    assert costs[1] == pytest.approx(costs[0], rel=0.01)
    assert descent.deviance(worse, end.memory) > descent.deviance(end, end.memory) + 100
    scale, _ = measure_scale(windows, simulate_errors(windows, GIVEN, [{}])[0])
    assert (scale > end.scale).all()


HEAVY = load_vehicle("bluerov2_heavy")
HULL = dict.fromkeys(("scale_surge", "scale_sway", "scale_heave", "scale_yaw"), 0.4)
WRONG = read_uncertainty(
    {
        "thruster_gain": {"gain": 0.35},
        "thruster_place": {"x": 0.03, "y": 0.03},
        "added_mass": HULL,
        "quadratic_drag": HULL,
        "thrust_curve": {"exponent": 0.2, "asymmetry": 0.1},
        "dead_band": {"width": 0.5},
    },
    HEAVY,
)


def _ends(seed: int, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Deviances where descents for a vehicle that differs from its file end, without corrections of steps and with."""
    rng = np.random.default_rng(seed)
    true = np.array(
        [
            c.nominal if c.effect == "thruster_place" else np.clip(rng.normal(c.nominal, c.width), c.low, c.high)
            for c in WRONG
        ]
    )
    axes = ("x", "y", "z", "roll", "pitch", "yaw")
    log = fly(apply_values(HEAVY, as_values(WRONG, true)), {}, seed=seed, episodes=2, seconds=31.0, axes=axes)
    descent, found = Descent(cut_windows(log, 2.0, 0.5), HEAVY, WRONG), []
    for corrections in (0, output_error.CORRECTIONS):
        monkeypatch.setattr(output_error, "CORRECTIONS", corrections)
        found.append(descent.deviance(descent.descend(descent.nominal), 1.0))
    return found


def test_steps_that_follow_bent_valleys_end_lower(monkeypatch):
    """Where gains, arms and curves of thrusters trade, corrected steps end lower, two of three by 500."""
    straight, corrected = np.array([_ends(seed, monkeypatch) for seed in range(100, 103)]).T
    assert np.median(straight - corrected) > 500
