"""Logs that hide roll and pitch."""

import numpy as np
import pytest
from flown_logs import fly, hold

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.motion.smooth import loose_start
from auv_torchrl.vehicle import load_vehicle
from tests.few_thrusters import FEW

PAPER = load_vehicle("paper")
SHORT = {"episodes": 3, "seconds": 14.0}


@pytest.mark.thorough
def test_a_tilt_that_nobody_measured_is_inferred():
    """A centre of gravity 2 cm off tilts a free vehicle; position and yaw alone tell so, and by how much it is off."""
    diagnosis = diagnose(fly(PAPER, {"mass_offset": {"x": 0.02}}, seed=1, **SHORT), PAPER)
    (effect,) = diagnosis.effects
    assert effect.name == "mass_offset"
    assert abs(effect.parameters["x"].value - 0.02) < 0.002
    assert diagnosis.verdict is Verdict.EXPLAINED
    assert "attitude_free" in {finding.code for finding in diagnosis.findings}


def test_thrusters_that_only_roll_tells_apart_are_declared():
    """On a level vehicle either vertical thruster may be the weak one; the diagnosis says so, and that it is level."""
    diagnosis = diagnose(fly(hold(PAPER), {"thruster_gain": {"gain_5": 0.5}}, seed=1, **SHORT), PAPER)
    assert [effect.name for effect in diagnosis.effects] == ["thruster_gain"]
    assert ("gain_5", "gain_6") in diagnosis.indistinguishable
    assert "attitude_held" in {finding.code for finding in diagnosis.findings}


@pytest.mark.parametrize("name", FEW)
def test_a_vehicle_that_no_thruster_tilts_may_be_tilted_at_a_start(name):
    """Its prior is narrow and no zero: the water tilts it."""
    loose = loose_start(load_vehicle(FEW[name][0]))
    assert np.isfinite(loose).all() and (loose > 0.01).all()


@pytest.mark.thorough
@pytest.mark.slow
def test_a_log_of_a_vehicle_with_two_propellers_is_diagnosed():
    """Nothing else pushes it, and it tilts by itself: the weak propeller is named."""
    two = load_vehicle(FEW["catamaran"][0])
    diagnosis = diagnose(fly(two, {"thruster_gain": {"gain_2": 0.5}}, seed=1, **SHORT), two)
    assert [effect.name for effect in diagnosis.effects] == ["thruster_gain"]
    assert abs(diagnosis.effects[0].parameters["gain_2"].value - 0.5) < 0.03
