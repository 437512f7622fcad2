"""Accelerations along a known motion, compiled and as they are written."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.effects import EFFECTS
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.kernel import native, rates
from tests.physics.test_kernel import drawn_vehicles, names, seeds


def drawn_motion(windows, rows, count, thrusters, rng):
    """States, thrusts and times; one stands for all rows where ``rows`` is 1."""
    states = rng.normal(size=(windows, rows, count, 13))
    states[..., 3:7] /= np.linalg.norm(states[..., 3:7], axis=-1, keepdims=True)
    return states, 30 * rng.normal(size=(windows, rows, count, thrusters)), 60 * rng.random((windows, rows, count))


@given(st.sampled_from(sorted(EFFECTS)), names, seeds, st.integers(1, 5), st.integers(1, 5), st.booleans())
@settings(max_examples=60, deadline=None)
def test_compiled_rates_are_the_written_ones(effect, name, seed, windows, rows, shared):
    """For each effect, any vehicle and motion, also where one motion stands for all vehicles."""
    rng = np.random.default_rng(seed)
    c = prepare(drawn_vehicles(name, EFFECTS[effect], rows, rng)).numpy()
    motion = drawn_motion(windows, 1 if shared else rows, 3, c.full_thrust.shape[-1], rng)
    found = rates(c, ActiveTerms.of(c), *motion)
    with_numpy = written(c, motion)
    assert found.shape == with_numpy.shape == (windows, rows, 3, 6)
    np.testing.assert_allclose(found, with_numpy, rtol=0, atol=1e-12 * max(1.0, np.abs(with_numpy).max()))


def written(c, motion):
    """The same as numpy has it."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(native.CHOICE, "numpy")
        return rates(c, ActiveTerms.of(c), *motion)


def test_along_no_motion_there_are_no_rates():
    """Nor for no windows."""
    rng = np.random.default_rng(0)
    c = prepare(drawn_vehicles("paper", EFFECTS["current"], 2, rng)).numpy()
    assert rates(c, ActiveTerms.of(c), *drawn_motion(0, 2, 3, c.full_thrust.shape[-1], rng)).shape == (0, 2, 3, 6)
    assert rates(c, ActiveTerms.of(c), *drawn_motion(2, 1, 0, c.full_thrust.shape[-1], rng)).shape == (2, 2, 0, 6)
