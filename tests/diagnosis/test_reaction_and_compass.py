"""Propellers that turn the vehicle, and a compass that turns with the current drawn."""

import numpy as np
import pytest
from flown_logs import fly, hold

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.effect import changed
from auv_torchrl.physics import prepare
from auv_torchrl.sensors import read
from auv_torchrl.vehicle import load_vehicle, read_vehicle_file

PAPER = load_vehicle("paper")


def test_a_propeller_turns_the_vehicle_about_its_axis():
    """The moment per newton beside that of its arm; a vehicle whose file leaves it out is the same to the bit."""
    content = dict(read_vehicle_file("bluerov2_heavy"))
    content["thrusters"] = {**content["thrusters"], "reaction": [0.0] * 4 + [0.016, -0.016, -0.016, 0.016]}
    plain, turned = prepare(load_vehicle("bluerov2_heavy")), prepare(load_vehicle(content))
    beyond = turned.allocation - plain.allocation
    assert beyond[5, 4:] == pytest.approx([0.016, -0.016, -0.016, 0.016]) and not beyond[:5].any()
    nothing = EFFECTS["reaction_torque"].apply(PAPER, {"arm_1": 0.0})
    assert np.array_equal(prepare(nothing).allocation, prepare(PAPER).allocation)


def test_a_propeller_of_the_other_hand_is_named():
    """A vertical thruster that turns the vehicle by 0.05 N m for each newton."""
    found = diagnose(fly(hold(PAPER), {"reaction_torque": {"arm_5": 0.05}}, episodes=4, seed=2), PAPER)
    assert found.verdict is Verdict.EXPLAINED
    (effect,) = found.effects
    assert (effect.name, effect.thrusters) == ("reaction_torque", (5,))
    assert effect.parameters["arm_5"].value == pytest.approx(0.05, abs=0.01)


def test_a_compass_that_turns_with_the_current_is_named():
    """Its angle at full thrust, and what to do about it."""
    found = diagnose(fly(hold(PAPER), {"compass_interference": {"angle": 0.5}}, episodes=4, seed=1), PAPER)
    (effect,) = found.effects
    assert effect.name == "compass_interference"
    assert effect.parameters["angle"].value == pytest.approx(0.5, abs=0.05)
    assert "move the compass away from power wires" in effect.advice[0].do


def test_the_heading_alone_feels_the_current():
    """At half of all thrusts the compass turns by half its angle, and nothing else is reported otherwise."""
    c = prepare(changed(PAPER, compass_per_load=np.array(0.4))).numpy()
    channels = ("x", "y", "z", "roll", "pitch", "yaw", "p", "q", "r")
    change = read(c, channels, np.zeros(12), np.array(0.5)) - read(c, channels, np.zeros(12))
    assert change == pytest.approx([0, 0, 0, 0, 0, 0.2, 0, 0, 0])


def test_a_filter_hides_the_compass():
    """It follows its compass slowly: what shows at once in such a heading is something else."""
    trial = EFFECTS["compass_interference"].trial
    assert trial.shows_in({}) and trial.shows_in({"x": 0.05, "yaw": 0.0}) and not trial.shows_in({"yaw": 0.002})
