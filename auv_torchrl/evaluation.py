"""Fly a policy from many starts and say how well it holds the target: Eq. 15 and 16 of Lu et al. 2023."""

import math
from collections.abc import Callable
from copy import deepcopy
from dataclasses import asdict, dataclass
from typing import Any, Self, cast

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

from auv_torchrl.flight import Flight
from auv_torchrl.tasks import Task

STEADY_FROM_S = 10.0  # Eq. 15 averages from here to the end of the episode
SETTLED_M = 0.05  # a start has settled once its position error stays below this
FLOOR_M = 0.002  # m; a difference of mean errors below it is no gap: the pose itself is not known better
FLOOR_RAD = 0.05  # rad, 3 degrees; likewise of mean heading errors: a compass tells no better

Policy = Callable[[TensorDictBase], TensorDictBase]


def draw_starts(task: Task, count: int, seed: int) -> TensorDict:
    """Starts of an evaluation, the same for the same seed whatever else was drawn.

    Args:
        task: says where episodes start, e.g. ``task.for_evaluation(box_m=1.0)``.
        count: number of starts.
        seed: of a generator that only this function uses.

    Returns:
        ``position`` (count, 3) m, ``quaternion`` (count, 4) and ``velocity`` (count, 6), for ``reset``'s ``"start"``.
    """
    if count < 1:
        raise ValueError(f"starts is {count}: give 1 or more")
    position, quaternion, velocity = task.draw_starts(count, torch.Generator().manual_seed(seed))
    return TensorDict({"position": position, "quaternion": quaternion, "velocity": velocity}, batch_size=[count])


def fly(fleet: EnvBase, policy: Policy, starts: TensorDict, steps: int) -> Flight:
    """Fly one vehicle per start for ``steps`` control steps, without exploration.

    A vehicle whose episode terminates early has diverged. Its samples from there on are NaN, which counts as an
    unbounded error: the fleet may start that row again, the metrics must not see it.

    Args:
        fleet: N vehicles, with the adapter as its outermost transform where there is one.
        policy: reads ``observation``, writes ``action``.
        starts: N starts from :func:`draw_starts`.
        steps: control steps; the episode must not be shorter.

    Raises:
        ValueError: if the fleet has another size than there are starts.
    """
    return flight_of(roll_out(fleet, policy, starts, steps), task_of(fleet))


def roll_out(fleet: EnvBase, policy: Policy, starts: TensorDict, steps: int) -> Any:
    """Everything that the fleet reports over ``steps`` control steps, batch (N, T), without exploration.

    The flight takes place on the fleet's device, to which a policy that lies elsewhere is copied; what comes back is on
    the CPU, where flights are looked at.

    Raises:
        ValueError: if the fleet has another size than there are starts.
    """
    if fleet.batch_size != starts.batch_size:
        raise ValueError(f"fly: the fleet has batch {tuple(fleet.batch_size)}, the starts {tuple(starts.batch_size)}")
    held = (*policy.parameters(), *policy.buffers()) if isinstance(policy, nn.Module) else ()
    if isinstance(policy, nn.Module) and any(tensor.device != fleet.device for tensor in held):
        policy = deepcopy(policy).to(fleet.device)
    first = fleet.reset(TensorDict({"start": starts}, batch_size=starts.batch_size), set_state=True)
    with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
        flown = fleet.rollout(
            steps, policy, auto_reset=False, break_when_any_done=False, tensordict=first, return_contiguous=True
        )
    return flown.cpu()


def task_of(fleet: EnvBase) -> Task:
    """The task of a fleet, whatever transforms are around it."""
    return cast(Any, fleet).task


def flight_of(rollout: Any, task: Task) -> Flight:
    """The flight in a rollout (N, T) of :func:`roll_out` of a task; NaN from where a vehicle diverged."""
    after = rollout["next"]
    terminated = after["terminated"].squeeze(-1)

    def with_start(start: Tensor, following: Tensor) -> Tensor:
        lost = terminated.cumsum(dim=1).bool()[:, :, None]
        return torch.cat((start[:, None], following.masked_fill(lost, math.nan)), dim=1)

    states = {name: with_start(rollout[name][:, 0], after[name]) for name in _STATE}
    action = rollout["action"]
    applied = after.get("applied_action", action)
    for name, value in {"action": action, "applied_action": applied}.items():
        states[name] = with_start(torch.zeros_like(value[:, 0]), value)
    control_dt = (after["time"] - rollout["time"])[0, 0]
    count, steps = rollout.shape
    time = control_dt * torch.arange(steps + 1, dtype=control_dt.dtype, device=control_dt.device)
    batch = torch.Size((count, steps + 1))
    states["time"] = time.expand(batch)
    along = torch.cat((rollout["along"][:, :1], after["along"]), dim=1)[..., 0]
    reference = task.reference(along)
    states["miss"] = task.miss(states["position"], states["quaternion"], states["velocity"], along)
    states["reference_position"] = reference.nearest(states["position"])
    states["reference_quaternion"] = reference.attitude(states["position"])
    return Flight.from_tensordict(TensorDict(states, batch_size=batch))  # from_dict would load pandas


_STATE = ("position", "quaternion", "velocity", "thrust", "command")


@dataclass(frozen=True)
class Metrics:
    """How well N starts ended: of each start the mean error for t >= 10 s, then over the starts."""

    mean_m: float
    std_m: float
    p95_m: float
    worst_m: float
    settling_s: float | None  # median over the starts; None where half of them never settle
    settled: float  # share of the starts that settle
    heading_rad: float  # mean over the starts of the mean absolute heading error for t >= 10 s
    attitude_rad: float  # likewise of the angle to the attitude of the reference, roll and pitch included
    miss_m: float  # likewise of what the task calls a miss: the position error, at speed depth, heading and speed

    def holds_as_well_as(self, other: "Metrics") -> bool:
        """Whether position and heading are held no worse than in ``other``, but for what is no gap."""
        return self.mean_m < other.mean_m + FLOOR_M and self.heading_rad < other.heading_rad + FLOOR_RAD

    def as_dict(self) -> dict[str, Any]:
        """For JSON; an infinite error (the vehicle's state was no number any more) becomes None."""
        return {
            key: None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in asdict(self).items()
        }

    @classmethod
    def of(cls, flight: Flight) -> Self:
        """Eq. 15 and 16, the 95th percentile, the worst start and the settling time.

        Raises:
            ValueError: if the flight ends before t = 10 s.
        """
        means = steady_errors(flight)
        settling = settling_times(flight)
        settled = settling.isfinite()
        median = float(settling.quantile(0.5, interpolation="higher"))
        steady = _steady(flight)
        return cls(
            mean_m=float(means.mean()),
            std_m=float(means.std(correction=0)) if means.isfinite().all() else math.inf,
            p95_m=float(means.quantile(0.95, interpolation="higher")),
            worst_m=float(means.max()),
            settling_s=median if math.isfinite(median) else None,
            settled=float(settled.double().mean()),
            heading_rad=float(flight.heading_error[:, steady].mean()),
            attitude_rad=float(flight.attitude_error[:, steady].mean()),
            miss_m=float(flight.miss.nan_to_num(nan=math.inf)[:, steady].double().mean()),
        )


def _steady(flight: Flight) -> Tensor:
    steady = flight.time[0] >= STEADY_FROM_S - 1e-6
    if not steady.any():
        raise ValueError(
            f"evaluation: the flight ends at {float(flight.time[0, -1]):g} s, "
            f"the error is averaged from {STEADY_FROM_S:g} s: fly longer episodes"
        )
    return steady


def steady_errors(flight: Flight) -> Tensor:
    """Mean position error of each start for t >= 10 s in m, (N,): Eq. 15."""
    return flight.position_error[:, _steady(flight)].double().mean(dim=1)


def settling_times(flight: Flight) -> Tensor:
    """When each start came within 5 cm of the target for good, in s, (N,); infinite where it never did."""
    outside = flight.position_error >= SETTLED_M
    samples = outside.shape[1]
    last_outside = torch.where(outside, torch.arange(samples), -1).amax(dim=1)
    settled = last_outside < samples - 1
    first_inside = (last_outside + 1).clamp(max=samples - 1)
    time = flight.time[0, first_inside].double()
    return torch.where(settled, time, math.inf)
