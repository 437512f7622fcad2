"""What an owner is told to do about what was found."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.advice import thruster_swap
from auv_torchrl.vehicle import load_vehicle
from tests.uneven import UNEVEN, load_any

VEHICLES = ("paper", "bluerov2", "bluerov2_heavy", "ardusub_sitl", UNEVEN)
ADVISED = [effect for effect in EFFECTS.values() if not effect.trial.is_noise and not effect.trial.covers]
PAPER = load_vehicle("paper")


@settings(max_examples=10)
@given(st.sampled_from(VEHICLES), st.data())
@pytest.mark.parametrize("effect", ADVISED, ids=lambda effect: effect.name)
def test_every_effect_that_is_named_says_what_to_do(effect, name, data):
    """Whatever departs from nominal, and by how much, there are clauses in plain words."""
    vehicle = load_any(name)
    declared, nominal = effect.member_parameters(vehicle), effect.nominal(vehicle)
    members = data.draw(st.lists(st.sampled_from(sorted(declared)), min_size=1, unique=True))
    values = dict(nominal)
    for member in members:
        p = declared[member]
        if p.discrete:
            values[member] = float(data.draw(st.integers(1, vehicle.thrusters)))
        else:
            values[member] = data.draw(st.floats(p.low, p.high))
    autopilot = {f"MOT_{i}_DIRECTION": 1.0 for i in range(1, data.draw(st.integers(1, 9)))}
    advice = effect.advise(vehicle, values, autopilot)
    assert bool(advice) == (values != nominal)
    for one in advice:
        assert one.do and not one.do.endswith(".") and "{" not in one.do and "nan" not in one.do


def advised(name, **values):
    """Advice about an effect on the vehicle ``paper``, its values given."""
    effect = EFFECTS[name]
    return effect.advise(PAPER, {**effect.nominal(PAPER), **values}, {"MOT_3_DIRECTION": -1.0})


def test_a_reversed_thruster_is_turned_by_its_parameter():
    """Where the log tells the parameter, its other sign is given; elsewhere its name."""
    known, unknown = advised("thruster_gain", gain_3=-0.95, gain_4=-0.4)
    assert known.param == {"MOT_3_DIRECTION": 1.0}
    assert "set MOT_3_DIRECTION to 1 (it is -1)" in known.do
    assert not unknown.param and "MOT_4_DIRECTION" in unknown.do and "weak, too" in unknown.do


@pytest.mark.parametrize(
    ("gain", "words"), [(0.02, "gives nothing"), (0.34, "gives 34\u202f%"), (1.3, "compare its propeller")]
)
def test_a_thruster_that_is_not_reversed_is_looked_at(gain, words):
    """A dead, a weak and a strong one each have causes of their own."""
    (one,) = advised("thruster_gain", gain_2=gain)
    assert words in one.do and "thruster 2" in one.do and not one.param


def test_exchanged_plugs_are_named_once():
    """A pair is one sentence; of a ring each thruster is told where it belongs."""
    pair, *ring = advised("thruster_swap", command_1=2.0, command_2=1.0, command_3=4.0, command_4=5.0, command_5=3.0)
    assert "motors 1 and 2" in pair.do
    assert [one.do.split(":")[0] for one in ring] == [
        f"thruster {to} is plugged in where thruster {by} belongs" for to, by in ((3, 4), (4, 5), (5, 3))
    ]


def test_exchanged_plugs_can_be_mended_by_the_functions_of_the_outputs():
    """Where the log has them; a thruster that gets the command of another sits on the output of that one."""
    effect = EFFECTS["thruster_swap"]
    functions = {f"SERVO{k}_FUNCTION": 32.0 + n for k, n in ((1, 1), (2, 2), (3, 5), (5, 3))}
    (pair,) = effect.advise(PAPER, {**effect.nominal(PAPER), "command_2": 3.0, "command_3": 2.0}, functions)
    assert pair.param == {"SERVO2_FUNCTION": 35.0, "SERVO5_FUNCTION": 34.0}
    assert "or set SERVO5_FUNCTION to 34 and SERVO2_FUNCTION to 35" in pair.do


def test_the_ninth_to_the_twelfth_motor_have_functions_of_their_own():
    """ArduPilot goes on with 82 after 40, so that motor 9 belongs on an output with 82 and not with 41."""
    functions = {"SERVO8_FUNCTION": 82.0, "SERVO9_FUNCTION": 40.0, "SERVO12_FUNCTION": 85.0}
    (pair,) = thruster_swap({"command_9": 8.0, "command_8": 9.0}, functions)
    assert pair.param == {"SERVO8_FUNCTION": 40.0, "SERVO9_FUNCTION": 82.0}
    assert "set SERVO8_FUNCTION to 40 and SERVO9_FUNCTION to 82" in pair.do
    (lost,) = thruster_swap({"command_9": 12.0}, functions)
    assert lost.param == {"SERVO12_FUNCTION": 82.0}


def test_trim_is_given_in_grams():
    """5.6 N too light are 571 g in water, or a tenth more of lead; too heavy, it is float that is added."""
    (light,), (heavy,) = advised("buoyancy", force=-5.6), advised("buoyancy", force=5.6)
    assert "571 g of ballast" in light.do and "628 g of lead" in light.do
    assert "571 g of lift in float" in heavy.do


def test_trim_is_moved_against_where_the_mass_went():
    """A centre of mass that lies forward is moved aft; a load is trimmed where it sits."""
    (offset,) = advised("mass_offset", x=0.03, y=-0.01)
    assert "3.0 cm aft and 1.0 cm to starboard" in offset.do
    look, trim = advised("payload", mass=1.0, weight=4.0, x=-0.2)
    assert "0.20 m aft" in look.do and "408 g of lift in float" in trim.do


def test_a_thruster_is_turned_back():
    """What points to starboard by 0.2 rad is turned to port by 11 degrees."""
    (one,) = advised("thruster_misalignment", angle_1=0.2)
    assert "-11°" in one.do


def test_thrusters_that_all_turn_the_wrong_way_are_one_clause():
    """In order of their numbers, behind the plugs that are exchanged."""
    in_words = EFFECTS["thruster_swap"].sentence
    assert in_words is not None
    assert in_words({"command_10": -10.0, "command_2": -2.0, "command_4": -4.0}) == (
        "thrusters 2, 4 and 10 turn the wrong way"
    )
    assert in_words({"command_1": 7.0, "command_7": -1.0, "command_2": -2.0}) == (
        "the plugs of thrusters 1 and 7 are exchanged; thrusters 2 and 7 turn the wrong way"
    )
