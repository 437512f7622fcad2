"""Logs that hide roll and pitch."""

from flown_logs import fly, hold

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")
SHORT = {"episodes": 3, "seconds": 14.0}


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
