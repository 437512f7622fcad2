"""When the vehicle changes during the one flight that shows fault, detection, refit and recovery."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from auv_torchrl.experiment.flight_config import FlightConfig
from auv_torchrl.scenario import Scenario
from auv_torchrl.vehicle import Vehicle


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
        labels = [f"{change.label} begins" for change in scenario.changes if change.start_s == time]
        labels += [f"{change.label} ends" for change in scenario.changes if change.stop_s == time]
        after = scenario.vehicle_at(nominal, time)
        found.append(ScheduledChange(", ".join(labels), time + delay, before, after))
        before = after
    return tuple(found)
