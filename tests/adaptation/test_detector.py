"""The stated false-alarm rate of the change detector."""

import numpy as np
import pytest

from auv_torchrl.adaptation.detector import ChangeDetector


@pytest.mark.parametrize("steps", [500, 3000])
def test_the_stated_time_between_false_alarms_is_the_measured_one(steps):
    """Fed with healthy innovations, alarms come as rarely as was asked for."""
    detector = ChangeDetector(4, 3.0, steps, 1e-4)
    rng = np.random.default_rng(0)
    total, alarms, count, length = np.zeros(500), 0, 500, 8 * steps
    everyone = np.ones(count, dtype=bool)
    for _ in range(length):
        total = detector.advance(total, rng.chisquare(4, count), everyone)
        raised = total > detector.threshold
        alarms += int(raised.sum())
        total[raised] = 0.0
    assert count * length / alarms == pytest.approx(steps, rel=0.08)


def test_one_wild_measurement_raises_no_alarm():
    """A single innovation of any size stays below the threshold, two in a row do not."""
    detector = ChangeDetector(4, 3.0, 720_000, 1e-4)
    usable = np.ones(1, dtype=bool)
    once = detector.advance(np.zeros(1), np.full(1, 1e12), usable)
    assert once[0] < detector.threshold < detector.advance(once, np.full(1, 1e12), usable)[0]


def test_an_impossible_rate_is_refused():
    """A test that could never tell change from noise is an error."""
    with pytest.raises(ValueError, match="larger smallest_shift"):
        ChangeDetector(4, 0.01, 1e12, 1e-4)
