"""A flight with the adaptation in it: what the vehicles did, what the adapter made of it, and what it costs."""

import time
from dataclasses import replace
from typing import cast

import numpy as np
import torch
from tensordict import TensorClass, TensorDict
from torch import Tensor
from torchrl.envs import EnvBase

from auv_torchrl.adaptation.adapter import ALARM, MAP, PHASE, STATISTIC, InFlightAdapter
from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.adaptation.learner import PHASES, Phase
from auv_torchrl.array_api import Array
from auv_torchrl.evaluation import Policy, flight_of, roll_out, task_of
from auv_torchrl.flight import Flight
from auv_torchrl.tasks import StationKeeping, Task, cruise_speed
from auv_torchrl.vehicle import Vehicle


class AdaptedFlight(TensorClass):
    """N flights, batch (N, T + 1): the start and the state after each of T control steps."""

    flight: Flight
    alarm: Tensor  # () bool, whether a change was noticed in the step that ends here
    phase: Tensor  # () index of auv_torchrl.adaptation.PHASES
    statistic: Tensor  # () the detector's sum as a share of its threshold
    effectiveness: Tensor  # (a, n) estimated wrench in N and N m per share of full thrust

    def of_start(self, start: int) -> "AdaptedFlight":
        """The flight of one start, batch (T + 1)."""
        return cast(AdaptedFlight, self[start])


def fly_adapting(fleet: EnvBase, policy: Policy, starts: TensorDict, steps: int) -> AdaptedFlight:
    """Fly one vehicle per start with an :class:`~auv_torchrl.adaptation.InFlightAdapter` as the outermost transform.

    Args:
        fleet: N vehicles that take thruster commands, with the adapter.
        policy: reads ``observation``, writes ``action``.
        starts: N starts from :func:`auv_torchrl.evaluation.draw_starts`.
        steps: control steps; the episode must not be shorter.

    Returns:
        The flights, on the CPU.
    """
    rollout = roll_out(fleet, policy, starts, steps)

    def reported(name: str) -> Tensor:
        return torch.cat((rollout[name][:, :1], rollout["next", name]), dim=1)

    flight = flight_of(rollout, task_of(fleet))
    return AdaptedFlight(
        flight=flight,
        alarm=reported(ALARM)[..., 0],
        phase=reported(PHASE)[..., 0],
        statistic=reported(STATISTIC)[..., 0],
        effectiveness=reported(MAP),
        batch_size=flight.batch_size,
    )


def gains(effectiveness: Tensor, nominal: Array) -> Tensor:
    """What each thruster does of what it should do, (..., n): 1 healthy, 0 dead, -1 reversed.

    The effect of a thruster (a column of the effectiveness) is projected onto its nominal effect, with forces and
    moments in units of what all thrusters together can give.

    Args:
        effectiveness: (..., a, n) wrench per share of full thrust.
        nominal: (a, n) that of the healthy vehicle.
    """
    nominal = torch.as_tensor(nominal, dtype=effectiveness.dtype, device=effectiveness.device)
    weight = 1.0 / nominal.abs().sum(-1, keepdim=True) ** 2
    return (weight * nominal * effectiveness).sum(-2) / (weight * nominal**2).sum(-2)


def cost_per_step(
    vehicle: Vehicle, config: AdaptationConfig, steps: int = 400, task: Task | None = None
) -> tuple[float, float]:
    """CPU milliseconds of the adapter for one vehicle: median while following, and while searching.

    Args:
        vehicle: the source (empty batch).
        config: of the adapter.
        steps: control steps that are timed, half of them after a change has been noticed.
        task: that is flown; holding a place without.
    """
    task = replace(task or StationKeeping(), thruster_commands=True)
    adapter = InFlightAdapter(vehicle, task, config, 1)
    measured = np.eye(1, 13, 3)  # at the origin, level, heading north
    measured[0, 7] = cruise_speed(task)
    learner = adapter.learner
    spent: dict[Phase, list[float]] = {phase: [] for phase in PHASES}
    learner.begin(np.arange(1), measured)
    generator = torch.Generator().manual_seed(0)
    for k in range(steps):
        if k == steps // 2:
            learner.search(np.arange(1))
        action = 0.2 * (torch.rand(1, adapter.channels, generator=generator) * 2 - 1)
        phase = PHASES[learner.phase[0]]
        began = time.process_time()
        command = adapter.translate(action)
        learner.observe(adapter.delivered(command.double().numpy()), measured + 1e-4 * k, np.full(1, 0.05 * (k + 1)))
        spent[phase].append(1e3 * (time.process_time() - began))
    return float(np.median(spent[Phase.FOLLOWING])), float(np.median(spent[Phase.SEARCHING]))
