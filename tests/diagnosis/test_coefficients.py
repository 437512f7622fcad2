"""Vehicles whose file is a guess: what is calibrated, what stands, and what held-out flight forbids."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from example import example
from flown_logs import fly, hold

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.calibrate.correction import (
    PredictionGain,
    build_prior,
    correct_file,
    describe_differences,
    estimate_from_fit,
    simulate_steps,
    window_s,
)
from auv_torchrl.diagnosis.calibrate.output_error import CoefficientFit, used_channels
from auv_torchrl.diagnosis.calibrate.parameters import load_uncertainty, read_uncertainty, shared_covariance
from auv_torchrl.diagnosis.explain import Given, one_cause
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.hypotheses import apply_values, load_settings
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.scenario_file import randomization_yaml, scenario_yaml
from auv_torchrl.diagnosis.validate.predict import cut_stretches, errors_along, predict
from auv_torchrl.diagnosis.validate.veto import only, scaled_errors, worse
from auv_torchrl.diagnosis.verdict import Estimate, FoundEffect
from auv_torchrl.effects import EFFECTS
from auv_torchrl.envs.randomize import read_ranges
from auv_torchrl.flightlog import Episode, FlightLog, join
from auv_torchrl.paths import config_names
from auv_torchrl.physics.kinematics import least_turn
from auv_torchrl.scenario import read_scenario
from auv_torchrl.sysid import Outcome, SearchTrace
from auv_torchrl.vehicle import load_vehicle
from benchmarks.real.bluerov2 import TEST, TO_BEAT, VEHICLE, figures, read_runs

REAL = os.environ.get("AUV_TORCHRL_BLUEROV2", "")  # folder of the runs of docs/how-to/run-the-benchmarks.md
GIVEN = hold(load_vehicle("paper"))
TRUTH = {  # 30 to 100 % off
    "hull": {
        "linear_surge": 60.0,
        "linear_sway": 100.0,
        "linear_heave": 60.0,
        "linear_yaw": 0.6,
        "quadratic_surge": 200.0,
        "added_mass_sway": 40.0,
        "added_mass_yaw": 0.25,
    },
    "buoyancy": {"force": 6.0},
}
GUESSED = {
    "hull": {
        "linear_surge": 30.0,
        "linear_sway": 50.0,
        "linear_heave": 80.0,
        "linear_yaw": 0.3,
        "quadratic_surge": 250.0,
        "added_mass_sway": 20.0,
        "added_mass_yaw": 0.15,
    },
    "buoyancy": {"force": 8.0},
}
UNCERTAIN = read_uncertainty(GUESSED, GIVEN)
SETTINGS = load_settings()
NOISE = {"x": 0.002, "y": 0.002, "z": 0.002, "yaw": 0.004}
SHORT = {"episodes": 4, "seconds": 31.0}


def held_out(vehicles):
    unseen = fly(GIVEN, TRUTH, seed=9, episodes=2, seconds=20.0)
    return predict(unseen, vehicles, SETTINGS, NOISE, np.full(4, 1.0))


@pytest.fixture(scope="module")
def flown():
    """A flight of the vehicle as it really is."""
    return fly(GIVEN, TRUTH, seed=4, **SHORT)


@pytest.fixture(scope="module")
def calibrated(flown):
    return correct_file(flown, GIVEN, UNCERTAIN, SETTINGS)


def test_eight_wrong_coefficients_are_calibrated_at_once(calibrated):
    """With eight coefficients wrong by 30 to 100 %, held-out error falls near the floor of the true vehicle."""
    errors = scaled_errors(held_out([GIVEN, calibrated.vehicle, apply_values(GIVEN, TRUTH)]))
    assert errors[0] > 5 * errors[2]
    assert errors[1] < 1.3 * errors[2]


def test_their_intervals_hold_the_truth(calibrated):
    """Most 95 % intervals hold the true value, and the large corrections are named with the words of their effect."""
    inside, all_ = 0, 0
    for effect in calibrated.effects:
        assert effect.calibrates
        for name, estimate in effect.parameters.items():
            all_ += 1
            inside += estimate.low <= TRUTH[effect.name][name] <= estimate.high
    assert all_ == 8
    assert inside >= 6
    sentences = {effect.name: effect.sentence for effect in calibrated.effects}
    assert "weight in water is off" in sentences["buoyancy"]
    assert any("idle it sinks" in sentence for sentence in calibrated.sentences)


def test_what_all_windows_gain_is_no_luck_beside_a_window_with_large_errors(flown):
    """Each window is predicted three times as well, and one has twenty times the error of the others."""
    windows = cut_windows(flown, 3.0, SETTINGS.lead_s).thinned(6)
    size = np.array([1.0, 1.2, 0.9, 20.0, 1.1, 0.8])[:, None, None]
    noise = np.random.default_rng(0).standard_normal((*windows.present.shape, len(used_channels(windows))))
    before = 3.0 * size * noise
    assert PredictionGain.of(windows, before, size * noise).is_worth_it
    assert not PredictionGain.of(windows, before, before[::-1]).is_worth_it


def test_coefficients_that_are_right_stand():
    """A vehicle that is as its file says keeps its coefficients, and the finding says that they were tried."""
    calibrated = correct_file(fly(GIVEN, {}, seed=4, **SHORT), GIVEN, UNCERTAIN, SETTINGS)
    assert calibrated.vehicle is GIVEN
    assert not calibrated.effects
    assert [finding.code for finding in calibrated.findings] == ["coefficients_stand"]


def test_a_file_that_leaves_noise_is_right_whatever_another_flight_shows():
    """Of a sound flight no cause is wanted, though the flight that is held out is of a vehicle with other drag."""
    given = Given(GIVEN, (), SETTINGS, UNCERTAIN, None)
    sound, other = fly(GIVEN, {}, seed=4, **SHORT), fly(GIVEN, TRUTH, seed=9, episodes=2, seconds=20.0)
    explained = one_cause(sound, other, given, lambda step, share: None)
    assert explained is not None and not explained.found.best.explanation.effects


def test_thrusters_are_off_together_more_likely_than_apart():
    """Gains of all thrusters that are half of the file's are likelier than two up and two down; drags stay apart."""
    uncertain = read_uncertainty({"thruster_gain": {"gain": 0.4}, "hull": {"linear_surge": 30.0}}, GIVEN)
    width = np.array([c.width for c in uncertain])
    covariance = shared_covariance([(c.effect, c.member) for c in uncertain], width)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), width)
    gains = np.array([c.effect == "thruster_gain" for c in uncertain])
    together = np.where(gains, -0.5, 0.0)
    apart = together * np.where(np.arange(len(gains)) % 2, 1, -1)
    known = np.linalg.inv(covariance)
    assert together @ known @ together < 0.3 * (apart @ known @ apart)
    assert not covariance[np.ix_(gains, ~gains)].any()


def test_a_log_too_short_is_not_calibrated_on():
    """Two windows calibrate nothing, and the finding says so."""
    short = fly(GIVEN, TRUTH, episodes=1, seconds=6.0)
    calibrated = correct_file(short, GIVEN, UNCERTAIN, SETTINGS)
    assert not calibrated.effects
    assert [finding.code for finding in calibrated.findings] == ["too_short_to_calibrate"]


@pytest.mark.parametrize(
    ("durations", "expected"), [((100.0,), 10.0), ((53.5,), 8.7), ((16.0, 16.0), 5.0), ((9.0,), 2.0)]
)
def test_windows_are_as_long_as_a_log_holds_six_of_them(durations, expected):
    """Ten seconds at most, and two at least, in which drag shows."""
    episodes = tuple(
        Episode(k, np.array([0.0, seconds]), np.zeros((2, 6)), np.zeros((2, 6)), np.zeros((2, 1)))
        for k, seconds in enumerate(durations)
    )
    assert window_s(FlightLog("log", episodes, ("u",)), 1.0) == pytest.approx(expected, abs=0.1)


def test_a_diagnosis_calibrates_first_and_searches_on_top(flown):
    """The verdict is the corrections together, no fault is made of them, and the summary says that the file is off."""
    found = diagnose(flown, GIVEN, uncertainty=UNCERTAIN, settings=SETTINGS)
    assert found.verdict is Verdict.EXPLAINED
    assert {effect.name for effect in found.effects if effect.calibrates} == set(TRUTH)
    assert [effect.name for effect in found.effects if not effect.calibrates] == []
    assert found.summary.startswith("The vehicle's file is off in many coefficients at once; above all, ")
    assert found.summary.count("the file says") == 1
    assert found.gap.closed is not None and found.gap.closed > 0.9


def waves(size, seed):
    """A force of ``size`` N on each axis of the world, which lasts for a second: no effect describes it."""
    rng, keeps, force = np.random.default_rng(seed), np.exp(-0.05), []

    def push(commands, position, velocity, t):
        fresh = size * rng.standard_normal(position.shape)
        force.append(keeps * force[-1] + np.sqrt(1 - keeps**2) * fresh if force else fresh)
        return commands, force[-1]

    return push


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({}, []),
        pytest.param({"thruster_gain": {"gain_1": 0.3}}, ["thruster_gain"], marks=pytest.mark.thorough),
    ],
)
def test_waves_on_a_vehicle_whose_file_is_off_make_no_fault_and_hide_none(values, named):
    """Beside eight wrong coefficients and waves of 1 N a weak thruster is all that is found, and without it nothing."""
    log = fly(GIVEN, {**TRUTH, **values}, seed=5, push=waves(1.0, 5), **SHORT)
    found = diagnose(log, GIVEN, uncertainty=UNCERTAIN, settings=SETTINGS)
    on_top = [effect for effect in found.effects if not effect.calibrates]
    assert [effect.name for effect in on_top] == named
    if named:
        assert on_top[0].parameters["gain_1"].value == pytest.approx(0.3, abs=0.05)
        assert on_top[0].thrusters == (1,)
    assert "floor_of_this_log" in {finding.code for finding in found.findings}


def test_what_a_log_leaves_open_is_as_wide_as_the_fit_is_unsure():
    """A drag that was corrected may be off by its standard deviation, and a gain of which the file is sure by 3 %."""
    sure = np.diag((0.1 * np.array([c.width for c in UNCERTAIN])) ** 2)
    fitted = CoefficientFit(np.array([c.nominal + 0.5 * c.width for c in UNCERTAIN]), sure, np.ones(1))
    known = build_prior(estimate_from_fit(GIVEN, UNCERTAIN, fitted), SETTINGS, ("x", "y", "z", "yaw"))
    width = {entry[:2]: entry[3] for entry in known.nuisance}
    assert width["hull", "linear_surge"] == pytest.approx(0.1 * GUESSED["hull"]["linear_surge"])
    assert width["thruster_gain", "gain_1"] == pytest.approx(0.03)
    assert not {name for name, _ in width} & {"linear_drag", "quadratic_drag", "added_mass"}
    np.testing.assert_allclose(np.sqrt(np.diag(known.nuisance_covariance)), list(width.values()))


@pytest.mark.thorough
def test_a_calibration_that_does_not_carry_over_is_vetoed():
    """Where the held-out flight speaks for the vehicle's file, the file stands."""
    short = {"episodes": 3, "seconds": 12.0}
    log, unseen = fly(GIVEN, TRUTH, seed=4, **short), fly(GIVEN, {}, seed=5, **short)
    # Few effects, because what a search finds on a flight that the unseen one contradicts is not the claim.
    few = replace(SETTINGS, ignored=tuple(name for name in EFFECTS if name not in ("buoyancy", "thruster_gain")))
    found = diagnose(log, GIVEN, test=[unseen], uncertainty=UNCERTAIN, settings=few)
    assert "calibration_vetoed" in {finding.code for finding in found.findings}
    assert not any(effect.calibrates for effect in found.effects)


def test_what_predicts_worse_is_vetoed(monkeypatch):
    """An explanation that predicts held-out flight worse than the vehicle as it was given is not named."""
    module = sys.modules["auv_torchrl.diagnosis.log_search"]
    right = module.search

    def misled(*how, **options):
        found = right(*how, **options)
        wrong = Explanation((Term("buoyancy", ("force",), 20.0),))
        fit = fit_by_simulation(found.problem, wrong, found.follow, rounds=0)
        record = replace(found.trace.best, names=("buoyancy",))
        trace = SearchTrace((*(replace(one, outcome=Outcome.STEP) for one in found.trace.records), record))
        return replace(found, best=fit, fits=(fit, *found.fits), trace=trace)

    monkeypatch.setattr(module, "search", misled)
    log = fly(GIVEN, {}, seed=4, episodes=3, seconds=10.0)
    found = diagnose(log, GIVEN, settings=SETTINGS)
    assert "vetoed" in {finding.code for finding in found.findings}
    assert not found.effects
    assert found.verdict is Verdict.NO_GAP


def test_worse_is_measured_on_held_out_stretches():
    """The vehicle with the opposite of what is wrong is worse than the given one, the true one is better."""
    opposite = {"buoyancy": {"force": -6.0}}
    p = held_out([GIVEN, apply_values(GIVEN, opposite), apply_values(GIVEN, TRUTH)])
    assert worse(p, 0, 1)
    assert not worse(p, 0, 2)
    np.testing.assert_array_equal(scaled_errors(only(p, 2, 0)), scaled_errors(p)[[2, 0]])


def test_a_better_position_does_not_pay_for_a_worse_heading():
    """Each quantity is tested by itself: with the true hull but for its turns, heading alone is worse."""
    hull = {**TRUTH["hull"], "linear_yaw": 0.02, "added_mass_yaw": 0.02}
    p = held_out([GIVEN, apply_values(GIVEN, {**TRUTH, "hull": hull}), apply_values(GIVEN, TRUTH)])
    errors = scaled_errors(p)
    assert errors[1] < errors[0]
    assert worse(p, 0, 1) == ("yaw",)


def test_a_heading_that_is_off_by_more_than_half_a_turn_is_off_by_that():
    """A vehicle that turns the other way is off by its turns, from sample to sample."""
    windows = cut_stretches(fly(GIVEN, {}, seed=9, episodes=1, seconds=12.0), SETTINGS)[0]
    yaw = windows.channels.index("yaw")
    predicted = np.repeat(windows.measured[:, None], 2, axis=1)
    turned = np.linspace(0.0, 5.0, windows.measured.shape[1])
    predicted[:, 1, :, yaw] = least_turn(predicted[:, 1, :, yaw] - turned)
    error = errors_along(windows, predicted)
    np.testing.assert_allclose(error[:, 0], 0.0, atol=1e-12)
    seen = windows.present
    np.testing.assert_allclose(error[:, 1, :, yaw][seen], np.broadcast_to(turned, seen.shape)[seen])


def test_a_vehicle_answers_a_step_as_its_coefficients_say():
    """Twice the force in every thruster at twice the linear drag and mass is the same vehicle to a pilot."""
    path = GIVEN.replace(quadratic_drag=np.zeros_like(GIVEN.quadratic_drag))
    double = path.replace(gain=2 * path.gain, linear_drag=2 * path.linear_drag, mass_scale=2 * path.mass_scale)
    before, after = simulate_steps(path, 0.5), simulate_steps(double, 0.5)
    np.testing.assert_allclose(after.steady, before.steady, atol=1e-9)
    assert describe_differences(before, after, 0.5) == {"axes": (), "idle": (), "turning": ()}


def test_a_fault_on_a_calibrated_vehicle_is_written_on_top_of_it(calibrated):
    """The scenario holds the corrections from the start and the fault after them, though both change the same thing."""
    fault = FoundEffect("buoyancy", 1.0, {"force": Estimate(5.0, 4.0, 6.0, 0.0, "N")}, (), 1.0, "heavier")
    where = replace(example().where, onset_s=3.0, onset_in_episode_s=3.0)
    diagnosis = replace(example(), effects=(*calibrated.effects, fault), where=where)
    scenario = read_scenario("found", yaml.safe_load(scenario_yaml(diagnosis, GIVEN)), GIVEN)
    calibrated_force = next(e for e in calibrated.effects if e.name == "buoyancy").parameters["force"].value
    early, late = (scenario.vehicle_at(GIVEN, t) for t in (0.0, 4.0))
    assert float(early.vertical_force) == pytest.approx(calibrated_force, abs=1e-5)
    assert float(late.vertical_force) == pytest.approx(calibrated_force + 5.0, abs=1e-5)
    np.testing.assert_allclose(early.linear_drag, calibrated.vehicle.linear_drag, rtol=0, atol=1e-5)
    read_ranges(GIVEN, yaml.safe_load(randomization_yaml(diagnosis, GIVEN)))


@pytest.mark.parametrize("name", config_names("vehicle"))
def test_what_a_vehicle_file_calls_uncertain_can_be_read(name):
    """The section names effects and parameters that exist; the vehicles of the paper and a simulator are exact."""
    coefficients = load_uncertainty(name, load_vehicle(name))
    assert bool(coefficients) == (name not in ("paper", "ardusub_sitl", "otter", "remus100", "milliampere"))
    assert all(c.low <= c.nominal <= c.high and c.width > 0 for c in coefficients)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"gremlin": {"size": 1.0}}, "no effect named 'gremlin'"),
        ({"hull": {"linear_up": 1.0}}, r"hull has no \['linear_up'\]: there are .*linear_surge"),
        ({"hull": 3.0}, "hull is 3.0: give parameters"),
        ({"buoyancy": {"force": -1.0}}, "buoyancy.force is -1.0: give a positive number of N"),
        ({"buoyancy": {"force": True}}, "buoyancy.force is True"),
        ({"buoyancy": {"force": float("nan")}}, "buoyancy.force is nan"),
        ({"thruster_swap": {"command": 1.0}}, "thruster_swap is a choice"),
    ],
)
def test_a_wrong_uncertainty_is_refused(section, message):
    """The error names the entry and what there is."""
    with pytest.raises(ValueError, match=message):
        read_uncertainty(section, GIVEN)


@pytest.mark.slow
@pytest.mark.skipif(
    not REAL, reason="AUV_TORCHRL_BLUEROV2 is not set: docs/how-to/run-the-benchmarks.md says how to get the runs"
)
def test_a_real_vehicle_is_predicted_better_than_published():
    """Calibrated on two runs of a real vehicle, the third is predicted better than by any published model."""
    flights = read_runs(Path(REAL))
    vehicle = load_vehicle(VEHICLE)
    learn = join(flight for name, flight in flights.items() if name != TEST)
    own = correct_file(learn, vehicle, load_uncertainty(VEHICLE, vehicle), SETTINGS).vehicle
    reached = figures(own, flights[TEST])
    assert all(reached[axis] <= TO_BEAT[axis] for axis in "uvw")
    assert reached["yaw"] >= TO_BEAT["yaw"]
