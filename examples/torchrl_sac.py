"""Soft actor-critic from TorchRL's own parts, top to bottom: a vehicle learns to hold its place.

python examples/torchrl_sac.py [TRANSITIONS] [VEHICLES]

The settings are those of ``agent=sac`` (conf/agent/sac.yaml says why), which writes out gradients and is faster.
"""

import sys

import torch
from tensordict.nn import NormalParamExtractor, TensorDictModule
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
from torchrl.envs import EnvBase, TransformedEnv
from torchrl.modules import MLP, ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import SACLoss, SoftUpdate, ValueEstimators

from auv_torchrl.envs import RandomizeVehicle, make_fleet
from auv_torchrl.evaluation import Metrics, draw_starts, fly
from auv_torchrl.paths import config_path
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.yaml_file import read_yaml

VEHICLE, TASK = load_vehicle("paper"), StationKeeping()
STEPS, UPDATES, BATCH = 8, 32, 128  # of the fleet between updates; how many then; transitions of each


def make_env(vehicles: int) -> EnvBase:
    """A fleet in MuJoCo whose vehicles have other parameters after each reset."""
    ranges = read_yaml(config_path("randomization", "paper"), "randomization")
    return TransformedEnv(make_fleet("mujoco", VEHICLE, TASK, vehicles, seed=0), RandomizeVehicle(VEHICLE, ranges))


def make_loss(env: EnvBase) -> SACLoss:
    """Actor, two critics and their targets."""
    observations, actions = env.observation_spec["observation"].shape[-1], env.action_spec.shape[-1]
    layers = {"num_cells": [64, 64], "activation_class": torch.nn.ReLU}
    network = torch.nn.Sequential(MLP(observations, 2 * actions, **layers), NormalParamExtractor())
    actor = ProbabilisticActor(
        TensorDictModule(network, ["observation"], ["loc", "scale"]), ["loc", "scale"], distribution_class=TanhNormal
    )
    critic = ValueOperator(MLP(observations + actions, 1, **layers), in_keys=["observation", "action"])
    loss = SACLoss(actor, critic, loss_function="l1", alpha_init=0.1, target_entropy=-float(actions))
    loss.make_value_estimator(ValueEstimators.TD0, gamma=0.9)
    return loss


def main(transitions: int = 51200, vehicles: int = 64) -> float:
    """Train; returns the mean distance in m to the target for t >= 10 s, from 50 starts."""
    torch.manual_seed(0)
    torch.set_num_threads(1)  # networks this small gain nothing from more
    env = make_env(vehicles)
    loss = make_loss(env)
    frames = STEPS * vehicles
    adam, target = torch.optim.Adam(loss.parameters(), lr=3e-3), SoftUpdate(loss, tau=0.03)
    schedule = torch.optim.lr_scheduler.LinearLR(adam, 1.0, 0.02, max(1, transitions // frames))
    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(transitions), batch_size=BATCH)
    collector = Collector(
        env, loss.actor_network, frames_per_batch=frames, total_frames=transitions, init_random_frames=2 * frames
    )
    for count, flown in enumerate(collector, 1):
        buffer.extend(flown.reshape(-1))
        for _ in range(UPDATES if count > 2 else 0):
            losses = loss(buffer.sample())
            (losses["loss_actor"] + losses["loss_qvalue"] + losses["loss_alpha"]).backward()
            adam.step()
            adam.zero_grad()
            target.step()
        schedule.step()
    collector.shutdown()
    exam = TASK.for_evaluation(box_m=1.0)
    fleet, starts = make_fleet("mujoco", VEHICLE, exam, 50), draw_starts(exam, 50, seed=1)
    return Metrics.of(fly(fleet, loss.actor_network, starts, exam.steps)).mean_m


if __name__ == "__main__":
    print(f"mean distance to the target: {main(*map(int, sys.argv[1:])):.4f} m")
