"""What the adaptation costs: CPU time per control step."""

import time
from dataclasses import replace

import numpy as np
import torch

from auv_torchrl.adaptation.adapter import InFlightAdapter
from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.adaptation.learner import PHASES, Phase
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import Vehicle


def cost_per_step(vehicle: Vehicle, config: AdaptationConfig, steps: int = 400) -> tuple[float, float]:
    """CPU milliseconds of the adapter for one vehicle: median while following, and while searching.

    Args:
        vehicle: the source (empty batch).
        config: of the adapter.
        steps: control steps that are timed, half of them after a change has been noticed.
    """
    task = replace(StationKeeping(), thruster_commands=True)
    adapter = InFlightAdapter(vehicle, task, config, 1)
    measured = np.eye(1, 13, 3)  # at the origin, level, heading north
    learner = adapter.learner
    spent: dict[Phase, list[float]] = {phase: [] for phase in PHASES}
    learner.begin(np.arange(1), measured)
    generator = torch.Generator().manual_seed(0)
    for k in range(steps):
        if k == steps // 2:
            learner.search(np.arange(1))
        action = 0.2 * (torch.rand(1, 4, generator=generator) * 2 - 1)
        phase = PHASES[learner.phase[0]]
        began = time.process_time()
        command = adapter.translate(action)
        learner.observe(adapter.delivered(command.double().numpy()), measured + 1e-4 * k, np.full(1, 0.05 * (k + 1)))
        spent[phase].append(1e3 * (time.process_time() - began))
    return float(np.median(spent[Phase.FOLLOWING])), float(np.median(spent[Phase.SEARCHING]))
