"""Adaptive domain randomization by particle weights: what section 4.1 of Lu et al. 2023 calls prior work.

Vehicles are drawn from the ranges of the randomization, each is weighted by how likely the target's transitions are
under it, and the source policy is trained again on vehicles around the likely ones.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from auv_torchrl.effects import get_effect
from auv_torchrl.envs.randomize import read_ranges
from auv_torchrl.flight import Flight
from auv_torchrl.physics import ActiveTerms, State, control_step, prepare
from auv_torchrl.vehicle import CONTROLLED_INDEX, Vehicle
from auv_torchrl.vehicle.tensors import tensors

SPEED_NOISE = 0.02  # m/s and rad/s, standard deviation of what a particle's prediction of one step may miss
WIDTH = 2.0  # standard deviations of the weighted particles, to each side


@dataclass(frozen=True)
class Particles:
    """Values of every randomized parameter, and how much each set of values is believed."""

    names: tuple[tuple[str, str], ...]  # (effect, parameter) of each column
    values: Tensor  # (P, k)
    limits: Tensor  # (k, 2) of the prior
    weights: Tensor  # (P,), sum 1

    @property
    def effective_number(self) -> float:
        """1 / sum of squared weights: P if the data says nothing, 1 if only one particle is left."""
        return float(1.0 / self.weights.square().sum())

    def ranges(self) -> dict[str, dict[str, list[float]]]:
        """Ranges around the weighted particles, as ``conf/randomization`` has them, for training again."""
        mean = self.weights @ self.values
        deviation = (self.weights @ (self.values - mean).square()).sqrt()
        low = torch.maximum(mean - WIDTH * deviation, self.limits[:, 0]).tolist()
        high = torch.minimum(mean + WIDTH * deviation, self.limits[:, 1]).tolist()
        ranges: dict[str, dict[str, list[float]]] = {}
        for (effect, parameter), *bounds in zip(self.names, low, high, strict=True):
            ranges.setdefault(effect, {})[parameter] = bounds
        return ranges


def weigh_particles(
    nominal: Vehicle, ranges: Mapping[str, Any], flight: Flight, control_dt: float, count: int = 2000, seed: int = 0
) -> Particles:
    """Draw particles and weigh them by the transitions of flights of the target.

    Args:
        nominal: one vehicle (empty batch).
        ranges: ``{effect: {parameter or family: [low, high]}}``.
        flight: K flights of the target, batch (K, T + 1), with the commands that were sent.
        control_dt: s between its samples.
        count: number of particles P.
        seed: of the draws.

    Raises:
        ValueError: for ranges that cannot be read.
    """
    drawn = read_ranges(nominal, ranges)
    names = tuple((effect.name, name) for effect, parameters in drawn for name in parameters)
    limits = torch.tensor([pair for _, parameters in drawn for pair in parameters.values()], dtype=torch.float64)
    draws = torch.rand(count, len(names), generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    values = limits[:, 0] + (limits[:, 1] - limits[:, 0]) * draws
    vehicle = tensors(nominal).expand(count)
    for effect in dict.fromkeys(effect for effect, _ in names):
        given = {name: values[:, i] for i, (of, name) in enumerate(names) if of == effect}
        vehicle = get_effect(effect).apply(vehicle, given)
    logarithm = torch.stack([_log_likelihood(vehicle, one, control_dt) for one in flight]).sum(0)
    return Particles(names, values, limits, torch.softmax(logarithm, dim=0))


def _log_likelihood(vehicle: Vehicle, flight: Flight, control_dt: float) -> Tensor:
    """Of the controlled velocities after every step of a flight (T + 1), each from the state before it, (P,)."""
    coefficients = prepare(vehicle)
    terms = ActiveTerms.of(coefficients)
    controlled, count = list(CONTROLLED_INDEX), vehicle.batch_size[0]
    total = torch.zeros(count, dtype=torch.float64)
    fields = (flight.position, flight.quaternion, flight.velocity, flight.command, flight.time)
    position, quaternion, velocity, command, time = (field.double() for field in fields)
    thrust = torch.zeros(count, vehicle.thrusters, dtype=torch.float64)
    memory = thrust[:, None]
    for k in range(len(time) - 1):
        p, q, v = (known[k].expand(count, -1) for known in (position, quaternion, velocity))
        state = State(p, q, v, thrust, memory, time[k].expand(count))
        after = control_step(coefficients, terms, state, command[k + 1].expand(count, -1), control_dt)
        thrust, memory = after.thrust, after.commands
        missed = (velocity[k + 1] - after.velocity)[:, controlled] / SPEED_NOISE
        total -= 0.5 * missed.square().sum(-1)
    return total
