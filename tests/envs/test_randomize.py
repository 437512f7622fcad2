"""Randomization: from the nominal, per vehicle, in the rows that are reset, from files that are checked."""

from functools import partial

import pytest
import torch
import yaml
from tensordict import TensorDict
from torchrl.envs import SerialEnv, StepCounter, TransformedEnv

from auv_torchrl.envs import BACKENDS, FleetEnv, RandomizeVehicle, make_fleet
from auv_torchrl.envs.randomize import read_ranges
from auv_torchrl.paths import config_names, config_path
from auv_torchrl.tasks import Cruise, StationKeeping
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.vehicle.tensors import tensordict_of, tensors
from tests.hovering import ACTING, SERVO_EFFECTS, one_for

PAPER = load_vehicle("paper")
CONTINUOUS = {name: effect for name, effect in ACTING.items() if not effect.parameters[0].discrete}


def ranges_of(name):
    return yaml.safe_load(config_path("randomization", name).read_text())


def suited(ranges):
    """Names of the vehicles that can be randomized so: those with fins or azimuth thrusters where these are drawn."""
    of_servos = SERVO_EFFECTS & set(ranges_of(ranges))
    return sorted({one_for(effect, "paper") for effect in of_servos}) or config_names("vehicle")


def randomized(ranges, count=4, seed=0, backend="torch", own_seed=None, vehicle=PAPER):
    task = Cruise(episode_s=0.5) if vehicle.servos else StationKeeping(episode_s=0.5)
    fleet = make_fleet(backend, vehicle, task, count, seed=seed)
    return TransformedEnv(fleet, RandomizeVehicle(vehicle, ranges, own_seed))


def fleet_of(env) -> FleetEnv:
    return env.base_env


@pytest.mark.parametrize("name", config_names("vehicle"))
@pytest.mark.parametrize("effect", CONTINUOUS.values(), ids=CONTINUOUS)
def test_a_zero_range_leaves_the_vehicle_unchanged(effect, name):
    """Every effect drawn from [nominal, nominal] gives the nominal vehicle."""
    vehicle = load_vehicle(name)
    ranges = {effect.name: {key: [value, value] for key, value in effect.nominal(vehicle).items()}}
    drawn = RandomizeVehicle(vehicle, ranges).draw(3, torch.Generator().manual_seed(0))
    for key, value in tensors(vehicle).items():
        torch.testing.assert_close(drawn.get(key), value.expand(3, *value.shape), rtol=0, atol=1e-12, msg=key)


SPELT_OUT = [name for name in config_names("randomization") if name != "uncertainty"]  # which needs a vehicle's file


@pytest.mark.parametrize("name", SPELT_OUT)
def test_three_resets_are_as_wide_as_one(name):
    """Draws start from the nominal: after many resets, no parameter lies farther away than the first range allows."""
    vehicle = PAPER if "paper" in suited(name) else load_vehicle(suited(name)[0])
    env = randomized(ranges_of(name), count=256, vehicle=vehicle)
    env.reset()
    once = fleet_of(env).vehicle
    for _ in range(3):
        env.reset()
    often = fleet_of(env).vehicle
    for key, value in tensors(vehicle).items():
        first, last = ((getattr(drawn, key) - value).abs().amax(0) for drawn in (once, often))
        assert (last <= 1.3 * first + 1e-12).all(), key
    changed = [key for key, value in vehicle.items() if not torch.equal(often.get(key), once.get(key))]
    assert bool(changed) == (name != "none")


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_partial_reset_redraws_its_rows_alone(backend):
    """The other vehicles keep their parameters and what the physics reads of them."""
    env = randomized({"thruster_gain": {"gain": [0.5, 1.5]}}, backend=backend)
    now = env.reset()
    before, read = fleet_of(env).vehicle, torch.as_tensor(fleet_of(env).simulator.coefficients.allocation).clone()
    mask = torch.tensor([[False], [True], [True], [False]])
    env.reset(now.set("_reset", mask.clone()), set_state=False)
    after, reads = fleet_of(env).vehicle, torch.as_tensor(fleet_of(env).simulator.coefficients.allocation)
    redrawn = mask[:, 0]
    assert torch.equal(after.gain[~redrawn], before.gain[~redrawn])
    assert (after.gain[redrawn] != before.gain[redrawn]).all()
    assert torch.equal(reads[~redrawn], read[~redrawn])
    assert not torch.equal(reads[redrawn], read[redrawn])


def test_a_seed_of_its_own_is_independent_of_the_starts():
    """With its own seed the same vehicles are drawn for every seed of the fleet."""
    ranges = {"linear_drag": {"scale": [0.5, 1.5]}}
    drawn = []
    for seed in (1, 2):
        env = randomized(ranges, seed=seed, own_seed=7)
        env.reset()
        drawn.append(fleet_of(env).vehicle.linear_drag)
    assert torch.equal(*drawn)


def test_a_family_draws_each_member_on_its_own():
    """Six thruster gains in one range are six numbers that fill it."""
    drawn = RandomizeVehicle(PAPER, {"thruster_gain": {"gain": [0.8, 1.2]}}).draw(
        2000, torch.Generator().manual_seed(0)
    )
    assert drawn.gain.amin() < 0.805 and drawn.gain.amax() > 1.195
    correlation = torch.corrcoef(drawn.gain.T)
    assert (correlation - torch.eye(6, dtype=torch.float64)).abs().max() < 0.1


@pytest.mark.parametrize(("ranges", "name"), [(ranges, name) for ranges in SPELT_OUT for name in suited(ranges)])
def test_every_file_suits_every_vehicle(ranges, name):
    """All ranges files can be drawn from, for all vehicles that have what is drawn, and give finite parameters."""
    vehicle = load_vehicle(name)
    drawn = RandomizeVehicle(vehicle, ranges_of(ranges)).draw(10, torch.Generator().manual_seed(0))
    assert all(value.isfinite().all() for _, value in drawn.items())


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ({"thruster_gian": {"gain": [0, 1]}}, "no effect named 'thruster_gian'"),
        ({"thruster_gain": {"gian": [0, 1]}}, "no parameter 'gian': there are gain_1"),
        ({"thruster_gain": {"gain_7": [0, 1]}}, "no parameter 'gain_7'"),
        ({"thruster_gain": {"gain": 1.0}}, r"give \[low, high\]"),
        ({"thruster_gain": {"gain": [0.0, 0.5, 1.0]}}, r"give \[low, high\]"),
        ({"thruster_gain": {"gain": [1.2, 0.8]}}, "low is above high"),
        ({"thruster_gain": {"gain": [0.8, 20.0]}}, r"give a number in \[-2, 2\]"),
        ({"thruster_gain": {"gain": ["a", "b"]}}, "give a number in"),
        ({"thruster_gain": None}, "give a mapping"),
        ({"thruster_swap": {"command_1": [1, 2]}}, "has no range"),
        ([1, 2], "give a mapping"),
    ],
)
def test_wrong_ranges_are_refused(ranges, message):
    """Each mistake is an error that names it and says what to give."""
    with pytest.raises(ValueError, match=message):
        read_ranges(PAPER, ranges)


def test_randomization_needs_a_fleet_below_it():
    """On its own the transform says where it belongs."""
    with pytest.raises(RuntimeError, match="TransformedEnv of a FleetEnv"):
        RandomizeVehicle(PAPER, {})._reset_env_preprocess(None)


SPREAD = {"thruster_gain": {"gain": [0.5, 1.5]}}


def test_vehicles_go_by_a_declared_entry_that_no_step_carries():
    """What a reset takes is declared by name and shape, and neither a reset nor a rollout gives it back."""
    env = randomized(SPREAD)
    declared = {name: spec.shape for name, spec in fleet_of(env).reset_spec["vehicle"].items()}
    assert declared == {name: field.shape for name, field in fleet_of(env).vehicle.items()}
    flown = env.rollout(12, break_when_any_done=False)
    assert "vehicle" not in flown.keys(True) and "vehicle" not in env.reset()


def test_a_vehicle_entry_that_is_not_what_is_declared_is_refused():
    """A parameter that is missing, or has another shape, is named."""
    fleet = make_fleet("torch", PAPER, StationKeeping(), 2, seed=0)
    given = TensorDict({"vehicle": tensordict_of(PAPER.expand(2).clone())}, [2])
    fleet.reset(given, set_state=False)
    for wrong in (given.exclude(("vehicle", "gain")), given.clone().set(("vehicle", "gain"), torch.ones(2, 5))):
        with pytest.raises(ValueError, match="'vehicle': missing, unknown or misshapen are gain"):
            fleet.reset(wrong, set_state=False)


def test_vehicles_that_would_not_arrive_are_refused():
    """Around several fleets, or an environment that drops what it does not know, nothing would be randomized."""
    fleets = SerialEnv(2, lambda: make_fleet("torch", PAPER, StationKeeping(), 2, seed=0))
    kept_apart = TransformedEnv(randomized({}), StepCounter(), auto_unwrap=False)
    for below in (fleets, kept_apart):
        with pytest.raises(RuntimeError, match="takes no vehicles at a reset"):
            TransformedEnv(below, RandomizeVehicle(PAPER, SPREAD), auto_unwrap=False).reset()


def test_fleets_side_by_side_draw_as_they_would_alone():
    """A ``SerialEnv`` of randomized fleets: each draws from its own seed."""
    make = [partial(randomized, SPREAD, 3, seed) for seed in (1, 2)]
    env = SerialEnv(2, make)
    env.reset()
    for found, alone in zip(env._envs, make, strict=True):
        expected = alone()
        expected.reset()
        assert torch.equal(fleet_of(found).vehicle.gain, fleet_of(expected).vehicle.gain)
