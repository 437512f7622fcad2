"""When the vehicle changes during the one flight that shows fault, detection, refit and recovery."""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import torch
from torch import Tensor

from auv_torchrl.adaptation.recovery import SETTLED_S
from auv_torchrl.scenario import Scenario
from auv_torchrl.settings import In, check_fields
from auv_torchrl.vehicle import Vehicle


@dataclass(frozen=True)
class FlightConfig:
    """``flight`` in ``conf/train.yaml``, which explains the values; there are no defaults elsewhere.

    Raises:
        ValueError: for times that do not fit into each other, saying which do.
    """

    fly: bool
    length_s: Annotated[float, In("(0, 3600]")]
    fault_s: Annotated[tuple[float, float], In("(0, 3600]")]

    def __post_init__(self) -> None:
        """Refuse faults before the start or so late that no recovery could be seen."""
        check_fields(self, "flight")
        earliest, latest = self.fault_s
        if not earliest <= latest:
            raise ValueError(f"flight.fault_s is {list(self.fault_s)}: give two times, 0 < earliest <= latest")
        self.check_end(latest, "flight.fault_s ends")

    def check_end(self, last_change_s: float, what: str) -> None:
        """Refuse a flight that ends less than 10 s after ``last_change_s``; ``what`` says what comes then."""
        if not last_change_s + SETTLED_S <= self.length_s < math.inf:
            raise ValueError(
                f"flight: {what} at {last_change_s:g} s and flight.length_s is {self.length_s:g}: "
                f"give {last_change_s + SETTLED_S:g} or more, or flight.fly=false"
            )


@dataclass(frozen=True)
class ScheduledChange:
    """One moment at which the vehicles change."""

    what: str  # e.g. "thruster_gain begins"
    at_s: Tensor  # (N,) s
    before: Vehicle  # the vehicle (empty batch) until then
    after: Vehicle  # and from then on


@dataclass(frozen=True)
class Schedule:
    """What N vehicles meet in flight, and when."""

    scenario: Scenario
    delay_s: Tensor  # (N,) by which each vehicle meets the scenario later
    changes: tuple[ScheduledChange, ...]


def schedule(
    scenario: Scenario, nominal: Vehicle, config: FlightConfig, count: int, seed: int, control_dt: float
) -> Schedule:
    """A scenario with times of its own as it is written, any other from a random time on.

    Args:
        scenario: with at least one change.
        nominal: the vehicle (empty batch) without it.
        config: says between which times a fault comes.
        count: number of vehicles N.
        seed: of these times.
        control_dt: s; a vehicle changes at the beginning of a control step.

    Raises:
        ValueError: if the flight ends less than 10 s after the last change.
    """
    delay = torch.zeros(count, dtype=torch.float64)
    if times := scenario.switching_times():
        config.check_end(times[-1], f"scenario {scenario.name} changes the vehicle last")
    else:
        earliest, latest = config.fault_s
        scenario = Scenario(scenario.name, tuple(replace(c, start_s=earliest) for c in scenario.changes))
        generator = torch.Generator().manual_seed(seed)
        draws = torch.rand(count, generator=generator, dtype=torch.float64)
        delay = ((latest - earliest) * draws / control_dt).floor() * control_dt
    return Schedule(scenario, delay, _changes(scenario, nominal, delay))


def _changes(scenario: Scenario, nominal: Vehicle, delay: Tensor) -> tuple[ScheduledChange, ...]:
    at_start = [0.0] if any(change.start_s == 0.0 for change in scenario.changes) else []
    found, before = [], nominal
    for time in at_start + scenario.switching_times():
        said = [f"{change.label} begins" for change in scenario.changes if change.start_s == time]
        said += [f"{change.label} ends" for change in scenario.changes if change.stop_s == time]
        after = scenario.vehicle_at(nominal, time)
        found.append(ScheduledChange(", ".join(said), time + delay, before, after))
        before = after
    return tuple(found)
