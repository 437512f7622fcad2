"""Contracts that hold over the whole registry of effects, on every vehicle."""

import math

import numpy as np
import pytest

from auv_torchrl.effects import EFFECTS, get_effect
from auv_torchrl.paths import config_names
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.thrusters import applied_thrust, body_wrench, thrust_target
from auv_torchrl.vehicle import load_vehicle, stacked
from tests.hovering import ACTING, SERVO_EFFECTS, one_for
from tests.uneven import UNEVEN, load_any

effects = pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)


@pytest.mark.parametrize("name", [*config_names("vehicle"), UNEVEN])
@effects
def test_nominal_values_leave_the_vehicle_as_it_is(effect, name):
    """Every effect at its nominal values is the identity, also where thrusters differ from each other."""
    vehicle = load_any(name).expand(3).clone()
    same = effect.apply(vehicle, effect.nominal(vehicle))
    for field, value in vehicle.items():
        np.testing.assert_allclose(same.get(field), value, rtol=0, atol=1e-12, err_msg=field)


def away_from_nominal(effect, vehicle, share=0.4):
    """Values part of the way from nominal to the upper bound, the lower where nominal is that."""
    values = {}
    for name, p in effect.member_parameters(vehicle).items():
        nominal = p.nominal_value(vehicle, name)
        value = nominal + share * ((p.high if p.high > nominal else p.low) - nominal)
        values[name] = float(round(value)) if p.discrete else value
    return values


@pytest.mark.parametrize("name", ["paper", UNEVEN])
@effects
def test_an_effect_changes_only_a_copy(effect, name):
    """Apply is pure: the given vehicle stays as it was, and the changed one differs."""
    vehicle = load_any(one_for(effect.name, name))
    before = vehicle.clone()
    values = (
        {"command_1": 2.0, "command_2": 1.0} if effect.name == "thruster_swap" else away_from_nominal(effect, vehicle)
    )
    after = effect.apply(vehicle, values)
    for field, value in before.items():
        assert np.array_equal(vehicle.get(field), value), field
    assert any(not np.array_equal(after.get(field), value) for field, value in before.items())


@pytest.mark.parametrize("name", ["bluerov2", UNEVEN])
@effects
def test_batches_of_values_broadcast(effect, name):
    """Values (3, 1) on vehicles (2,) give vehicles (3, 2), each as if it were alone."""
    vehicle = load_any(name)
    batch = stacked([vehicle, vehicle.clone()])
    values = {
        name: np.array([[0.0], [0.1], [0.2]]) * (p.high - v) + v
        for (name, p), v in zip(
            effect.member_parameters(vehicle).items(), effect.nominal(vehicle).values(), strict=True
        )
    }
    together = effect.apply(batch, values)
    assert together.batch_size == (3, 2)
    for row in range(3):
        alone = effect.apply(vehicle, {name: float(value[row, 0]) for name, value in values.items()})
        for field, value in alone.items():
            np.testing.assert_allclose(together.get(field)[row, 1], value, rtol=1e-7, atol=1e-7, err_msg=field)


@effects
def test_values_outside_the_bounds_are_refused(effect):
    """Each bound of each parameter holds, and the error names parameter, bounds and unit."""
    vehicle = load_vehicle(one_for(effect.name, "paper"))
    for name, p in effect.member_parameters(vehicle).items():
        if effect.name in SERVO_EFFECTS and int(name[-1]) - 1 not in vehicle.servos:
            continue  # a propeller
        for wrong in (p.high + 1.0, p.low - 1.0, math.nan, math.inf, "many", None, True, [1.0]):
            with pytest.raises(ValueError, match=f"effect {effect.name}: {name} is "):
                effect.read(vehicle, {name: wrong})
        for bound in (p.low, p.high):
            if not p.discrete:
                assert effect.read(vehicle, {name: bound}) == {name: bound}


@effects
def test_unknown_parameters_are_refused(effect):
    """Reading and applying an unknown parameter is an error that lists the known ones."""
    vehicle = load_vehicle(one_for(effect.name, "paper"))
    known = next(iter(effect.member_parameters(vehicle)))
    with pytest.raises(ValueError, match=f"no parameter 'colour': there are .*{known}"):
        effect.read(vehicle, {"colour": 1.0})
    with pytest.raises(KeyError, match=known):
        effect.apply(vehicle, {"colour": 1.0})


@pytest.mark.parametrize("name", ["bluerov2_heavy", UNEVEN])
@effects
def test_every_effect_says_what_it_is(effect, name):
    """Meaning, source, unit, bounds around the nominal value and a sentence that takes the value are there."""
    vehicle = load_any(name)
    assert effect.meaning and effect.source
    for name, p in effect.member_parameters(vehicle).items():
        assert p.unit and p.low <= p.nominal_value(vehicle, name) <= p.high
    for p in effect.parameters:
        for which in p.which(vehicle) or ("",):
            assert p.sentence_of(f"{p.name}_{which}" if which else p.name, p.low)


@pytest.mark.parametrize(("value", "gives"), [(0.0, "no thrust"), (-0.004, "no thrust"), (0.01, "0.01 times its")])
def test_a_thruster_that_gives_nothing_is_said_to_give_no_thrust(value, gives):
    """As soon as its gain would be written as 0; of all thrusters at once, too."""
    (gain,) = EFFECTS["thruster_gain"].parameters
    assert gain.sentence_of("gain_3", value).startswith(f"thruster 3 gives {gives}")
    assert gain.sentence_of_all(value).startswith(f"every thruster gives {gives}")


@pytest.mark.parametrize("effect", [effect for name, effect in ACTING.items() if name.startswith("thrust")],
                         ids=lambda effect: effect.name)  # fmt: skip
@pytest.mark.parametrize("name", ["remus100", "milliampere"])
def test_effects_on_thrusters_leave_servos_as_they_are(effect, name):
    """But for the delay, the lag and the plugs, which a servo has as well; where it sits counts from the file."""
    vehicle = load_vehicle(name)
    if effect.name in ("thruster_swap", "thruster_lag"):
        return
    after, servos = effect.apply(vehicle, away_from_nominal(effect, vehicle)), list(vehicle.servos)
    for field, value in vehicle.items():
        if value.shape[:1] == (vehicle.thrusters,):
            np.testing.assert_array_equal(after.get(field)[servos], value[servos], err_msg=field)


def test_effects_on_fins_are_refused_where_there_is_none():
    """By the number of the thruster, or for a vehicle without fins."""
    with pytest.raises(ValueError, match="effect fin_gain: gain_1: thruster 1 is no fin: the fins are 2, 3, 4, 5"):
        get_effect("fin_gain").read(load_vehicle("remus100"), {"gain_1": 0.5})
    with pytest.raises(ValueError, match="effect fin_stuck: the vehicle has no fins"):
        get_effect("fin_stuck").read(load_vehicle("paper"), {"stuck": 1.0})
    both = get_effect("fin_stuck").apply(load_vehicle("remus100"), {"stuck_2": 1.0, "angle_2": 0.1})
    assert both.gain.tolist() == [1, 0, 1, 1, 1] and both.servo_offset.tolist() == [0, 0.1, 0, 0, 0]


def test_servos_of_fins_and_of_azimuth_thrusters_have_effects_of_their_own():
    """Of one making, for their own actuators; a thruster askew is a servo off its middle, and is called so."""
    ferry = load_vehicle("milliampere")
    with pytest.raises(
        ValueError, match="azimuth_gain: gain_2: thruster 2 is no azimuth servo: the azimuth servos are 3"
    ):
        get_effect("azimuth_gain").read(ferry, {"gain_2": 0.5})
    with pytest.raises(ValueError, match="effect fin_gain: the vehicle has no fins"):
        get_effect("fin_gain").read(ferry, {"gain_3": 0.5})
    with pytest.raises(ValueError, match="the vehicle has no azimuth servos: give one whose file has servos.turns"):
        get_effect("azimuth_stuck").read(load_vehicle("remus100"), {"stuck": 1.0})
    stuck = get_effect("azimuth_stuck").apply(ferry, {"stuck_3": 1.0, "angle_3": 0.1})
    assert stuck.gain.tolist() == [1, 1, 0, 1] and stuck.servo_offset.tolist() == [0, 0, 0.1, 0]
    same_as = get_effect("thruster_misalignment").trial.same_as
    assert same_as is not None and same_as(ferry, "angle_2", 0.3) == ("azimuth_offset", "offset_4", 0.3)
    assert same_as(load_vehicle("otter"), "angle_2", 0.3) is None
    c = [prepare(get_effect(name).apply(ferry, values)) for name, values in
         (("thruster_misalignment", {"angle_2": 0.3}), ("azimuth_offset", {"offset_4": 0.3}))]  # fmt: skip
    pushes = [body_wrench(one, ActiveTerms.of(one), np.array([100.0, 200.0, 0.1, -0.2]), np.zeros(())) for one in c]
    np.testing.assert_allclose(*pushes, atol=1e-9)
    plugs = get_effect("thruster_swap").trial.same_as
    assert plugs is not None and plugs(ferry, "command_3", -3.0) == ("azimuth_gain", "gain_3", -1.0)


def test_an_unknown_effect_lists_the_effects():
    """The error says what there is."""
    with pytest.raises(ValueError, match="no effect named 'gremlin': there are thruster_gain"):
        get_effect("gremlin")


@pytest.mark.parametrize("settings", [{"pair": [1, 1]}, {"pair": [1, 7]}, {"pair": [1, 2, 3]}, {"cycle": [2]}])
def test_impossible_swaps_are_refused(settings):
    """A swap needs different thrusters that the vehicle has."""
    with pytest.raises(ValueError, match="give different thrusters out of"):
        get_effect("thruster_swap").read(load_vehicle("paper"), settings)


@pytest.mark.parametrize("settings", [{"reversed": 3}, {"reversed": [7]}, {"command_1": 0.0}, {"command_2": -1.5}])
def test_commands_of_no_thruster_are_refused(settings):
    """Whose command a thruster gets is the number of a thruster, or less it."""
    with pytest.raises(ValueError, match="give a list of thrusters out of|negative for the opposite"):
        get_effect("thruster_swap").read(load_vehicle("paper"), settings)


def test_a_reversed_propeller_gives_what_it_gives_backwards():
    """Exchanged phase wires come before the curve, a gain of -1 behind it; on even thrusters the two are one.

    A fin that gets the opposite of its command has a gain of its own.
    """
    for name, is_even in (("paper", True), ("bluerov2_heavy", False)):
        vehicle = load_vehicle(name)
        wires = get_effect("thruster_swap").apply(vehicle, get_effect("thruster_swap").read(vehicle, {"reversed": [2]}))
        gain = get_effect("thruster_gain").apply(vehicle, {"gain_2": -1.0})
        thrusts = []
        for changed in (wires, gain):
            c = prepare(changed).numpy()
            command = np.linspace(-1, 1, 41)[:, None] * np.ones(vehicle.thrusters)
            thrusts.append(applied_thrust(c, ActiveTerms.of(c), thrust_target(c, ActiveTerms.of(c), command), 0.0))
        assert np.allclose(*thrusts) is is_even
        same_as = get_effect("thruster_swap").trial.same_as
        assert same_as is not None
        same = same_as(vehicle, "command_2", -2.0)
        assert same == (("thruster_gain", "gain_2", -1.0) if is_even else None)
        assert same_as(load_vehicle("remus100"), "command_2", -2.0) == ("fin_gain", "gain_2", -1.0)


def test_a_cycle_passes_commands_on():
    """cycle: [1, 2, 3] gives the command of 1 to thruster 2, of 2 to 3 and of 3 to 1."""
    vehicle = load_vehicle("paper")
    effect = get_effect("thruster_swap")
    routing = effect.apply(vehicle, effect.read(vehicle, {"cycle": [1, 2, 3]})).routing
    commands = np.arange(1.0, 7.0)
    assert (routing @ commands).tolist() == [3.0, 1.0, 2.0, 4.0, 5.0, 6.0]
