"""What vehicles do with commands: what many of them have alike, and what is asked for again, is worked out once."""

from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl.diagnosis.identify.hypotheses import apply_values, batch
from auv_torchrl.diagnosis.motion.actuation import actuate
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.effects import EFFECTS
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.simulate import simulated_logs
from tests.uneven import UNEVEN, load_any

VEHICLE, UNLIKE = load_vehicle("paper"), load_any(UNEVEN)  # whose thrusters differ from each other
ROWS = [
    {},
    {"dead_band": {"width": 1.5}},
    {"thruster_gain": {"gain_2": 0.3}},
    {"thrust_limit": {"limit_1": 5.0}},
    {"command_delay": {"delay": 0.03}},
    {"command_delay": {"delay": 0.12}, "thrust_limit": {"limit_1": 5.0}},
    {"thruster_lag": {"time_constant": 0.2}},
]


@pytest.mark.parametrize("parts", [1, 2])
def test_targets_of_many_vehicles_are_those_of_each(parts):
    """Whatever else is worked out with it, a vehicle calls for the same thrust."""
    (log,) = simulated_logs("paper", [{}], episodes=1, seconds=12.0)
    windows, steps = cut_windows(log, 1.0, 0.5, 0.2), np.arange(5)
    some = slice(0, len(windows))
    for rows in (ROWS[:4], ROWS):
        together = actuate(windows, batch(VEHICLE, rows))
        targets = together.targets(some, steps, parts)
        for place, row in enumerate(rows):
            alone = actuate(windows, batch(VEHICLE, [row]))
            for part, target in enumerate(alone.targets(some, steps, parts)):
                np.testing.assert_allclose(targets[part][:, place], target[:, 0], atol=1e-9)
            if alone.terms.lag:  # others have no thrust from before
                np.testing.assert_allclose(together.thrust[:, place], alone.thrust[:, 0], atol=1e-9)


def test_what_was_worked_out_is_of_the_same_commands_and_vehicles():
    """Targets asked for again are those of the first time, and not of other commands, times or vehicles."""
    (log,) = simulated_logs("paper", [{}], episodes=1, seconds=12.0)
    windows, steps = cut_windows(log, 1.0, 0.5, 0.2), np.arange(5)
    some = slice(0, len(windows))
    (first,) = actuate(windows, batch(VEHICLE, [{}])).targets(some, steps)
    (again,) = actuate(windows, batch(VEHICLE, [{}])).targets(some, steps)
    np.testing.assert_array_equal(again, first)
    turned = replace(windows, commands=-windows.commands)
    (other,) = actuate(turned, batch(VEHICLE, [{}])).targets(some, steps)
    np.testing.assert_allclose(other, -first, atol=1e-12)
    (later,) = actuate(windows, batch(VEHICLE, [{}])).targets(some, steps + 1)
    np.testing.assert_array_equal(later[:, :, :-1], first[:, :, 1:])
    dead = {"thrust_limit": dict.fromkeys(EFFECTS["thrust_limit"].nominal(VEHICLE), 0.0)}
    (nothing,) = actuate(windows, batch(VEHICLE, [dead])).targets(some, steps)
    assert first.any() and not nothing.any()


@pytest.mark.parametrize("name", EFFECTS)
def test_a_batch_is_its_vehicles_one_by_one(name):
    """Effects that act on all vehicles of a batch at once make of each what they make of it alone."""
    nominal = EFFECTS[name].nominal(UNLIKE)
    step = 1.0 if any(p.discrete for p in EFFECTS[name].parameters) else 0.1
    moved = {member: value + step for member, value in nominal.items()}
    member = next(iter(nominal))
    rows = [{}, {name: moved}, {name: {member: moved[member]}, "thruster_gain": {"gain_2": 0.3}}]
    together = batch(UNLIKE, rows)
    for place, row in enumerate(rows):
        alone = apply_values(UNLIKE, row)
        for field, value in together.items():
            np.testing.assert_allclose(value[place], alone.get(field), rtol=1e-12, atol=1e-12, err_msg=field)


def test_an_unknown_parameter_in_one_row_of_a_batch_is_named():
    """A parameter that its effect does not have is refused by its name, whatever the other rows hold."""
    with pytest.raises(KeyError, match="no parameters .'gain_9'."):
        batch(VEHICLE, [{"thruster_gain": {"gain_1": 0.5}}, {"thruster_gain": {"gain_9": 0.5}}])
