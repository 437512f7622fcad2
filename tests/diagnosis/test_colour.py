"""Errors that are no white noise: commands that were logged as snapshots, and estimates that go astray."""

from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl.diagnosis import diagnose
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import batch, load_settings
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.noise import drift_covariance, late_shares, unknown_force, whiten
from auv_torchrl.diagnosis.motion.smooth import Layout
from auv_torchrl.diagnosis.verdict import Verdict
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import Episode, FlightLog
from auv_torchrl.flightlog.log import SampleErrors
from auv_torchrl.flightlog.streams.drift import DRIFT_S
from auv_torchrl.sensors import motion_of
from auv_torchrl.simulator import simulate
from auv_torchrl.vehicle import load_vehicle

VEHICLE = load_vehicle("ardusub_sitl")
SNAPSHOT_S, FINE_S = 0.1, 0.01
AXES = ("x", "y", "z", "roll", "pitch", "yaw", "p", "q", "r")
NOISE = np.array([1e-3] * 2 + [1e-2] + [5e-4] * 3 + [0.0] * 3 + [2e-3] * 3)


def flight(change=None, seconds=30.0, seed=0, drift=0.0) -> FlightLog:
    """A flight whose commands change at any moment and are logged as snapshots at 10 Hz, with what was measured then.

    Estimates of the position go astray at a rate of ``drift`` m/s.
    """
    rng = np.random.default_rng(seed)
    steps, every = round(seconds / FINE_S), round(SNAPSHOT_S / FINE_S)
    demand, at = np.zeros((steps, 6)), 0
    while at < steps:
        demand[at:, rng.integers(6)] = rng.uniform(-0.4, 0.4)
        at += rng.integers(20, 80)
    commands = np.clip(demand @ VEHICLE.mixer.T, -1, 1)
    vehicle = VEHICLE
    for effect, values in (change or {}).items():
        vehicle = EFFECTS[effect].apply(vehicle, values)
    t = FINE_S * np.arange(steps + 1)
    measured = motion_of(simulate(vehicle, commands[None], t).states)[0, :-1]
    rows = np.arange(every // 2, steps - every, every // 2)  # at the snapshots, and halfway between them
    snapshot = (rows + every // 2) // every * every
    values = measured[rows] + NOISE * rng.normal(size=(len(rows), 12))
    rate = np.zeros((len(rows), 2))
    for k in range(1, len(rows)):
        keeps = np.exp(-SNAPSHOT_S / 2 / DRIFT_S)
        rate[k] = keeps * rate[k - 1] + drift * np.sqrt(1 - keeps**2) * rng.normal(size=2)
    values[:, :2] += np.cumsum(rate, axis=0) * SNAPSHOT_S / 2
    values[:, 6:9] = np.nan
    between = np.repeat((rows % every != 0)[:, None], 12, axis=1).astype(float)
    episode = Episode(0, t[rows] - t[rows[0]], values[:, :6], values[:, 6:], commands[snapshot], filled=between)
    errors = SampleErrors(SNAPSHOT_S, {"x": drift, "y": drift} if drift else {})
    return FlightLog("snapshots", (episode,), AXES, errors=errors)


def test_a_change_is_as_likely_at_any_moment_between_two_snapshots():
    """Root mean squares of a uniform time, by grid step; nothing where the snapshots are as near as the steps."""
    fine = late_shares(0.1, 0.05)
    assert fine == pytest.approx([np.sqrt(1 / 6)], rel=0.02)
    coarse = late_shares(0.4, 0.05)
    assert len(coarse) == 4 and (np.diff(coarse) < 0).all() and coarse[0] < np.sqrt(0.5)


def test_a_drift_is_as_large_as_it_was_made():
    """The covariance of an integrated Gauss-Markov rate, against 4,000 of them."""
    windows = cut_windows(flight(drift=0.05), 2.0, 1.0)
    rng = np.random.default_rng(1)
    t = (windows.index[0] + windows.fraction[0]) * windows.dt
    grid = np.arange(0, 2.0, 0.01)
    rate, runs = 0.05 * rng.normal(size=4000), []
    for _ in grid:
        runs.append(rate)
        rate = rate * np.exp(-0.01 / DRIFT_S) + 0.05 * np.sqrt(1 - np.exp(-0.02 / DRIFT_S)) * rng.normal(size=4000)
    path = 0.01 * np.cumsum(runs, axis=0)
    here = path[np.searchsorted(grid, t).clip(max=len(grid) - 1)]
    of_x = drift_covariance(windows)[0, 0]
    assert np.abs(of_x - np.cov(here)).max() < 0.1 * of_x.max()
    assert not drift_covariance(windows)[0, 2].any()  # depth was measured


def test_drifts_are_taken_out_channel_by_channel():
    """What is whitened so is as likely as under the whole covariance: squares and determinant are the same."""
    log = flight(drift=0.05)
    windows = cut_windows(replace(log, errors=replace(log.errors, snapshot_s=0.0)), 2.0, 1.0)
    vehicle, sigma = batch(VEHICLE, [{}]), dict.fromkeys(windows.channels, 0.01)
    white = whiten(windows, vehicle, Layout.of(windows, VEHICLE, 0.4), sigma, (windows.guess, np.zeros(0)))
    m, channels = windows.trust[0].shape
    assert white.whitening is not None and white.whitening.shape == (len(windows), channels, m, m)
    numbers = np.random.default_rng(0).normal(size=(len(windows), m, channels))
    covariance = 0.01**2 * np.eye(m) + drift_covariance(windows)  # (W, C, m, m)
    own = numbers.swapaxes(1, 2)[..., None]
    expected = (own * np.linalg.solve(covariance, own)).sum((1, 2, 3))
    found = ((white.whitened(numbers) / 0.01) ** 2).sum((1, 2))
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_what_snapshots_do_not_tell_is_there_where_commands_change():
    """No unknown force while the commands stand, and none of a log whose commands are held, but at a dead band."""
    log = flight()
    windows = cut_windows(log, 2.0, 1.0)
    unknown = unknown_force(windows, batch(changed(VEHICLE, dead_band=0 * VEHICLE.dead_band), [{}]))
    grid = windows.commands[windows.episode[0], windows.start[0] - 1 + np.arange(windows.steps + 2)]
    changes = np.abs(np.diff(grid, axis=0)).max(-1) > 0
    near = changes[:-1] | changes[1:]
    assert (unknown[0].max(-1)[near] > 0).all() and not unknown[0][~near].any()


def test_a_sound_vehicle_follows_once_its_errors_are_whitened():
    """What snapshots and a filter are off by is noise then, and without that a gap."""
    log = flight(drift=0.05)
    settings = load_settings()

    def left(of: FlightLog) -> float:
        problem = Problem.of(cut_windows(of, settings.window_s, settings.lead_s, settings.bin_s), VEHICLE, settings)
        problem, follow = follow_windows(problem)
        fit = fit_by_simulation(problem, Explanation(), follow, rounds=0)
        return fit.chi2 / fit.quadratic.numbers

    assert left(log) < settings.excess < left(replace(log, errors=SampleErrors()))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        pytest.param({}, None, marks=pytest.mark.thorough),
        pytest.param({"thruster_gain": {"gain_3": 0.0}}, "gain_3", marks=pytest.mark.thorough),
        ({"thruster_gain": {"gain_6": 0.5}}, "gain_6"),
    ],
)
def test_a_thruster_is_named_through_snapshots_and_drift(change, named):
    """A sound vehicle has no gap, a dead and a weak thruster are found with number and value."""
    found = diagnose(flight(change, seconds=60.0, seed=3, drift=0.04), VEHICLE, vehicle_name="ardusub_sitl")
    if named is None:
        assert found.verdict is Verdict.NO_GAP
        return
    assert [effect.name for effect in found.effects] == ["thruster_gain"]
    shown = {name: p.value for name, p in found.effects[0].parameters.items() if p.value != p.nominal}
    assert shown == {named: pytest.approx(change["thruster_gain"][named], abs=0.1)}
