"""Degrees are told from radians by what turns, not by how large an angle is."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.flightlog.checks.degrees import convert_degrees
from auv_torchrl.flightlog.log import Episode
from auv_torchrl.physics.kinematics import euler_angles
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")
ANGLES = ("roll", "pitch", "yaw")
RATES = ("p", "q", "r")
DEGREES = 180 / np.pi


def turned_over(seed: int, rate: float, axis: int, noise: float, hz: float = 20.0, seconds: float = 40.0) -> Episode:
    """A vehicle that turns over and over about one axis of its body, and swings about the others."""
    rng = np.random.default_rng(seed)
    fine, steps = 6, round(seconds * hz)
    t = np.arange(steps * fine) / (hz * fine)
    body = 0.4 * rate * np.sin(2 * np.pi * t[:, None] / rng.uniform(3, 9, 3) + rng.uniform(0, 6, 3))
    body[:, axis] += rate
    q = np.zeros((len(t), 4))
    q[0, 0] = 1.0
    for k in range(len(t) - 1):
        half = body[k] / (hz * fine) / 2
        w, v = q[k, 0], q[k, 1:]
        q[k + 1] = [w - v @ half, *(v + w * half + np.cross(v, half))]
        q[k + 1] /= np.linalg.norm(q[k + 1])
    angles = np.stack(euler_angles(q[::fine]), -1) + noise * rng.normal(size=(steps, 3))
    pose = np.concatenate([np.zeros((steps, 3)), np.angle(np.exp(1j * angles))], -1)
    velocity = np.concatenate([np.zeros((steps, 3)), body[::fine] + noise * rng.normal(size=(steps, 3))], -1)
    return Episode(0, t[::fine], pose, velocity, rng.uniform(-0.3, 0.3, (steps, PAPER.thrusters)))


def written(e: Episode, unwrapped: bool, degrees: bool, rates: bool, rates_in_degrees: bool) -> tuple:
    """The episode as somebody logs it, and its axes."""
    pose, velocity = e.pose.copy(), e.velocity.copy()
    pose[:, 3:] = np.unwrap(pose[:, 3:], axis=0) if unwrapped else pose[:, 3:]
    pose[:, 3:] *= DEGREES if degrees else 1.0
    velocity[:, 3:] *= DEGREES if rates_in_degrees else 1.0
    if not rates:
        velocity[:] = np.nan
    return replace(e, pose=pose, velocity=velocity), (*ANGLES, *(RATES if rates else ()))


cases = {
    "seed": st.integers(0, 1000), "rate": st.floats(0.5, 3.0), "axis": st.integers(0, 2),
    "noise": st.sampled_from([0.0, 0.003, 0.02]), "unwrapped": st.booleans(), "rates": st.booleans(),
    "rates_in_degrees": st.booleans(),
}  # fmt: skip


@settings(max_examples=15)
@given(**cases)
def test_radians_of_a_vehicle_that_turns_over_stay_radians(seed, rate, axis, noise, unwrapped, rates, rates_in_degrees):
    """About each axis, wrapped or counted on, with and without rates in either unit."""
    flown = turned_over(seed, rate, axis, noise, seconds=20.0)
    episode, axes = written(flown, unwrapped, False, rates, rates_in_degrees)
    (read,), findings = convert_degrees((episode,), axes, PAPER)
    np.testing.assert_array_equal(read.pose, episode.pose)
    assert not [f for f in findings if f.code == "degrees" and set(f.columns) & set(ANGLES)]
    if rates:
        np.testing.assert_allclose(read.velocity[:, 3:], flown.velocity[:, 3:])


@settings(max_examples=15)
@given(**cases)
def test_degrees_of_a_vehicle_that_turns_over_are_converted(
    seed, rate, axis, noise, unwrapped, rates, rates_in_degrees
):
    """The same vehicle in degrees comes back in radians."""
    flown = turned_over(seed, rate, axis, noise, seconds=20.0)
    episode, axes = written(flown, unwrapped, True, rates, rates_in_degrees)
    (read,), findings = convert_degrees((episode,), axes, PAPER)
    assert [f.columns for f in findings if f.code == "degrees"][0] == ANGLES
    np.testing.assert_allclose(np.cos(read.pose[:, 3:]), np.cos(flown.pose[:, 3:]), atol=1e-9)
    if rates:
        np.testing.assert_allclose(read.velocity[:, 3:], flown.velocity[:, 3:])


def test_what_nothing_tells_stays_as_it_is_with_a_finding():
    """A slow tilt of 3 units could be half a turn over, or three degrees: it is read as radians."""
    t = np.arange(600) / 20
    pose = np.zeros((600, 6))
    pose[:, 4] = 3.0 * np.sin(t / 8)
    episode = Episode(0, t, pose, np.full((600, 6), np.nan), np.zeros((600, PAPER.thrusters)))
    (read,), (finding,) = convert_degrees((episode,), ANGLES, PAPER)
    np.testing.assert_array_equal(read.pose, pose)
    assert finding.code == "degrees_or_radians" and finding.limits and "pitch_deg" in finding.remedy


@pytest.mark.parametrize("degrees", [False, True])
def test_a_unit_that_is_named_is_not_weighed(degrees):
    """An axis that a name has settled is left as it is."""
    episode, axes = written(turned_over(0, 1.0, 0, 0.0, seconds=10.0), True, degrees, True, False)
    (read,), findings = convert_degrees((episode,), axes, PAPER, frozenset(axes))
    np.testing.assert_array_equal(read.pose, episode.pose)
    assert not findings
