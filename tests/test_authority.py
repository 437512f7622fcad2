"""The rank of what a vehicle can do, over vehicles and faults."""

import pytest

from auv_torchrl.authority import Recovery, authority, check_control, pushed
from auv_torchrl.effects import get_effect
from auv_torchrl.vehicle import CONTROLLED, DEGREES_OF_FREEDOM, load_vehicle, read_vehicle_file
from tests.entries import with_entry
from tests.few_thrusters import FEW, with_thrusters, without_sway
from tests.hovering import HOVERING


def judge(vehicle_name, **gains):
    nominal = load_vehicle(vehicle_name)
    return authority(get_effect("thruster_gain").apply(nominal, gains), nominal, "fault")


@pytest.mark.parametrize("name", HOVERING)
def test_every_nominal_vehicle_that_hovers_controls_all_four_degrees_of_freedom(name):
    """Without a fault both ranks are four and every degree of freedom moves alone."""
    whole = judge(name)
    assert (whole.channel_rank, whole.thruster_rank) == (4, 4)
    assert whole.independent == CONTROLLED
    assert whole.recovery is Recovery.CHANNELS


@pytest.mark.parametrize("name", HOVERING)
def test_two_dead_horizontal_thrusters_are_declared_infeasible(name):
    """With thrusters 1 and 2 dead the rank is 3 at the thrusters, sway and yaw only move together."""
    two_dead = judge(name, gain_1=0.0, gain_2=0.0)
    assert two_dead.thruster_rank == 3
    assert two_dead.recovery is Recovery.NONE
    assert two_dead.independent == ("surge", "heave")
    assert two_dead.coupled == ("sway", "yaw")
    assert "3 of 4 degrees of freedom can be controlled (rank 3)" in str(two_dead)
    assert "no map of commands can recover it" in str(two_dead)


@pytest.mark.parametrize("name", HOVERING)
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


@pytest.mark.parametrize("name", HOVERING)
def test_every_shipped_vehicle_that_hovers_controls_what_its_tasks_need(name):
    """By its mixer and by its thrusters; with eight of them roll and pitch, too."""
    vehicle = load_vehicle(name)
    assert pushed(vehicle, CONTROLLED, by_channels=True) == CONTROLLED
    check_control(vehicle, "any", CONTROLLED, by_channels=True)
    six = pushed(vehicle, DEGREES_OF_FREEDOM, by_channels=False)
    assert ("pitch" in six) == (vehicle.thrusters == 8)


@pytest.mark.parametrize(("name", "can"), [(name, can) for name, (_, can) in FEW.items()])
def test_what_few_thrusters_cannot_push_is_named(name, can):
    """Of each vehicle, the degrees of freedom that it has and those that a task lacks."""
    vehicle = load_vehicle(FEW[name][0])
    assert pushed(vehicle, CONTROLLED, by_channels=False) == can
    missing = [axis for axis in CONTROLLED if axis not in can]
    with pytest.raises(ValueError, match=f"vehicle {name}: its thrusters push .* also needs {missing[0]}") as error:
        check_control(vehicle, "line", CONTROLLED, by_channels=True, name=name)
    assert all(axis in str(error.value) for axis in missing) and "\n" not in str(error.value)
    assert "its logs can still be diagnosed" in str(error.value)


def test_thrusters_that_push_one_way_need_the_weight_for_the_other():
    """Two that push down alone: what floats rises by itself, what is neutral does not, nor what is heavy."""
    for weight, heave in ((9.0, True), (11.0, False)):
        content = with_thrusters("one way", [[0.156, 0.111, 0.0], [0.156, -0.111, 0.0], [-0.156, 0.111, 0.0],
                                             [-0.156, -0.111, 0.0], [0, 0.2, 0], [0, -0.2, 0]],
                                 [[-1, 1, 0], [-1, -1, 0], [1, 1, 0], [1, -1, 0], [0, 0, 1], [0, 0, 1]],
                                 [[-1, 1, 0, 0, 0, 1], [-1, -1, 0, 0, 0, -1], [1, 1, 0, 0, 0, -1], [1, -1, 0, 0, 0, 1],
                                  [0, 0, 1, 1, 0, 0], [0, 0, 1, -1, 0, 0]],
                                 asymmetry=[0.0] * 4 + [0.99999] * 2)  # fmt: skip
        content = with_entry(content, ["rigid_body", "mass"], weight)
        content = with_entry(content, ["rigid_body", "buoyancy"], 10.0 * 9.81)
        assert ("heave" in pushed(load_vehicle(content), CONTROLLED, by_channels=True)) == heave


def test_thrusters_within_their_dead_band_push_nothing():
    """Backwards, where the dead band is wider than the reverse thrust: the rank knows nothing of it."""
    content = without_sway()
    content["thrusters"] |= {"asymmetry": 0.99, "dead_band": 1.0}
    assert pushed(load_vehicle(content), ("surge",), by_channels=False) == ()


def test_a_mixer_that_leads_nowhere_is_told_from_missing_thrusters():
    """The remedy is the mixer, or commands of the thrusters themselves."""
    whole = read_vehicle_file("bluerov2")
    content = with_entry(whole, ["mixer"], [[*row[:5], 0] for row in whole["mixer"]])
    vehicle = load_vehicle(content)
    with pytest.raises(ValueError, match="mixer has no command that pushes yaw .* task.thruster_commands=true"):
        check_control(vehicle, "line", CONTROLLED, by_channels=True)
    check_control(vehicle, "line", CONTROLLED, by_channels=False)


def test_faults_are_no_matter_of_the_file():
    """A dead or exchanged thruster leaves what the sound vehicle controls."""
    dead = get_effect("thruster_gain").apply(load_vehicle("paper"), {"gain_1": 0.0, "gain_2": 0.0})
    assert pushed(dead, CONTROLLED, by_channels=True) == CONTROLLED
