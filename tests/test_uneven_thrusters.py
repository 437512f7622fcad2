"""Thrusters that differ from each other: in the vehicle's file, in the water, in effects, in the diagnosis."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from auv_torchrl.compensation.known_vehicle import KnownVehicle
from auv_torchrl.diagnosis import diagnose
from auv_torchrl.diagnosis.identify.hypotheses import load_settings, make_candidates
from auv_torchrl.effects import get_effect
from auv_torchrl.effects.effect import changed, mean
from auv_torchrl.effects.response import in_proportion
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.thrusters import thrust_target
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle, read_vehicle_file
from tests.diagnosis.flown_logs import fly, hold
from tests.uneven import THRUSTERS, UNEVEN, load_any, uneven_file

values = st.lists(st.floats(0.01, 100.0), min_size=4, max_size=8)


@pytest.mark.parametrize("name", THRUSTERS)
def test_each_entry_takes_one_number_or_one_per_thruster(name):
    """A list of equal numbers is that number, to the last bit."""
    content = dict(read_vehicle_file("bluerov2"))
    one = content["thrusters"][name]
    listed = load_vehicle({**content, "thrusters": {**content["thrusters"], name: [one] * 6}})
    assert all(np.array_equal(value, listed.get(key)) for key, value in load_vehicle("bluerov2").items())
    assert load_any(UNEVEN).get(name).tolist() == THRUSTERS[name]


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("full_thrust", [50.0] * 5, "thrusters.full_thrust is .*: give one number, or 6, one per thruster"),
        ("limit", [50.0] * 5 + [-1.0], "thrusters.limit is .*: give values above 0"),
        ("dead_band", [1.0] * 5 + ["some"], "thrusters.dead_band is .*: give one number, or 6"),
        ("asymmetry", [0.0] * 5 + [1.0], "thrusters.asymmetry is .*: give values above -1 and below 1"),
        ("delay", [0.1] * 6, "thrusters.delay is .*: give one number"),
    ],
)
def test_a_list_that_cannot_be_is_refused(name, value, message):
    """Too short, out of range, no numbers, or for what all thrusters share."""
    content = uneven_file()
    content["thrusters"][name] = value
    with pytest.raises(ValueError, match=message):
        load_vehicle(content)


def test_each_thruster_follows_its_own_curve():
    """Thrust by its full thrust, exponent, asymmetry, dead band and limit, forwards and in reverse."""
    c = prepare(load_any(UNEVEN))
    for command in (-1.0, -0.6, -0.05, 0.05, 0.6, 1.0):
        thrust = thrust_target(c, ActiveTerms.of(c), np.full(6, command))
        for i in range(6):
            full, weaker, power, band, limit, _ = (entry[i] for entry in THRUSTERS.values())
            wanted = np.sign(command) * full * abs(command) ** power * (1 - weaker if command < 0 else 1)
            wanted = np.clip(wanted, -limit, limit)
            assert float(thrust[i]) == pytest.approx(wanted if abs(wanted) >= band else 0.0)


@given(values, st.floats(0.01, 100.0), st.sampled_from([0.0, 101.0, -3.0]))
def test_one_value_for_all_thrusters_is_their_mean_and_keeps_their_proportions(own, to, zero):
    """And those that are alike get that value to the last bit."""
    own, to = torch.tensor(own, dtype=torch.float64), torch.tensor(to, dtype=torch.float64)
    after = in_proportion(own, to, zero)
    torch.testing.assert_close(mean(after), to)
    torch.testing.assert_close((after - zero) * (own[0] - zero), (own - zero) * (after[0] - zero))
    assert torch.equal(in_proportion(own[:1].expand(6), to, zero), to.expand(6))
    assert mean(own[:1].expand(6)) == own[0]


@pytest.mark.parametrize(
    ("effect", "parameter", "field", "value"),
    [
        ("dead_band", "width", "dead_band", 3.0),
        ("thrust_curve", "exponent", "exponent", 2.0),
        ("thruster_lag", "time_constant", "lag", 0.3),
        ("thrust_curve", "asymmetry", "asymmetry", 0.1),
    ],
)
def test_an_effect_on_all_thrusters_moves_their_mean(effect, parameter, field, value):
    """The order of the thrusters stays, and nothing becomes impossible at the bounds."""
    vehicle, effect = load_any(UNEVEN), get_effect(effect)
    after = effect.apply(vehicle, {parameter: value}).get(field)
    assert float(after.mean()) == pytest.approx(value)
    assert after.argsort().tolist() == vehicle.get(field).argsort().tolist()
    declared = effect.member_parameters(vehicle)[parameter]
    for bound in (declared.low, declared.high):
        reached = effect.apply(vehicle, {parameter: bound}).get(field)
        assert np.isfinite(reached).all()
        assert (reached < 1).all() if field == "asymmetry" else (reached >= 0).all()


def test_values_relative_to_nominal_are_relative_to_each_thruster():
    """The diagnosis tries shares of each thruster's own limit, and no limit for all, which they have not in common."""
    candidates = [
        candidate
        for candidate in make_candidates(load_any(UNEVEN), load_settings())
        if candidate.effect == "thrust_limit"
    ]
    assert all(len(candidate.values) == 1 for candidate in candidates)
    for i, limit in enumerate(THRUSTERS["limit"]):
        tried = [candidate.values[f"limit_{i + 1}"] for candidate in candidates if f"limit_{i + 1}" in candidate.values]
        assert tried == pytest.approx([limit * tenths / 10 for tenths in range(1, 10)])


@pytest.mark.slow
def test_a_weak_thruster_among_different_ones_is_found():
    """The diagnosis of such a vehicle names it and its gain."""
    vehicle = hold(load_any(UNEVEN))
    (found,) = diagnose(fly(vehicle, {"thruster_gain": {"gain_3": 0.5}}, episodes=3, seconds=20.0), vehicle).effects
    assert (found.name, found.thrusters) == ("thruster_gain", (3,))
    assert found.parameters["gain_3"].value == pytest.approx(0.5, abs=0.05)


def test_a_command_that_reaches_another_thruster_has_the_reach_of_that_one():
    """The map of a known vehicle with swapped thrusters keeps within the limit of the one that gets the command."""
    vehicle = changed(load_any(UNEVEN), lag=np.zeros(6))
    known = get_effect("thruster_swap").apply(vehicle, {"command_1": 2.0, "command_2": 1.0})
    low, high = KnownVehicle(vehicle, known, StationKeeping())._limits
    share = np.array(THRUSTERS["limit"]) / THRUSTERS["full_thrust"]
    assert high == pytest.approx(share[[1, 0, 2, 3, 4, 5]].clip(max=1))
    assert low[0] == pytest.approx(-share[1])
