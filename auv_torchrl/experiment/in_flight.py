"""One flight in which the vehicle changes and the adaptation copes with it: flown, judged, and put into words."""

import logging
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor
from torchrl.envs import TransformedEnv

from auv_torchrl.adaptation import InFlightAdapter
from auv_torchrl.adaptation.config import SETTLED_S
from auv_torchrl.adaptation.flight import AdaptedFlight, cost_per_step, fly_adapting, gains
from auv_torchrl.adaptation.recovery import BACK_M, BACK_RAD, Moment, Recovery, moments, recoveries
from auv_torchrl.authority import Authority, controlled_allocation
from auv_torchrl.ddr.transform import observing
from auv_torchrl.envs import FleetEnv
from auv_torchrl.evaluation import Policy, fly
from auv_torchrl.experiment.schedule import Schedule, schedule
from auv_torchrl.experiment.setup import Experiment
from auv_torchrl.flight import Flight
from auv_torchrl.quantities import counted, percent, quantity, words
from auv_torchrl.recording import OneFlight
from auv_torchrl.tasks import cruise_speed
from auv_torchrl.vehicle import Vehicle

TIMED_STEPS = 120  # control steps in which the adapter's cost is measured

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class InFlight:
    """N flights through the same changes, with the adaptation and with u_s alone, from the same starts."""

    schedule: Schedule
    adapted: AdaptedFlight
    alone: Flight
    recovered: tuple[Recovery, ...]  # by change
    axes: tuple[str, ...]  # that are controlled
    speed: float  # ahead in m/s; 0 of a vehicle that hovers
    remaining: Authority  # what most vehicles can still do at the end, as estimated in flight
    agreeing: float  # share of the flights that estimate so
    cost_ms: tuple[float, float]  # CPU time per control step of one vehicle: following, searching

    @property
    def shown(self) -> int:
        """The flight with the median largest error, of those that noticed the first change if any did."""
        first = self.recovered[0]
        noticed = first.alarm_s.isfinite()
        rows = noticed.nonzero()[:, 0] if noticed.any() else torch.arange(len(noticed))
        order = first.largest_m[rows].argsort(stable=True)
        return int(rows[order[(len(rows) - 1) // 2]])

    def moments_of(self, start: int) -> list[Moment]:
        """What happened in one flight, in order."""
        changes = {change.what: float(change.at_s[start]) for change in self.schedule.changes}
        return moments(self.adapted, start, changes, self.recovered)

    def gains_of(self, start: int, nominal: Any) -> tuple[Tensor, Tensor]:
        """Estimated and true gains (T + 1, n) of the thrusters of one flight, 1 when healthy.

        Args:
            start: which flight.
            nominal: (a, n) effectiveness of the healthy vehicle.
        """
        flown = self.adapted.of_start(start)
        healthy = torch.as_tensor(nominal, dtype=torch.float64)
        estimated = gains(flown.effectiveness.double(), healthy)
        true = torch.ones_like(estimated)
        for change in self.schedule.changes:
            since = flown.flight.time.double() > change.at_s[start]
            true[since] = gains(torch.as_tensor(controlled_allocation(change.after, self.axes, self.speed)), healthy)
        return estimated, true

    def one_flight(self, vehicle: Vehicle) -> OneFlight:
        """The shown flight for a recording; ``vehicle`` is the nominal one."""
        estimated, true = self.gains_of(self.shown, controlled_allocation(vehicle, self.axes, self.speed))
        return OneFlight(
            vehicle, self.adapted.of_start(self.shown), self.alone.of_start(self.shown), estimated, true,
            self.moments_of(self.shown), self.summary(),
        )  # fmt: skip

    def alone_steady_m(self, number: int) -> Tensor:
        """Mean error (N,) of u_s alone from 10 s after a change until the next; NaN where there is no such time."""
        time, error = self.alone.time.double(), self.alone.position_error.double()
        late = time >= self.schedule.changes[number].at_s[:, None] + SETTLED_S
        if number + 1 < len(self.schedule.changes):
            late &= time <= self.schedule.changes[number + 1].at_s[:, None]
        return torch.where(late, error, 0.0).sum(1) / late.sum(1)

    def alone_heading_rad(self, number: int) -> float:
        """Likewise the mean heading error of u_s alone, over the flights."""
        time, late = self.alone.time.double(), self.schedule.changes[number].at_s[:, None] + SETTLED_S
        return float(self.alone.heading_error.double()[time >= late].mean())

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        remaining = self.remaining
        changes = []
        for number, (change, recovery) in enumerate(zip(self.schedule.changes, self.recovered, strict=True)):
            alone = self.alone_steady_m(number)
            changes.append(
                {
                    "what": change.what,
                    "at_s": {"first": float(change.at_s.min()), "last": float(change.at_s.max())},
                    **recovery.as_dict(),
                    "u_s_steady_m": float(alone.mean()) if alone.isfinite().all() else None,
                }
            )
        following, searching = self.cost_ms
        return {
            "summary": self.summary(),
            "flights": len(self.recovered[0].time_s),
            "length_s": float(self.adapted.flight.time[0, -1]),
            "changes": changes,
            "false_alarms": int(self.recovered[0].alarms_before.sum()),
            "remaining": {
                "rank": remaining.thruster_rank,
                "alone": list(remaining.independent),
                "together": list(remaining.coupled),
                "lost": list(remaining.lost),
                "agreeing": self.agreeing,
            },
            "cost_ms": {"following": following, "searching": searching},
            "shown": self.shown,
        }

    def summary(self) -> str:
        """What happened in the shown flight and in all of them, a line per change."""
        lines = []
        for number in range(len(self.recovered)):
            lines.append(f"In flight: {self._of_shown(number)}. {self._of_all(number)}")
        if len(self.remaining.independent) < len(self.axes):
            lines.append(f"In flight, {percent(self.agreeing)} of the flights find: {self.remaining}")
        return "\n".join(lines)

    def _of_shown(self, number: int) -> str:
        change, recovery, row = self.schedule.changes[number], self.recovered[number], self.shown
        text = f"{words(change.what)} at {float(change.at_s[row]):.1f} s"
        if not recovery.alarm_s[row].isfinite():
            text += ", not noticed"
        else:
            text += f", noticed after {float(recovery.alarm_s[row]):.2f} s"
            refit = float(recovery.refit_s[row])
            text += f", map refitted {refit:.2f} s later" if refit < float("inf") else ", map not settled"
        return f"{text}, {_back(float(recovery.time_s[row]), float(recovery.largest_m[row]))}"

    def _of_all(self, number: int) -> str:
        found = self.recovered[number].as_dict()
        count, alone = len(self.recovered[number].time_s), self.alone_steady_m(number)
        text = f"Of {counted(count, 'flight')} {percent(found['noticed'])} noticed it"
        if found["delay_s"]:
            felt = " of its first effect on a thrust" if found["felt"] else ""
            text += f" (90 % within {found['delay_s']['p90']:.2f} s{felt})"
        back = found["recovery_s"]["p90"]
        text += ", fewer than 90 %" if back is None else ", 90 %"
        near = quantity(BACK_M, "m", 1) + (f" and {quantity(BACK_RAD, 'rad')}" if self.speed else "")
        text += f" were within {near} for good" + ("" if back is None else f" after {back:.2f} s")
        if found["steady_m"]:
            text += f"; mean error from {SETTLED_S:g} s on {_metres(found['steady_m']['mean'])}"
            text += f", u_s alone {_metres(float(alone.mean()))}"
        if self.speed and found["steady_rad"] is not None:
            headings = (found["steady_rad"], self.alone_heading_rad(number))
            text += "; heading error {}, u_s alone {}".format(*(quantity(angle, "rad") for angle in headings))
        return f"{text}."


def _back(seconds: float, largest_m: float) -> str:
    back, largest = quantity(BACK_M, "m", 1), f"(largest {_metres(largest_m)})"
    if seconds == 0.0:
        return f"error never above {back} {largest}"
    if seconds == float("inf"):
        return f"error not below {back} for good {largest}"
    return f"error < {back} again after {seconds:.1f} s {largest}"


def _metres(value: float | None) -> str:
    return "without bound" if value is None or not value < float("inf") else quantity(value, "m")


def fly_in_flight(experiment: Experiment, policy: Policy) -> InFlight:
    """The starts of an experiment once more, with the scenario setting in during the flight.

    Args:
        experiment: with a scenario.
        policy: u_s.
    """
    config, starts = experiment.flight, experiment.starts
    count = len(starts)
    task = replace(experiment.exam, episode_s=config.length_s, thruster_commands=True)
    plan = schedule(experiment.scenario, experiment.vehicle, config, count, experiment.starts_seed, task.control_dt)
    adapter = InFlightAdapter(experiment.vehicle, task, experiment.adaptation, count)

    def fleet(thruster_commands: bool) -> FleetEnv:
        made = experiment.fleet(count, plan.scenario, thruster_commands, config.length_s)
        made.simulator.delay_scenario(plan.delay_s)
        return made

    adapted = fly_adapting(TransformedEnv(fleet(True), observing(adapter, task)), policy, starts, task.steps)
    axes, speed = experiment.task.axes, cruise_speed(task)
    alone = fly(fleet(False), policy, starts, task.steps)
    nexts = [change.at_s for change in plan.changes[1:]] + [None]
    recovered = tuple(
        recoveries(adapted, change.at_s, change.before, until, steering=speed > 0)
        for change, until in zip(plan.changes, nexts, strict=True)
    )
    _warn_of_early_faults(adapted, plan)
    remaining, agreeing = _consensus(adapter, recovered[-1])
    cost = cost_per_step(experiment.vehicle, experiment.adaptation, TIMED_STEPS, task)
    return InFlight(plan, adapted, alone, recovered, axes, speed, remaining, agreeing, cost)


def _warn_of_early_faults(adapted: AdaptedFlight, plan: Schedule) -> None:
    flight, at = adapted.flight, plan.changes[0].at_s
    before = (flight.time.double() <= at[:, None]).sum(1, keepdim=True) - 1
    away = (flight.position_error.gather(1, before)[:, 0] >= BACK_M) & (at > 0)
    if away.any():
        log.warning(
            "   %d of %d vehicles had not reached the target when the fault came: the way there counts as recovery; "
            "a later flight.fault_s and a longer flight.length_s avoid that", int(away.sum()), len(at),
        )  # fmt: skip


def _consensus(adapter: InFlightAdapter, last: Recovery) -> tuple[Authority, float]:
    """What most of the vehicles that noticed the last change can still do, and the share that agrees."""
    noticed = last.alarm_s.isfinite()
    rows = noticed.nonzero()[:, 0].tolist() if noticed.any() else range(len(noticed))
    verdict_of = {row: adapter.authority(row) for row in rows}
    verdicts: Mapping[tuple[str, ...], int] = Counter(_verdict(found) for found in verdict_of.values())
    chosen, votes = max(verdicts.items(), key=lambda item: item[1])
    found = next(found for found in verdict_of.values() if _verdict(found) == chosen)
    return replace(found, name="vehicle"), votes / len(verdict_of)


def _verdict(found: Authority) -> tuple[Any, ...]:
    return found.channel_rank, found.thruster_rank, found.independent, found.coupled
