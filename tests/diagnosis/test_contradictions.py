"""Sensors that tell of two motions: the one that is wrong is named, alone and beside a fault."""

from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl.diagnosis import diagnose
from auv_torchrl.diagnosis.identify.before_effects import tells_twice
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import Candidate, load_settings
from auv_torchrl.diagnosis.identify.neighbours import Neighbourhood
from auv_torchrl.diagnosis.identify.problem import HealthyPrior, Problem
from auv_torchrl.diagnosis.identify.screen import Field
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.unanswered.other_source import none_shows
from auv_torchrl.diagnosis.verdict import Verdict
from auv_torchrl.effects import EFFECTS
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.simulate import simulated_logs

AXES = ("x", "y", "z", "yaw", "u", "v", "w", "r")
SENSORS = {"heading_bias": ("angle", 0.4), "pose_delay": ("delay", 0.2), "position_scale": ("factor", 1.3)}
TRIED = {*SENSORS, "velocity_scale", "command_delay", "thruster_gain", "current"}


def log_of(changes):
    """A flight whose log has positions, heading and body velocities."""
    (log,) = simulated_logs("paper", [changes], episodes=3, seconds=12.0, seed=5)
    shown = [np.where([axis in AXES for axis in axes], 1.0, np.nan) for axes in (log.axes[:6], log.axes[6:])]
    episodes = (replace(e, pose=e.pose * shown[0], velocity=e.velocity * shown[1]) for e in log.episodes)
    return replace(log, episodes=tuple(episodes), axes=AXES)


@pytest.mark.thorough
@pytest.mark.parametrize("name", SENSORS)
def test_the_sensor_that_contradicts_the_others_is_named(name):
    """No force follows such a log under the nominal sensors; under the right change of one, all is explained."""
    diagnosed(name, {})


@pytest.mark.thorough
def test_a_fault_beside_it_is_named_too():
    """A weak thruster is found along the motion that the right sensors tell of."""
    diagnosed("heading_bias", {"thruster_gain": {"gain_3": 0.4}})


@pytest.mark.parametrize(("axes", "twice"), [(("x", "y", "z", "yaw"), False), (("z", "yaw", "r"), True), (AXES, True)])
def test_only_what_is_told_twice_contradicts_itself(axes, twice):
    """A force follows poses alone under any sensors, so that none is looked for; beside a velocity or a gyro one is."""
    log, settings = replace(log_of({}), axes=axes), load_settings()
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)
    assert tells_twice(Problem.of(windows, load_vehicle("paper"), settings)) == twice


def test_no_force_acts_between_two_samples():
    """Where no force follows a log, bins become shorter, but no window has more of them than samples."""
    log, settings = log_of({"heading_bias": {"angle": 1.5}}), load_settings()
    slow = replace(log, episodes=tuple(replace(e, **_every(e, 4)) for e in log.episodes))
    windows = cut_windows(slow, settings.window_s, settings.lead_s, settings.bin_s)
    problem, _ = follow_windows(Problem.of(windows, load_vehicle("paper"), settings))
    assert problem.followed.mean() < 0.5
    assert problem.layout.bins <= windows.measured.shape[1] < windows.steps // 2


@pytest.fixture(scope="module")
def biased():
    """A log of an accelerometer that is off, and what healthy flights know of its vehicle."""
    (log,) = simulated_logs("paper", [{"accelerometer_bias": {"bias_ay": 0.3}}], episodes=2, seconds=12.0, felt=0.02)
    settings = load_settings()
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)
    vehicle = load_vehicle("paper")
    drawn = Problem.of(windows, vehicle, settings)
    known = HealthyPrior(
        np.array(settings.floor_force), drawn.sigma, drawn.rough_noise, drawn.nuisance, drawn.nuisance_covariance
    )
    return Problem.of(windows, vehicle, settings, known)


def test_windows_tell_as_much_of_a_vehicle_whatever_sensor_they_are_followed_under(biased):
    """Under a biased accelerometer, followed once or again, the log leaves open what it leaves open without."""
    once, follow = follow_windows(biased)
    sensor = follow.explanation.with_candidate(Candidate("accelerometer_bias", {"bias_ay": 0.3}), biased.vehicle)
    again, _ = follow_windows(follow_windows(once, sensor)[0], sensor)
    assert "accelerometer_bias" in {effect for effect, *_ in biased.nuisance}
    for mine, before in zip(again.nuisance, once.nuisance, strict=True):
        assert mine == (*before[:3], pytest.approx(before[3], rel=0.2))


def test_an_effect_is_tried_without_another_however_few_windows_are_followed(biased):
    """What is left without a second effect is counted over the windows that it is left in."""
    terms = (Term("accelerometer_bias", ("bias_ay",), 0.3), Term("buoyancy", ("force",), 0.0))
    problem, follow = follow_windows(biased)
    best = fit_by_simulation(problem, Explanation(terms), follow)
    few = replace(problem, followed=np.arange(len(problem.windows)) < 2)

    def promised(problem):
        """What is promised to be left without one of the two."""
        around = Neighbourhood(problem, follow, Field.of(problem, follow), best, best.evidence, lambda proposal: False)
        return [(one.what.explanation.effects, one.promised.misfit) for one in around.smaller()]

    assert (("accelerometer_bias",), pytest.approx(best.excess, abs=0.01)) in promised(few)


def _every(episode, rows):
    """Fields of an episode that has each so many rows alone."""
    return {name: getattr(episode, name)[::rows] for name in ("t", "pose", "velocity", "commands")}


def diagnosed(name, fault):
    """Demand that a sensor and a fault are what explains a log with both."""
    parameter, value = SENSORS[name]
    settings = replace(load_settings(), ignored=tuple(effect for effect in EFFECTS if effect not in TRIED))
    found = diagnose(log_of({name: {parameter: value}, **fault}), load_vehicle("paper"), settings=settings)
    assert found.verdict is Verdict.EXPLAINED
    assert {effect.name for effect in found.effects} == {name, *fault}
    estimate = next(effect for effect in found.effects if effect.name == name).parameters[parameter]
    assert estimate.value == pytest.approx(value, abs=0.01)


@pytest.mark.parametrize(
    ("share", "about", "none"), [(0.0, 0.0, True), (0.2, 0.0, False), (0.2, 0.2, True), (0.4, 0.2, False)]
)
def test_a_channel_is_blamed_only_where_no_thrust_shows(share, about, none):
    """A fifth that shows may be chance where all else tells of sound thrusters; else it may be a fault of theirs."""
    scatter = share + 0.3 * np.tile([-1.0, 1.0], 40)[:, None]
    assert none_shows(scatter, np.full((80, 1), 0.01), about) is none
