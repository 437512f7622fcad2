"""The least of a quadratic within bounds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from auv_torchrl.diagnosis.identify.assess import covariance_of_values
from auv_torchrl.sysid.bounded import least_within, minimum_within


def quadratic(seed, size):
    """A curvature whose numbers have units of their own, where it pulls, and bounds about 0."""
    rng = np.random.default_rng(seed)
    unit = 10.0 ** rng.uniform(-3, 3, size)
    root = rng.normal(size=(size + 2, size)) * unit
    g = root.T @ rng.normal(size=size + 2)
    return root.T @ root, g, (-rng.uniform(0, 2, size) / unit, rng.uniform(0, 2, size) / unit)


@given(st.integers(0, 10_000), st.integers(1, 7))
def test_it_keeps_within_bounds_and_goes_down(seed, size):
    """From wherever it begins, and what is held stays where it is."""
    H, g, bounds = quadratic(seed, size)
    free = np.random.default_rng(seed + 1).uniform(size=size) < 0.8
    for x in (least_within(H, g, bounds, np.eye(size)), minimum_within(H, g, bounds, np.zeros(size), free)):
        assert (bounds[0] <= x).all()
        assert (x <= bounds[1]).all()
        assert x @ H @ x - 2 * g @ x <= 1e-9 * np.abs(g @ x)
    assert not x[~free].any()


@given(st.integers(0, 10_000), st.integers(1, 7))
def test_where_no_bound_is_in_the_way_it_is_the_minimum(seed, size):
    """Along all directions."""
    H, g, _ = quadratic(seed, size)
    everywhere = np.full(size, -np.inf), np.full(size, np.inf)
    x, unit = least_within(H, g, everywhere, np.eye(size)), np.sqrt(np.diag(H))
    assert (H @ x - g) / unit == pytest.approx(0.0, abs=1e-6 * np.abs(g / unit).max())


def test_a_curvature_that_rounding_made_negative_breaks_nothing():
    """What is left of the difference of two large numbers may be below 0, by more than others are above."""
    H, g, bounds = quadratic(0, 4)
    H[1] = H[:, 1] = 0.0
    H[1, 1] = -2e9
    x = least_within(H, g, bounds, np.eye(4))
    assert ((bounds[0] <= x) & (x <= bounds[1])).all()


def test_a_curvature_lost_in_rounding_leaves_the_prior():
    """What a log tells nothing of stays as wide as before, below 0 or not; the rest is the inverse of curvatures."""
    widths = np.array([0.5, 2.0])
    known = np.array([[3.0, 1.0], [1.0, 4.0]])
    np.testing.assert_allclose(covariance_of_values(known, widths), np.linalg.inv(known + np.diag(widths**-2.0)))
    np.testing.assert_allclose(covariance_of_values(np.diag([-1e3, 4.0]), widths), np.diag([0.25, 1 / 4.25]))
