"""Each baseline does what it is known for, and fails where it is known to fail."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import yaml
from torchrl.envs import TransformedEnv
from torchrl.envs.utils import check_env_specs

from auv_torchrl.agents.pid import PID
from auv_torchrl.authority import controlled_allocation
from auv_torchrl.baselines import FixedSigns, RecursiveLeastSquares, TrueMap, pulse_test, weigh_particles
from auv_torchrl.envs import TorchFleet
from auv_torchrl.evaluation import draw_starts, fly
from auv_torchrl.paths import config_path
from auv_torchrl.scenario import read_scenario
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle

VEHICLE = load_vehicle("paper")
TASK = replace(StationKeeping().for_evaluation(1.0), thruster_commands=True)


def scenario(name):
    return read_scenario(name, yaml.safe_load(config_path("scenario", name).read_text()), VEHICLE)


def fleet(name, count, task=TASK):
    return TorchFleet(VEHICLE, task, count, scenario=scenario(name), seed=0)


def late_error(transform, name, count=4):
    env = TransformedEnv(fleet(name, count), transform)
    flight = fly(env, PID(TASK), draw_starts(TASK, count, seed=1), TASK.steps - 1)
    return float(flight.position_error[:, 200:].mean())


def test_pulses_find_exactly_the_reversed_thrusters():
    """The signs of two reversed thrusters are found, and nothing is said of a dead one."""
    assert pulse_test(fleet("two_reversed", 1), VEHICLE).signs.tolist() == [-1, -1, 1, 1, 1, 1]
    assert pulse_test(fleet("reversed_and_dead", 1), VEHICLE).signs.tolist() == [-1, 1, 1, 1, 1, 1]


def test_fixed_signs_recover_reversal_but_not_a_swap():
    """What a pulse test corrects flies as before; a swap keeps the vehicle from its target."""
    signs = pulse_test(fleet("all_reversed", 1), VEHICLE).signs
    assert late_error(FixedSigns(VEHICLE, signs), "all_reversed") < 0.06
    assert late_error(FixedSigns(VEHICLE, pulse_test(fleet("swap", 1), VEHICLE).signs), "swap") > 0.06


@pytest.mark.parametrize(
    "name",
    ["swap", "triple_fault", *(pytest.param(name, marks=pytest.mark.thorough) for name in ("two_reversed", "cycle"))],
)
def test_the_true_map_recovers_whatever_the_thrusters_can(name):
    """Told the effectiveness, allocation flies the vehicle as if nothing had happened."""
    assert late_error(TrueMap(VEHICLE, scenario(name).vehicle_at(VEHICLE)), name) < 0.06


def test_recursive_least_squares_finds_the_effectiveness_when_all_thrusters_are_used():
    """With random commands the estimate comes to the true effectiveness of a swapped vehicle."""
    transform = RecursiveLeastSquares(VEHICLE, TASK, 2)
    env = fleet("swap", 2)
    tensordict = env.reset()
    generator = torch.Generator().manual_seed(0)
    for _ in range(60):
        tensordict["action"] = torch.rand(2, 6, generator=generator) * 2 - 1
        tensordict = env.step(tensordict)
        transform.learn(
            transform.actuation.delivered(tensordict["action"]).double().numpy(), tensordict, tensordict["next"]
        )
        tensordict = env.step_mdp(tensordict)
    truth = controlled_allocation(scenario("swap").vehicle_at(VEHICLE))
    error = np.abs(transform.effectiveness - truth) / np.abs(controlled_allocation(VEHICLE)).sum(-1)[:, None]
    assert float(error.max()) < 0.02


def test_every_transform_keeps_the_contract_of_its_environment():
    """Specs hold with each baseline in place."""
    for transform in (
        FixedSigns(VEHICLE, torch.ones(6)),
        TrueMap(VEHICLE, VEHICLE),
        RecursiveLeastSquares(VEHICLE, TASK, 2),
    ):
        check_env_specs(TransformedEnv(fleet("swap", 2), transform))


def test_a_pulse_test_of_a_fleet_is_refused():
    """More than one vehicle, or channels instead of thruster commands, is an error that says what to give."""
    with pytest.raises(ValueError, match="one vehicle that takes thruster commands"):
        pulse_test(fleet("swap", 2), VEHICLE)
    with pytest.raises(ValueError, match="one vehicle that takes thruster commands"):
        pulse_test(fleet("swap", 1, StationKeeping()), VEHICLE)


def test_particles_gather_around_the_gains_of_the_vehicle():
    """Of particles with random gains those near the target's weigh most, and their ranges are narrower."""
    channels = StationKeeping().for_evaluation(1.0)
    target = TorchFleet(VEHICLE, channels, 2, scenario=scenario("thruster_gain"), seed=0, dtype=torch.float64)
    flight = fly(target, PID(channels), draw_starts(channels, 2, seed=1), 20)
    particles = weigh_particles(VEHICLE, {"thruster_gain": {"gain": [0.0, 2.0]}}, flight, 0.05, count=3000)
    assert float(particles.weights.sum()) == pytest.approx(1.0)
    assert 1.0 <= particles.effective_number < 300
    mean = particles.weights @ particles.values
    truth = torch.tensor([1.0, 1.6, 0.2, 1.0, 1.0, 1.0], dtype=torch.float64)
    assert float((mean - truth)[:4].abs().max()) < 0.4
    for low, high in particles.ranges()["thruster_gain"].values():
        assert 0.0 <= low <= high <= 2.0
