"""A thruster that departs from the others is a fault, and no error of the vehicle's file."""

import numpy as np
import pytest

from auv_torchrl.diagnosis.calibrate.parameters import Coefficient
from auv_torchrl.diagnosis.calibrate.standing_out import standing_out


def coefficients(effect="thruster_gain", member="gain", number=6):
    return [Coefficient(effect, f"{member}_{i + 1}", 1.0, 0.4, -2.0, 2.0, "1") for i in range(number)]


def covariance(own, number=6):
    """Each within ``own``."""
    return np.eye(number) * own**2


@pytest.mark.parametrize(("gain", "others"), [(0.07, 0.5), (-0.9, 1.1), (0.0, 1.0), (0.1, 0.6)])
def test_a_dead_or_reversed_thruster_stands_out(gain, others):
    """Whatever all of them lose together, which may be wholly unsure."""
    values = np.full(6, others)
    values[4] = gain
    (one,) = standing_out(coefficients(), values, covariance(0.05) + np.outer(values, values) * 0.3**2)
    assert (one.effect, one.member) == ("thruster_gain", "gain_5") and one.probability > 0.7
    assert one.ratio == pytest.approx(gain / others)


def test_two_thrusters_stand_out_of_eight():
    """The second is compared with the others that are left."""
    values = np.array([0.9, 0.0, 1.0, 1.1, 0.05, 1.0, 0.95, 1.05])
    found = standing_out(coefficients(number=8), values, covariance(0.04, number=8))
    assert {one.member for one in found} == {"gain_2", "gain_5"}


@pytest.mark.parametrize("scale", [0.4, 1.0, 1.6])
def test_what_all_lose_together_is_no_fault(scale):
    """Nor what sound thrusters differ by, nor a thruster of which a log tells nothing."""
    values = scale * np.array([0.9, 1.1, 1.0, 0.85, 1.15, 1.0])
    assert standing_out(coefficients(), values, covariance(0.05)) == ()
    unsure = covariance(0.05)
    unsure[2, 2] = 1.0
    values[2] = 0.1 * scale
    assert standing_out(coefficients(), values, unsure) == ()


def test_none_stands_out_of_thrusters_that_all_differ():
    """Gains from 0.06 to 0.2 of the file's are no thrusters: the correction has taken up what no gain does."""
    values = np.array([0.2, 0.1, 0.06, 0.1, -0.03, -0.02])
    assert standing_out(coefficients(), values, covariance(0.02)) == ()


def test_numbers_that_thrusters_do_not_share_are_not_compared():
    """Bent brackets have nothing in common."""
    values = np.array([1.0, 1.0, 0.0, 1.0, 1.0, 1.0])
    assert standing_out(coefficients("thruster_misalignment", "angle"), values, covariance(0.01)) == ()
