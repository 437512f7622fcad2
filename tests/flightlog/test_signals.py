"""Rolling means and medians are those of scipy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import median_filter, uniform_filter1d

from auv_torchrl.flightlog.signals import rolling_mean, rolling_median

COLUMNS = st.lists(st.floats(-1e3, 1e3), min_size=9, max_size=40).map(np.array)
SIZES = st.sampled_from((1, 3, 5, 9))


@given(COLUMNS, SIZES)
def test_they_are_those_of_scipy(values, size):
    """At the ends too, for columns longer than the window."""
    assert np.array_equal(rolling_median(values, size), median_filter(values, size, mode="nearest"))
    assert rolling_mean(values, size) == pytest.approx(uniform_filter1d(values, size), abs=1e-9)


@given(st.lists(st.floats(-1e3, 1e3), max_size=4).map(np.array))
def test_fewer_values_than_the_window_holds_stay_as_they_are(values):
    """Also none at all."""
    assert np.array_equal(rolling_median(values, 5), values)
