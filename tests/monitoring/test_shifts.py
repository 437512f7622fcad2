"""Changes of a series: found where they are, and as rarely where there is none as is stated."""

import numpy as np
import pytest

from auv_torchrl.monitoring.shifts import candidates, gains, shifts, threshold

REFERENCE, WIDTH, ODDS = 3, 0.4, 1e-4


def found(value, variance, least=20.0):
    return shifts(np.asarray(value), np.asarray(variance), REFERENCE, least, WIDTH, ODDS)


def test_a_step_is_found_where_it_is():
    """A loss of 5 % from dive 9 on is one step, there, of that size."""
    rng = np.random.default_rng(0)
    value = -0.05 * (np.arange(20) >= 8) + 0.005 * rng.standard_normal(20)
    (shift,) = found(value, np.full(20, 0.005**2))
    assert not shift.is_drift
    assert shift.begin == 8
    assert shift.size == pytest.approx(-0.05, abs=0.01)
    assert shift.probability > 0.99


def test_a_drift_is_found_and_called_one():
    """A loss of 1 % a dive from dive 7 on is a drift of that size, and its moment lies within the interval."""
    rng = np.random.default_rng(1)
    value = -0.01 * np.maximum(np.arange(23) - 5, 0) + 0.004 * rng.standard_normal(23)
    (shift,) = found(value, np.full(23, 0.004**2))
    assert shift.is_drift
    assert shift.low <= 6 <= shift.high
    assert abs(shift.size + 0.01) < 3 * shift.deviation
    np.testing.assert_allclose(shift.at(np.arange(23))[-1], shift.size * (23 - shift.begin))


def test_what_is_mended_changes_twice():
    """Weed that is caught and taken off again is two steps of opposite signs."""
    rng = np.random.default_rng(2)
    dive = np.arange(30)
    value = -0.1 * ((dive >= 8) & (dive < 20)) + 0.01 * rng.standard_normal(30)
    first, second = sorted(found(value, np.full(30, 1e-4)), key=lambda shift: shift.begin)
    assert (first.begin, second.begin) == (8, 20)
    assert first.size < 0 < second.size


def test_dives_that_do_not_tell_are_passed_over():
    """A dive without a value, whatever stands there, changes nothing."""
    value, variance = np.zeros(15), np.full(15, 1e-4)
    value[9:] = 0.2
    value[5], variance[5] = 7.0, np.inf
    (shift,) = found(value, variance)
    assert shift.begin == 9


def test_nothing_is_found_where_nothing_is():
    """A sound series has no change, nor has one that nothing tells."""
    rng = np.random.default_rng(3)
    assert not found(0.01 * rng.standard_normal(50), np.full(50, 1e-4))
    assert not found(np.zeros(10), np.full(10, np.inf))
    assert not found(np.zeros(3), np.full(3, 1.0))


def test_the_moment_lies_within_its_interval():
    """Of 200 steps of three standard deviations, at least 90 % begin within the 95 % interval."""
    rng, hits = np.random.default_rng(4), 0
    for _ in range(200):
        at = int(rng.integers(6, 16))
        value = 3.0 * (np.arange(20) >= at) + rng.standard_normal(20)
        inside = shifts(value, np.ones(20), REFERENCE, 5.0, 5.0, ODDS)
        hits += any(shift.low <= at <= shift.high for shift in inside[:1])
    assert hits >= 180


def test_false_alarms_are_as_rare_as_stated():
    """Of fresh series of 100 sound dives, between a half and twice the stated share raises an alarm."""
    limit = threshold(1, REFERENCE, 1000.0)
    noise = np.random.default_rng(5).standard_normal((2000, 100))
    largest = np.zeros(2000)
    for n in range(REFERENCE + 1, 101):
        own = noise[:, :n]
        largest = np.maximum(largest, gains(own, np.ones_like(own), REFERENCE).max(1))
    assert 0.05 < (largest > limit).mean() < 0.2


def test_more_numbers_ask_for_more():
    """The threshold grows with the numbers that are watched and with the dives per false alarm."""
    assert threshold(1, REFERENCE, 1000.0) < threshold(30, REFERENCE, 1000.0) < threshold(30, REFERENCE, 10000.0)


def test_changes_begin_behind_the_reference():
    """No candidate begins in a reference dive, or in one that has not been flown."""
    begin = candidates(10, REFERENCE).begin
    assert begin.min() == REFERENCE
    assert begin.max() == 9
