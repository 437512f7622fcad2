"""Soft actor-critic in one file, as CleanRL writes it: python examples/cleanrl_sac.py [TRANSITIONS] [VEHICLES]."""

import sys
from copy import deepcopy

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import flatdim
from torch import Tensor, nn
from torch.distributions import Normal, TanhTransform, TransformedDistribution

from auv_torchrl.envs import ID

GAMMA, TAU, RATE = 0.9, 0.03, 3e-3  # conf/agent/sac.yaml says why the discount is so low
BATCH, UPDATES, RANDOM = 128, 4, 1024  # transitions of an update; updates of a step; transitions with random actions


def network(inputs: int, outputs: int) -> nn.Sequential:
    """A perceptron."""
    return nn.Sequential(nn.Linear(inputs, 64), nn.ReLU(), nn.Linear(64, 64), nn.ReLU(), nn.Linear(64, outputs))


def sample(actor: nn.Module, observation: Tensor) -> tuple[Tensor, Tensor]:
    """An action (N, a) of the tanh-normal policy and its log-probability (N, 1)."""
    mean, log_std = actor(observation).chunk(2, -1)
    squashed = TransformedDistribution(Normal(mean, log_std.clamp(-5, 2).exp()), TanhTransform(cache_size=1))
    action = squashed.rsample()
    return action, squashed.log_prob(action).sum(-1, keepdim=True)


def both(critics: nn.ModuleList, observation: Tensor, action: Tensor) -> Tensor:
    """What the critics say (2, N, 1)."""
    return torch.stack([critic(torch.cat((observation, action), -1)) for critic in critics])


def main(transitions: int = 51200, vehicles: int = 64) -> float:
    """Train; returns the mean distance in m to the target for t >= 10 s, from 50 starts."""
    torch.manual_seed(0)
    envs = gymnasium.make_vec(ID, num_envs=vehicles)
    inputs, outputs = (flatdim(space) for space in (envs.single_observation_space, envs.single_action_space))
    actor, critics = network(inputs, 2 * outputs), nn.ModuleList(network(inputs + outputs, 1) for _ in range(2))
    targets, log_alpha = deepcopy(critics), nn.Parameter(torch.tensor(-2.3))
    adam = torch.optim.Adam([*actor.parameters(), *critics.parameters(), log_alpha], RATE)
    memory, stored = torch.zeros(transitions + vehicles, 2 * inputs + outputs + 2), 0
    envs.action_space.seed(0)
    now, _ = envs.reset(seed=0)
    while stored < transitions:
        action = sample(actor, torch.from_numpy(now))[0].detach().numpy()
        action = action if stored >= RANDOM else envs.action_space.sample()
        following, reward, terminated, truncated, info = envs.step(action)
        reached = np.where((terminated | truncated)[:, None], info.get("final_obs", following), following)
        rows = np.concatenate((now, action, reward[:, None], terminated[:, None], reached), -1)
        memory[stored : stored + vehicles] = torch.from_numpy(rows)
        now, stored = following, stored + vehicles
        for _ in range(UPDATES if stored > RANDOM else 0):
            x, u, r, over, then = memory[torch.randint(stored, (BATCH,))].split([inputs, outputs, 1, 1, inputs], -1)
            with torch.no_grad():
                alpha, (action, log_prob) = log_alpha.exp(), sample(actor, then)
                wanted = r + GAMMA * (1 - over) * (both(targets, then, action).amin(0) - alpha * log_prob)
            critic_loss = (both(critics, x, u) - wanted).abs().mean((1, 2)).sum()
            action, log_prob = sample(actor, x)
            adam.zero_grad()
            (alpha * log_prob - both(critics, x, action).amin(0)).mean().backward()
            critics.zero_grad()  # this loss moves the actor alone
            (critic_loss - log_alpha * (log_prob.detach() - outputs).mean()).backward()
            adam.param_groups[0]["lr"] = RATE * (1 - 0.98 * stored / transitions)
            adam.step()
            for target, critic in zip(targets.parameters(), critics.parameters(), strict=True):
                target.data.lerp_(critic.data, TAU)
    exam, errors = gymnasium.make_vec(ID, num_envs=50, task={"box_m": 1.0}), []
    now, _ = exam.reset(seed=1)
    for _ in range(399):  # of the 400 control steps of an episode
        now, *_, info = exam.step(actor(torch.from_numpy(now)).chunk(2, -1)[0].tanh().detach().numpy())
        errors.append(np.linalg.norm(info["position"], axis=-1).mean())
    return float(np.mean(errors[200:]))


if __name__ == "__main__":
    print(f"mean distance to the target: {main(*map(int, sys.argv[1:])):.4f} m")
