"""What a healthy log teaches."""

from dataclasses import replace

import numpy as np
import pytest
from flown_logs import fly, hold, with_slack

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.calibrate.calibration import calibrate, draft
from auv_torchrl.diagnosis.calibrate.flights import disturbance_floor, fit_flight
from auv_torchrl.diagnosis.identify.hypotheses import apply_values, load_settings
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.vehicle import load_vehicle

HELD = hold(load_vehicle("paper"))
OWN = with_slack(HELD, np.random.default_rng(3))
FORCE = 0.8  # N
SHORT = {"episodes": 3, "seconds": 20.0}


@pytest.fixture(scope="module")
def healthy():
    """A sound vehicle whose coefficients are all a few percent off."""
    return fly(OWN, {}, seed=11, **SHORT)


@pytest.fixture(scope="module")
def gusty():
    """The same vehicle in a tank with gusts of ``FORCE``."""
    rng, gust, keep = np.random.default_rng(0), {}, np.exp(-0.05)

    def push(commands, position, velocity, t):
        fresh = FORCE * rng.standard_normal(position.shape)
        gust["now"] = fresh if t == 0 else keep * gust["now"] + np.sqrt(1 - keep**2) * fresh
        return commands, gust["now"]

    return fly(OWN, {}, seed=11, push=push, **SHORT)


@pytest.mark.thorough
def test_flights_with_bins_of_their_own_show_one_floor(gusty):
    """A flight that needs shorter bins than the other shows the same disturbance, and so do the two together."""
    usual = load_settings()
    windows = cut_windows(gusty, usual.window_s, usual.lead_s, usual.bin_s)
    known = draft([gusty], HELD, usual).prior
    each = [replace(usual, bin_s=share * usual.bin_s) for share in (1, 0.5)]
    fits = [fit_flight(windows, OWN, settings, known) for settings in each]
    alone, both = [disturbance_floor([fit]) for fit in fits], disturbance_floor(fits)
    np.testing.assert_allclose(alone[0][:3], alone[1][:3], rtol=0.1)
    np.testing.assert_allclose(both[:3], np.mean(alone, axis=0)[:3], rtol=0.1)


@pytest.mark.thorough
def test_a_disturbance_and_the_coefficients_are_recovered(gusty):
    """The floor of a vehicle in a gusty tank, its sensor noise and the gains of its horizontal thrusters are found."""
    found = calibrate([gusty], HELD, load_settings())
    np.testing.assert_allclose(found.prior.floor[:3], FORCE, rtol=0.25)
    assert found.prior.noise["x"] == pytest.approx(0.002, rel=0.1)
    assert found.prior.noise["yaw"] == pytest.approx(0.004, rel=0.1)
    np.testing.assert_allclose(found.vehicle.gain[:4], OWN.gain[:4], atol=0.03)


def test_a_healthy_log_shows_a_small_fault(healthy):
    """A loss of 7 % on a vehicle that is a few percent off shows against the vehicle as it was; alone it is slack."""
    log = fly(OWN, {"thruster_gain": {"gain_2": 0.93}}, seed=5, **SHORT)
    (effect,) = diagnose(log, HELD, healthy=[healthy]).effects
    gain = effect.parameters["gain_2"]
    assert (effect.name, effect.thrusters) == ("thruster_gain", (2,))
    assert gain.low < 0.93 < gain.high
    assert gain.high - gain.low < 0.06
    assert diagnose(log, HELD).verdict is Verdict.NO_GAP


def test_a_sound_vehicle_stays_sound(healthy):
    """A second flight of the same vehicle has no gap, and more healthy flights would show smaller faults."""
    diagnosis = diagnose(fly(OWN, {}, seed=2, **SHORT), HELD, healthy=[healthy])
    assert diagnosis.verdict is Verdict.NO_GAP
    assert diagnosis.gap.closed is None
    codes = {finding.code for finding in diagnosis.findings}
    assert "floor_measured" in codes
    assert not codes & {"floor_assumed", "healthy_has_gap", "noisier_than_healthy"}
    sizes = [diagnosis.detectable, *diagnosis.detectable_with.values()]
    assert list(diagnosis.detectable_with) == [3, 10]
    for effect in diagnosis.detectable:
        few, more, most = (abs(flights[effect].value - flights[effect].nominal) for flights in sizes)
        assert few >= more >= most > 0, effect
    few, _, most = (1 - flights["thruster_gain"].low for flights in sizes)
    assert most < 0.9 * few, "a gain, which one flight leaves open"


def test_noisier_sensors_are_named(healthy):
    """A log with noisier sensors than the healthy one says so."""
    log = fly(OWN, {}, seed=2, noise=(0.006, 0.004), **SHORT)
    findings = {finding.code: finding for finding in diagnose(log, HELD, healthy=[healthy]).findings}
    assert set(findings["noisier_than_healthy"].columns) == {"x", "y", "z"}


def test_without_a_healthy_log_the_assumption_is_said(healthy):
    """A diagnosis without a healthy log says that its floor is assumed."""
    codes = {finding.code for finding in diagnose(healthy, HELD).findings}
    assert "floor_assumed" in codes


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.thorough) for seed in (1, 5))])
def test_currents_and_trims_of_flights_do_not_make_a_file_wrong(seed):
    """Flights of a vehicle that is as its file says within slack, on days that differ, leave the file as it is."""
    rng, flights = np.random.default_rng(seed), []
    near = {"linear_drag": {f"scale_{axis}": 1 + 0.03 * rng.normal() for axis in ("surge", "sway", "heave", "yaw")}}
    for day in range(3):
        current = {"north": 0.05 * rng.normal(), "east": 0.05 * rng.normal()}
        own = apply_values(HELD, near | {"buoyancy": {"force": 0.5 * rng.normal()}, "current": current})
        flights.append(fly(own, {}, seed=10 * seed + day, **SHORT))
    drafted = draft(flights, HELD, load_settings())
    assert drafted.wrong_effects == ()
    assert drafted.file_excess < load_settings().excess
