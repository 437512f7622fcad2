"""Regulators, L1 augmentation, a history-conditioned policy and retraining: each does what its paper says."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import torch
import yaml
from scipy.linalg import solve_discrete_are
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torchrl.envs import Compose, TransformedEnv
from torchrl.envs.utils import check_env_specs

from auv_torchrl.adaptation.motion import SourceMotion
from auv_torchrl.agents.config import SACConfig, load_agent_config
from auv_torchrl.agents.networks import make_policy
from auv_torchrl.agents.pid import PID
from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.baselines import (
    LQR,
    AdaptiveLQR,
    EncoderConfig,
    L1Augmentation,
    retrain,
    train_encoder,
    train_informed,
)
from auv_torchrl.baselines.lqr import TOLERATED, TOLERATED_SPEED, gain_of
from auv_torchrl.envs import RandomizeVehicle, TorchFleet
from auv_torchrl.evaluation import draw_starts, fly
from auv_torchrl.paths import config_path
from auv_torchrl.scenario import read_scenario
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle
from tests.agents.tiny_training import tiny_config

VEHICLE = load_vehicle("paper")
CHANNELS = StationKeeping().for_evaluation(1.0)
TASK = replace(CHANNELS, thruster_commands=True)
EFFECTS = {None: {"effects": {}}, "heavy": {"effects": {"buoyancy": {"force": 20.0}}}}
GAINS = {"thruster_gain": {"gain": [0.5, 1.5]}}


def fleet(name, count, task=TASK):
    config = EFFECTS.get(name) or yaml.safe_load(config_path("scenario", name).read_text())
    return TorchFleet(VEHICLE, task, count, scenario=read_scenario(name or "nominal", config, VEHICLE), seed=0)


def late_error(policy, name, transform=None, count=2):
    task = CHANNELS if transform is None else TASK
    env = fleet(name, count, task)
    env = env if transform is None else TransformedEnv(env, transform)
    flight = fly(env, policy, draw_starts(task, count, seed=1), 219)
    return float(flight.position_error[:, 160:].mean())


def test_the_gain_is_that_of_the_riccati_equation():
    """For two vehicles at once, the gain is that of scipy; for a vehicle without thrust there is none."""
    motion = SourceMotion(VEHICLE, 0.05)
    share = np.stack([motion.per_share, motion.per_share * (-1, 1, 1, 1, 0.5, 1), 0.0 * motion.per_share])
    found = gain_of(motion, share)
    still = np.zeros((1, 4))
    step = motion(still, still)
    onward = np.block([[np.eye(4), step.by_velocity[0, :4]], [np.zeros((4, 4)), step.by_velocity[0, 4:]]])
    cost = np.diag(1.0 / np.square((*TOLERATED, *TOLERATED_SPEED)))
    for gain, by_command in zip(found[:2], share[:2], strict=True):
        by = step.by_wrench[0] @ by_command
        value = solve_discrete_are(onward, by, cost, np.eye(6))
        np.testing.assert_allclose(
            gain, np.linalg.solve(np.eye(6) + by.T @ value @ by, by.T @ value @ onward), 1e-6, 1e-9
        )
    assert np.isnan(found[2]).all()


def test_a_regulator_holds_the_source_vehicle_and_an_adaptive_one_a_changed_one():
    """Both hold centimetres where they know the vehicle; with a reversed thruster only the adaptive one does."""
    regulator = LQR(VEHICLE, CHANNELS)
    assert late_error(regulator, None) < 0.02
    assert late_error(regulator, "reversed") > 0.1
    assert late_error(regulator, "reversed", AdaptiveLQR(VEHICLE, TASK, 2)) < 0.03


def test_l1_opposes_a_force_and_cannot_turn_a_sign():
    """With 20 N of weight less than two thirds of the error are left; a reversed thruster is made no better."""
    pilot = PID(TASK)
    assert late_error(pilot, "heavy", L1Augmentation(VEHICLE, TASK, 2)) < 0.67 * late_error(pilot, "heavy")
    assert late_error(pilot, "reversed", L1Augmentation(VEHICLE, TASK, 2)) > 0.05


def test_their_transforms_keep_the_contract_of_the_environment():
    """Specs hold, and what is not a number does not get in."""
    for transform in (AdaptiveLQR(VEHICLE, TASK, 2), L1Augmentation(VEHICLE, TASK, 2)):
        check_env_specs(TransformedEnv(fleet("swap", 2), transform))
    augmentation = L1Augmentation(VEHICLE, TASK, 2)
    lost = TensorDict({"measured": {"position": torch.zeros(2, 3), "quaternion": torch.eye(4)[:2],
                                    "velocity": torch.full((2, 6), torch.nan)}}, [2])  # fmt: skip
    augmentation.learn(np.ones((2, 6)), lost, lost)
    assert (augmentation.missing == 0).all()


def test_draws_are_told_where_that_is_asked_for():
    """The entry has where each gain lies in its range, for the vehicles that fly, and is declared."""
    env = TransformedEnv(fleet(None, 3), RandomizeVehicle(VEHICLE, GAINS, seed=1, entry="told"))
    check_env_specs(env)
    env.set_seed(0)
    flown = env.rollout(5)
    gains = cast(Any, env).base_env.vehicle.gain
    torch.testing.assert_close((gains - 1.0).float() / 0.5, flown["next", "told"][:, -1], atol=1e-6, rtol=0)


class Shaken(torch.nn.Module):
    """A policy that commands anything."""

    def forward(self, observation):  # noqa: D102
        return 2 * torch.rand(*observation.shape[:-1], 6) - 1


def test_an_encoder_infers_what_the_policy_was_told():
    """From half a second of lively commands it tells a weak thruster from a strong one, of vehicles it has not seen."""
    one = {"thruster_gain": {"gain_5": [0.0, 2.0]}}
    task = StationKeeping(episode_s=5.0, thruster_commands=True)
    pilot = TensorDictModule(Shaken(), in_keys=["observation"], out_keys=["action"])
    policy = SourcePolicy(pilot, {"network": {"observations": len(task.observation_names) + 1}})
    few = EncoderConfig(rounds=1, vehicles=1024, steps=20, updates=400, batch_size=512)
    made = train_encoder(policy, VEHICLE, task, one, "torch", few)
    parts = [RandomizeVehicle(VEHICLE, one, seed=9, entry="told"), *made.parts()]
    env = TransformedEnv(TorchFleet(VEHICLE, task, 512, seed=3), Compose(parts))  # of 64, chance may make it 0.1 less
    check_env_specs(env)
    after = env.rollout(20, pilot, break_when_any_done=False)["next"][:, -1]
    told, inferred = after["told"].flatten(), after["inferred"].flatten()
    assert float(torch.corrcoef(torch.stack((told, inferred)))[0, 1]) > 0.7


def test_a_policy_is_told_in_its_training(tmp_path):
    """Its network has an input for each number that is drawn, and the same training is not done twice."""
    task = StationKeeping(episode_s=1.0, thruster_commands=True)
    given = (VEHICLE, task, tiny_config(), GAINS, 0, "torch", tmp_path)
    policy = train_informed(*given)
    assert policy.metadata["network"]["observations"] == len(task.observation_names) + 6
    assert train_informed(*given).metadata["hash"] == policy.metadata["hash"]


def test_retraining_flies_the_target_for_what_it_says_and_no_longer():
    """Four vehicles share the seconds; the policy has moved, and u_s itself has not."""
    agent = load_agent_config("sac", {"hidden": [8, 8]})
    assert isinstance(agent, SACConfig)
    module = make_policy(len(CHANNELS.observation_names), 4, [8, 8])
    before = [weight.clone() for weight in module.parameters()]
    target, steps = fleet("swap", 4, replace(CHANNELS, episode_s=15.0)), []
    step = target._step
    target._step = lambda tensordict: steps.append(1) or step(tensordict)
    found = retrain(SourcePolicy(module, {"curve": [{"alpha": 0.01}]}), target, 4.0, agent)
    assert (len(steps), found.target_data_s) == (20, 4.0)
    after = list(cast(Any, found.policy).parameters())
    assert all(torch.equal(a, b) for a, b in zip(before, module.parameters(), strict=True))
    assert any(not torch.equal(a, b) for a, b in zip(before, after, strict=True))


def test_histories_begin_anew_with_the_episode():
    """What a vehicle did before its reset is forgotten, and what the others did is kept."""
    from auv_torchrl.baselines.history import Infer

    count = 3
    infer = Infer(torch.nn.Flatten(), (len(TASK.observation_names), 6), 3)
    env = TransformedEnv(fleet(None, count), infer)
    now = env.rollout(5)[:, -1]["next"]
    assert now["history"].abs().sum((1, 2)).min() > 0
    mask = torch.zeros(count, 1, dtype=torch.bool)
    mask[0] = True
    again = env.reset(now.set("_reset", mask), set_state=False)["history"].abs().sum((1, 2))
    assert again[0] == 0 and (again[1:] > 0).all()
