"""How a vehicle came through a fault in flight: when it was noticed, how far it went off, when it was back."""

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.thrusters import thrust_target
from auv_torchrl.vehicle import Vehicle

BACK_M = 0.05  # a vehicle has recovered once it stays closer than this to the target
FELT_N = 1.0  # a fault is felt once a thruster gives this much more or less than it would when healthy
SETTLED_S = 10.0  # after the fault; the error is averaged from then on


@dataclass(frozen=True)
class Recovery:
    """Of N flights with a fault each, (N,)."""

    time_s: Tensor  # from the fault until the vehicle is closer than 5 cm for good; infinite if never
    largest_m: Tensor  # largest error after the fault
    steady_m: Tensor  # mean error from 10 s after the fault on
    felt_s: Tensor  # from the fault until it first changes a thrust; infinite if it never does
    delay_s: Tensor  # from then until the first alarm; infinite if there is none
    alarms: Tensor  # number of alarms from the fault on
    alarms_before: Tensor  # number of alarms before it


def recoveries(rollout: Any, fault_s: Tensor, nominal: Vehicle) -> Recovery:
    """Judge a rollout (N, T) of an adapted fleet whose vehicles each meet a fault at ``fault_s`` (N,).

    Args:
        rollout: with the true ``position``, ``thrust`` and ``command`` and the adapter's ``alarm`` under ``next``.
        fault_s: s since the start of the rollout.
        nominal: the healthy vehicle (empty batch).

    Raises:
        ValueError: if a flight ends less than 10 s after its fault.
    """
    after = rollout["next"]
    time = after["time"][..., 0].double()
    began = fault_s.double()[:, None]
    if float(time[:, -1].min() - fault_s.max()) < SETTLED_S:
        raise ValueError(f"recovery: a flight ends within {SETTLED_S:g} s of its fault: fly longer or break it earlier")
    since = time - began
    faulty = since > 0
    error = after["position"].double().norm(dim=-1)
    outside = faulty & (error >= BACK_M)
    last = torch.where(outside, since, 0.0).amax(1)
    never = outside[:, -1]
    c = prepare(nominal.double())
    healthy = thrust_target(c, ActiveTerms.of(c), after["command"].double())
    felt = _first((after["thrust"].double() - healthy).abs().amax(-1) > FELT_N, faulty, since)
    alarm = after["alarm"][..., 0]
    noticed = _first(alarm, faulty, since)
    late = since >= SETTLED_S
    return Recovery(
        time_s=torch.where(never, torch.inf, last),
        largest_m=torch.where(faulty, error, 0.0).amax(1),
        steady_m=torch.where(late, error, 0.0).sum(1) / late.sum(1),
        felt_s=felt,
        delay_s=torch.where(noticed.isfinite(), (noticed - felt).clamp_min(0.0), torch.inf),
        alarms=(alarm & faulty).sum(1),
        alarms_before=(alarm & ~faulty).sum(1),
    )


def _first(event: Tensor, faulty: Tensor, since: Tensor) -> Tensor:
    """Time of the first event after the fault, (N,); infinite if there is none."""
    return torch.where(event & faulty, since, torch.inf).amin(1)
