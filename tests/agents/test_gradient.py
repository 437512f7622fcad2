"""The policy gradient through the simulator."""

import math

import pytest
import torch
from tiny_training import RANDOMIZATION, TASK, train_tiny

from auv_torchrl.agents.config import GradientConfig, load_agent_config
from auv_torchrl.agents.learning.gradient import GradientLearner
from auv_torchrl.agents.policy import load_policy
from auv_torchrl.agents.train_source import make_trainer
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.thrusters import straight_through_targets, thrust_targets
from auv_torchrl.tasks import TASKS, StationKeeping
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.vehicle.tensors import tensors


@pytest.mark.parametrize("delay", [0.0, 0.07])
def test_gradients_pass_limits_and_dead_bands_and_thrusts_do_not(delay):
    """Thrusts are those of the physics; their slopes are those of a thruster without limit and dead band."""
    vehicle = tensors(load_vehicle("paper")).expand(1).clone()
    vehicle.limit[:], vehicle.dead_band[:], vehicle.delay[:] = 0.5 * vehicle.full_thrust, 5.0, delay
    c = prepare(vehicle)
    commands = torch.tensor([0.9, 0.01, -0.3, -1.0, 0.0, 0.2]).double().expand(1, 3, 6).clone().requires_grad_()
    given = (c, ActiveTerms.of(c), commands, 0.05, 4)
    found, truth = straight_through_targets(*given), thrust_targets(*given)
    for ours, theirs in zip(found, truth, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-12, atol=1e-12)
        (slope,) = torch.autograd.grad(ours.sum(), commands, retain_graph=True)
        torch.testing.assert_close(slope.sum(1), c.full_thrust)
    (slope,) = torch.autograd.grad(truth[0].sum(), commands)
    assert (slope.sum(1)[0] == 0).tolist() == [True, True, False, True, True, False]


def test_a_policy_is_learnt_from_a_few_hundred_control_steps(tmp_path):
    """20 updates, each from 16 steps of 64 vehicles, and MuJoCo confirms a mean error below 0.05 m."""
    config = load_agent_config(
        "gradient",
        {
            "stretch_steps": 320,
            "total_frames": 20480,
            "evaluation_starts": 8,
            "learning_rate": 0.01,
        },
    )
    trainer = make_trainer(load_vehicle("paper"), StationKeeping(box_m=1.0), config, None, 0, "mujoco", tmp_path, "x")
    trainer.run()
    assert trainer.curve[-1]["frames"] == 20480
    assert trainer.curve[-1]["best_m"] < 0.05


def settings_of(**changes) -> GradientConfig:
    config = load_agent_config("gradient", changes)
    assert isinstance(config, GradientConfig)
    return config


@pytest.mark.parametrize("task", TASKS.values(), ids=TASKS)
def test_gradients_flow_through_every_task(task):
    """From one horizon to the next, with vehicles that begin anew between, and into the policy."""
    settings = {"num_envs": 4, "steps_per_batch": 4, "stretch_steps": 12, "restart": 0.3}
    config = settings_of(**settings)
    torch.manual_seed(0)
    fleet = config.make_fleet("mujoco", load_vehicle("paper"), task(), 0, "cpu")
    sizes = fleet.observation_spec["observation"].shape[-1], fleet.action_spec.shape[-1]
    learner = GradientLearner(*sizes, config, torch.device("cpu"))
    learnt = [each.losses for each in learner.learn(fleet, 0, 0)]
    assert len(learnt) == 3
    assert all(losses and losses["loss_actor"].isfinite() and losses["gradient_norm"] > 0 for losses in learnt)


def test_only_what_belongs_to_an_episode_counts():
    """Rewards after the end of an episode, which lasts half a horizon here, do not move the policy."""
    config = settings_of(num_envs=3, steps_per_batch=40, stretch_steps=40, restart=0.0)
    fleet = config.make_fleet("mujoco", load_vehicle("paper"), TASK, 0, "cpu")
    learner = GradientLearner(16, 4, config, torch.device("cpu"))
    state, _, flown = learner._fly(fleet, fleet.reset())
    assert flown[:20].all() and not flown[20:].any()
    assert state["done"].all()
    assert (learner._begin(fleet, state)["time"] == 0).all()


@pytest.mark.parametrize("steep", [1e25, float("inf")])
def test_a_gradient_that_is_too_long_for_a_number_moves_nothing(steep):
    """As of a vehicle that tumbles; the next horizon is climbed as if that one had not been flown."""
    config = settings_of()
    learner = GradientLearner(16, 4, config, torch.device("cpu"))
    before = [weight.detach().clone() for weight in learner._weights]
    total = torch.stack([weight.sum() for weight in learner._weights])
    losses = learner._climb(steep * total.sum(), 0)
    assert all(torch.equal(weight, old) for weight, old in zip(learner._weights, before, strict=True))
    assert math.isfinite(losses["gradient_norm"])
    learner._climb(torch.stack([weight.sum() for weight in learner._weights]).sum(), 0)
    assert all((weight > old).all() for weight, old in zip(learner._weights, before, strict=True))


@pytest.mark.parametrize(("given", "diverged"), [([1e25, 1e25, 1e25], True), ([1e25, 1.0, 1e25], False)])
def test_a_stretch_without_any_gradient_has_diverged(given, diverged, monkeypatch):
    """One gradient among those that are too long is enough to go on."""
    config = settings_of(num_envs=3, steps_per_batch=5, stretch_steps=15)
    fleet = config.make_fleet("mujoco", load_vehicle("paper"), TASK, 0, "cpu")
    learner, steep = GradientLearner(16, 4, config, torch.device("cpu")), iter(given)

    def fly(fleet, state):
        total = torch.stack([weight.sum() for weight in learner._weights]).sum()
        return state, next(steep) * total[None], torch.ones(1)

    monkeypatch.setattr(learner, "_fly", fly)
    *_, last = learner.learn(fleet, 0, 0)
    assert last.losses is not None and math.isfinite(last.losses["gradient_norm"]) is not diverged


def test_the_past_is_cut_off_and_the_flight_goes_on():
    """A horizon begins where the last one ended, with no gradient into it."""
    config = settings_of(num_envs=3, steps_per_batch=5, stretch_steps=5, restart=0.0)
    fleet = config.make_fleet("mujoco", load_vehicle("paper"), TASK, 0, "cpu")
    learner = GradientLearner(16, 4, config, torch.device("cpu"))
    state, _, _ = learner._fly(fleet, fleet.reset())
    assert state["position"].requires_grad
    begun = learner._begin(fleet, state)
    assert not begun["position"].requires_grad and not fleet.simulator.state.position.requires_grad
    assert torch.equal(begun["position"], state["position"])


def test_delays_and_currents_are_drawn_beside_a_randomization():
    """Unless the randomization names them itself, or there is none."""
    config = settings_of(delay_s=0.2, current=0.3)
    assert config.ranges({}) == {}
    drawn = config.ranges({**RANDOMIZATION, "pose_delay": {"delay": [0.0, 0.4]}})
    assert drawn == {
        **RANDOMIZATION,
        "pose_delay": {"delay": [0.0, 0.4]},
        "command_delay": {"delay": [0.0, 0.2]},
        "current": {"north": [-0.3, 0.3], "east": [-0.3, 0.3]},
    }


def test_its_policy_is_kept_as_any_other(tmp_path):
    """Same files, same network; a second training is none."""
    policy = train_tiny(tmp_path, agent="gradient")
    assert policy.metadata["ingredients"]["agent"]["name"] == "gradient"
    again = load_policy(tmp_path / policy.metadata["hash"])
    observation = torch.ones(2, 16)
    assert torch.equal(again.module.module(observation), policy.module.module(observation))
    assert train_tiny(tmp_path, agent="gradient").metadata["curve"] == policy.metadata["curve"]
