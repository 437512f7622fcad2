"""The rank of what a vehicle can do, over vehicles and faults."""

import pytest

from auv_torchrl.authority import Recovery, authority
from auv_torchrl.effects import get_effect
from auv_torchrl.paths import config_names
from auv_torchrl.vehicle import CONTROLLED, load_vehicle


def judge(vehicle_name, **gains):
    nominal = load_vehicle(vehicle_name)
    return authority(get_effect("thruster_gain").apply(nominal, gains), nominal, "fault")


@pytest.mark.parametrize("name", config_names("vehicle"))
def test_every_nominal_vehicle_controls_all_four_degrees_of_freedom(name):
    """Without a fault both ranks are four and every degree of freedom moves alone."""
    whole = judge(name)
    assert (whole.channel_rank, whole.thruster_rank) == (4, 4)
    assert whole.independent == CONTROLLED
    assert whole.recovery is Recovery.CHANNELS


@pytest.mark.parametrize("name", config_names("vehicle"))
def test_two_dead_horizontal_thrusters_are_declared_infeasible(name):
    """With thrusters 1 and 2 dead the rank is 3 at the thrusters, sway and yaw only move together."""
    two_dead = judge(name, gain_1=0.0, gain_2=0.0)
    assert two_dead.thruster_rank == 3
    assert two_dead.recovery is Recovery.NONE
    assert two_dead.independent == ("surge", "heave")
    assert two_dead.coupled == ("sway", "yaw")
    assert "3 of 4 degrees of freedom can be controlled (rank 3)" in str(two_dead)
    assert "no map of commands can recover it" in str(two_dead)


@pytest.mark.parametrize("name", config_names("vehicle"))
def test_two_reversed_thrusters_need_a_map_to_the_thrusters(name):
    """With thrusters 1 and 2 reversed the channels have rank 3, the thrusters rank 4."""
    two_reversed = judge(name, gain_1=-1.0, gain_2=-1.0)
    assert (two_reversed.channel_rank, two_reversed.thruster_rank) == (3, 4)
    assert two_reversed.recovery is Recovery.THRUSTERS


def test_no_thruster_at_all_loses_everything():
    """All thrusters dead: rank 0 and nothing remains."""
    dead = judge("paper", **{f"gain_{i}": 0.0 for i in range(1, 7)})
    assert dead.thruster_rank == 0
    assert dead.lost == CONTROLLED


def test_a_batch_of_vehicles_is_refused():
    """Authority is judged for one vehicle at a time."""
    nominal = load_vehicle("paper")
    with pytest.raises(ValueError, match="one vehicle at a time"):
        authority(nominal.expand(3), nominal)
