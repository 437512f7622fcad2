"""Drag that differs by the direction of travel."""

import numpy as np
import pytest
from flown_logs import fly, hold
from hypothesis import given
from hypothesis import strategies as st

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.effects import EFFECTS
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.hydrodynamics import drag
from auv_torchrl.vehicle import load_vehicle, read_vehicle_file, stacked

PAPER = load_vehicle("paper")
EFFECT = EFFECTS["drag_asymmetry"]


@given(st.floats(-0.9, 0.9), st.floats(0.01, 2.0))
def test_drag_is_larger_one_way_by_what_it_is_smaller_the_other_way(share, speed):
    """Its quadratic part alone; both ways together it is what it was, and it never pushes."""
    changed = prepare(stacked([EFFECT.apply(PAPER, {"asymmetry_heave": share})])).numpy()
    plain = prepare(stacked([PAPER])).numpy()
    down = np.array([[0.0, 0.0, speed, 0.0, 0.0, 0.0]])
    ahead, back = (drag(changed, ActiveTerms.of(changed), way * down)[0] for way in (1, -1))
    usual = drag(plain, ActiveTerms.of(plain), down)[0]
    np.testing.assert_allclose(ahead - back, 2 * usual, rtol=1e-12)
    np.testing.assert_allclose((ahead + back)[2], 2 * share * 153.2 * speed**2, rtol=1e-9, atol=1e-9)
    assert ahead[2] > 0 > back[2]


def test_a_file_may_say_it():
    """As a share in each degree of freedom; one of 1 or more is refused."""
    content = dict(read_vehicle_file("paper")) | {"drag_asymmetry": [0.2, 0, -0.3, 0, 0, 0]}
    assert load_vehicle(content).drag_asymmetry.tolist() == [0.2, 0, -0.3, 0, 0, 0]
    with pytest.raises(ValueError, match="drag_asymmetry is .*: give values above -1 and below 1"):
        load_vehicle(content | {"drag_asymmetry": [1.5, 0, 0, 0, 0, 0]})


def test_it_is_named_with_its_direction_and_value():
    """A vehicle that drags more going down than up."""
    found = diagnose(fly(hold(PAPER), {"drag_asymmetry": {"asymmetry_heave": 0.5}}, episodes=4, seed=2), PAPER)
    assert found.verdict is Verdict.EXPLAINED
    (effect,) = found.effects
    assert (effect.name, set(effect.parameters)) == ("drag_asymmetry", {"asymmetry_heave"})
    assert effect.parameters["asymmetry_heave"].value == pytest.approx(0.5, abs=0.05)
