"""Flights of a fleet, for tests."""

from typing import Any

import torch
from tensordict import TensorDict

from auv_torchrl.envs.start import BODY


def fly(fleet, actions, start=None) -> Any:
    """All reports of a flight, stacked over time, from given starts or drawn ones."""
    now = (
        fleet.reset() if start is None else fleet.reset(TensorDict({"start": start}, fleet.batch_size), set_state=True)
    )
    reports = [now]
    for action in actions:
        now = fleet.step(TensorDict({"action": action}, fleet.batch_size))["next"]
        reports.append(now)
    return TensorDict.stack([report.select("observation", *BODY, "thrust", "command", "time") for report in reports])


def held_actions(count, steps, seed=0, hold=10):
    torch.manual_seed(seed)
    return (2 * torch.rand(-(-steps // hold), count, 4) - 1).repeat_interleave(hold, 0)[:steps]


def resting(count, *positions, ahead=0.0):
    """A start heading north, at rest or at a speed ahead in m/s."""
    position = torch.tensor(positions or [[0.0, 0.0, 0.0]]).expand(count, 3)
    quaternion = torch.tensor([1.0, 0.0, 0.0, 0.0]).expand(count, 4)
    velocity = torch.tensor([ahead, 0.0, 0.0, 0.0, 0.0, 0.0]).expand(count, 6)
    return TensorDict({"position": position, "quaternion": quaternion, "velocity": velocity}, [count])
