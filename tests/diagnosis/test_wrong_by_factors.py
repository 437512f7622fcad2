"""A vehicle file that is wrong by factors, and what healthy flights make of it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.diagnosis.calibrate.calibration import calibrate
from auv_torchrl.diagnosis.calibrate.correction import simulate_steps
from auv_torchrl.diagnosis.calibrate.parameters import VehicleEstimate, guess_nuisance, load_uncertainty
from auv_torchrl.diagnosis.calibrate.scale_ambiguity import restore_file_scale, sample_accelerations
from auv_torchrl.diagnosis.identify.hypotheses import apply_values, load_settings
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.sysid.bounded import least_within
from auv_torchrl.vehicle import load_vehicle
from tests.diagnosis.flown_logs import fly, hold

SETTINGS = load_settings()
COMMAND = 0.4


def test_the_least_within_bounds_leaves_to_others_what_a_bound_takes():
    """Of a sum that must be 3 while one part wants to be -2, the other takes it all once that part is at 0."""
    H = np.ones((2, 2)) + 1e-3 * np.eye(2)
    g = np.array([3.0, 3.0]) + 1e-3 * np.array([-2.0, 5.0])
    free = least_within(H, g, (np.full(2, -9.0), np.full(2, 9.0)), np.eye(2))
    np.testing.assert_allclose(free, [-2.0, 5.0], atol=1e-6)
    bound = least_within(H, g, (np.array([0.0, -9.0]), np.full(2, 9.0)), np.eye(2))
    np.testing.assert_allclose(bound, [0.0, 3.0], atol=0.01)


def test_along_directions_a_bound_stops_only_what_it_must():
    """Along one direction the first bound is the end; along two the other goes on."""
    H, g, room = np.eye(3), np.array([2.0, 2.0, 2.0]), (np.full(3, -9.0), np.array([1.0, 9.0, 9.0]))
    one = least_within(H, g, room, np.ones((3, 1)))
    np.testing.assert_allclose(one, np.ones(3), atol=1e-9)
    two = least_within(H, g, room, np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    np.testing.assert_allclose(two, [1.0, 1.0, 2.0], atol=1e-9)


@pytest.mark.parametrize("factor", [0.5, pytest.param(2.0, marks=pytest.mark.thorough)])
def test_an_overall_scale_is_found_and_changes_no_motion(factor):
    """A vehicle of other masses, thrusts and drags comes back towards its file and moves as it did."""
    file = load_vehicle("bluerov2_heavy")
    windows = cut_windows(fly(file, {}, episodes=1, seconds=5.0), SETTINGS.window_s, SETTINGS.lead_s)
    nuisance = guess_nuisance(file, SETTINGS, load_uncertainty("bluerov2_heavy", file), windows)
    scaled = [
        (factor - 1) * nominal
        if effect == "hull" and member != "righting_arm" or effect in ("thruster_gain", "dead_band")
        else 0.0
        for effect, member, nominal, _ in nuisance.entries
    ]
    other = VehicleEstimate.from_file(file, nuisance).shifted(np.array(scaled))
    back = restore_file_scale(other)
    moves = np.ones(6, bool)
    before, after = (sample_accelerations(c.vehicle.expand(1), moves) for c in (other, back))
    np.testing.assert_allclose(after, before, atol=2e-3 * np.abs(before).max())
    ratio = float(back.vehicle.mass / file.mass)
    assert abs(np.log(ratio)) < 0.2 * abs(np.log(factor))


def test_what_differs_between_flights_pulls_no_scale():
    """A current, which no file states, leaves the restored vehicle where it is: a second restoration moves nothing."""
    file = load_vehicle("bluerov2_heavy")
    windows = cut_windows(fly(file, {}, episodes=1, seconds=5.0), SETTINGS.window_s, SETTINGS.lead_s)
    nuisance = guess_nuisance(file, SETTINGS, load_uncertainty("bluerov2_heavy", file), windows)
    flows = np.array([0.1 * (effect == "current") for effect, *_ in nuisance.entries])
    assert flows.any()
    once = restore_file_scale(VehicleEstimate.from_file(file, nuisance).shifted(flows))
    (before, after) = ([entry[2] for entry in one.nuisance.entries] for one in (once, restore_file_scale(once)))
    assert (np.abs(np.subtract(after, before)) <= 2e-2 * once.nuisance.width).all()


@pytest.fixture(scope="module")
def guess():
    """The file of the paper's vehicle as a guess."""
    file = hold(load_vehicle("paper"))
    windows = cut_windows(fly(file, {}, episodes=1, seconds=5.0), SETTINGS.window_s, SETTINGS.lead_s)
    return VehicleEstimate.from_file(file, guess_nuisance(file, SETTINGS, (), windows))


@settings(max_examples=25, deadline=None)
@given(factor=st.floats(1.05, 5.0), member=st.sampled_from(["scale_surge", "scale_sway", "scale_heave", "scale_yaw"]))
def test_a_file_is_as_likely_to_have_a_half_as_twice_of_a_factor(guess, factor, member):
    """No scale of the vehicle is preferred because its file has more numbers too small than too large, or fewer."""
    place = [entry[:2] for entry in guess.nuisance.entries].index(("linear_drag", member))

    def unlikely(times):
        by = np.zeros(len(guess.nuisance.entries))
        by[place] = times - 1
        away, precision = guess.shifted(by).file_prior
        return away @ precision @ away

    assert unlikely(factor) == pytest.approx(unlikely(1 / factor), rel=1e-6)


def test_a_factor_that_a_fit_takes_to_nothing_can_come_back():
    """What is left of the drag is small and as unsure in newtons as before, so that another fit finds it again."""
    file = load_vehicle("paper")
    windows = cut_windows(fly(hold(file), {}, episodes=1, seconds=5.0), SETTINGS.window_s, SETTINGS.lead_s)
    about = VehicleEstimate.from_file(file, guess_nuisance(file, SETTINGS, (), windows))
    place = [entry[:2] for entry in about.nuisance.entries].index(("quadratic_drag", "scale_heave"))
    away = np.zeros(len(about.nuisance.entries))
    away[place] = -1.0
    gone = about.shifted(away)
    drag, before = (float(c.vehicle.quadratic_drag[..., 2]) for c in (gone, about))
    assert 0 < drag < 0.2 * before
    np.testing.assert_allclose(gone.nuisance.width[place] * drag, about.nuisance.width[place] * before)
    away[place] = before / drag - 1
    back = gone.shifted(away)
    np.testing.assert_allclose(float(back.vehicle.quadratic_drag[..., 2]), before)
    np.testing.assert_allclose(back.file_offset[place], 0.0, atol=1e-9)


def test_corrections_are_shares_of_what_the_file_says():
    """Twice the gain is +100 %; an angle, which counts from where the file has it, is no share of anything."""
    file = load_vehicle("paper")
    windows = cut_windows(fly(hold(file), {}, episodes=1, seconds=5.0), SETTINGS.window_s, SETTINGS.lead_s)
    about = VehicleEstimate.from_file(file, guess_nuisance(file, SETTINGS, (), windows))
    by = {("thruster_gain", "gain_1"): 1.0, ("thruster_misalignment", "angle_1"): 0.01}
    moved = about.shifted(np.array([by.get(entry[:2], 0.0) for entry in about.nuisance.entries]))
    assert moved.corrections["thruster_gain", "gain_1"] == pytest.approx(1.0)
    assert not any(effect == "thruster_misalignment" for effect, _ in moved.corrections)


@pytest.mark.thorough
def test_a_file_that_is_wrong_by_factors_is_mended_by_a_flight():
    """Twice the thrust on another curve, a third of the drag and half of the inertia leave nothing but noise."""
    file = hold(load_vehicle("paper"))
    own = apply_values(
        file,
        {
            "thruster_gain": {f"gain_{i + 1}": gain for i, gain in enumerate((1.9, 1.8, 1.9, 1.8, 1.3, 1.3))},
            "thrust_curve": {"exponent": 2.0, "asymmetry": 0.1},
            "added_mass": {"scale_surge": 0.6, "scale_sway": 0.5, "scale_heave": 0.4, "scale_yaw": 1.9},
            "quadratic_drag": {f"scale_{axis}": 0.4 for axis in ("surge", "sway", "heave", "yaw")},
        },
    )
    found = calibrate([fly(own, {}, seed=7, episodes=3, seconds=30.0)], file, SETTINGS)
    assert found.file_excess > 10 > SETTINGS.excess > found.excess
    speed = [simulate_steps(vehicle, COMMAND).steady for vehicle in (found.vehicle, own)]
    rows = np.arange(1, 5), np.array([0, 1, 2, 5])
    np.testing.assert_allclose(speed[0][rows], speed[1][rows], rtol=0.1)
