"""Faults in flight: detection, recovery, false alarms and cost.

python -m benchmarks.control.fault_recovery [--count N]
"""

import argparse
import math
from dataclasses import replace
from pathlib import Path

import torch
from torchrl.envs import TransformedEnv

from auv_torchrl.adaptation import InFlightAdapter, load_adaptation_config
from auv_torchrl.adaptation.flight import AdaptedFlight, cost_per_step, fly_adapting
from auv_torchrl.adaptation.recovery import Recovery, recoveries
from auv_torchrl.ddr.transform import observing
from auv_torchrl.envs import TorchFleet
from auv_torchrl.evaluation import Policy, draw_starts
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import Vehicle, load_vehicle
from benchmarks.control.least_delay import least_delays
from benchmarks.control.source import STORE, shipped_scenario, source_policy

FAULTS = ("swap", "thruster_gain", "reversed", "reversed_and_dead", "cycle", "two_reversed", "triple_fault")
EARLIEST_S, LATEST_S = 5.0, 15.0  # the fault comes at a random time between
CONDITIONS = {  # name: (what the water and the sensors do all along, settings of the adapter)
    "still water": ({}, {}),
    "current of 0.1 m/s": ({"current": {"north": 0.07, "east": 0.07}}, {}),
    "pose alone, 2 mm and 0.2°": ({"sensor_noise": {"position": 0.002, "attitude": 0.0035}}, {"sensed": "pose"}),
}


def fly_fault(
    vehicle: Vehicle, policy: Policy, fault: str | None, condition: str, count: int, seconds: float, seed: int = 0
) -> tuple[AdaptedFlight, torch.Tensor]:
    """Flights of ``count`` adapted vehicles, and when each met the fault."""
    lasting, overrides = CONDITIONS[condition]
    acting = read_scenario("bench", {"effects": lasting}, vehicle).changes
    if fault is not None:
        acting += tuple(replace(c, start_s=EARLIEST_S) for c in shipped_scenario(fault, vehicle).changes)
    task = replace(StationKeeping().for_evaluation(1.0), episode_s=seconds + 1, thruster_commands=True)
    fleet = TorchFleet(vehicle, task, count, scenario=Scenario("bench", acting), seed=seed)
    draws = torch.rand(count, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    delays = (LATEST_S - EARLIEST_S) * draws
    fleet.simulator.delay_scenario(delays)
    adapter = InFlightAdapter(vehicle, task, load_adaptation_config(overrides=overrides), count)
    env = TransformedEnv(fleet, observing(adapter, task))
    starts = draw_starts(task, count, seed=seed + 1)
    return fly_adapting(env, policy, starts, round(seconds / task.control_dt)), EARLIEST_S + delays


def row(name: str, condition: str, recovery: Recovery, least_s: torch.Tensor) -> str:
    """One line of the table."""

    def at(values: torch.Tensor, share: float) -> float:
        return float(values.quantile(share, interpolation="higher"))

    seen = recovery.felt_s.isfinite()
    noticed = recovery.delay_s[seen & recovery.delay_s.isfinite()]
    missed = int((seen & ~recovery.delay_s.isfinite()).sum())
    possible = least_s[seen]
    soonest = at(possible, 0.9) if len(possible) else math.inf
    least = f"{soonest:.2f}" if math.isfinite(soonest) else "never"
    delay = f"{at(noticed, 0.9):.2f}" if len(noticed) else "–"
    return (
        f"| {name} | {condition} | {at(recovery.time_s, 0.5):.2f} | {at(recovery.time_s, 0.9):.2f} | "
        f"{at(recovery.largest_m, 0.5):.3f} | {at(recovery.largest_m, 0.9):.3f} | "
        f"{float(recovery.steady_m.mean()):.4f} | {float(recovery.steady_m.max()):.4f} | {delay} | {least} | "
        f"{missed} | {int(recovery.alarms_before.sum())} |"
    )


def main() -> None:
    """Measure and print Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="flights per fault and condition")
    parser.add_argument("--seconds", type=float, default=40.0, help="length of a flight")
    parser.add_argument("--policies", type=Path, default=STORE, help="store of policies")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    vehicle = load_vehicle("paper")
    policy = source_policy(vehicle, arguments.policies).module
    count, seconds = arguments.count, arguments.seconds
    print(
        f"{count} flights of {seconds:g} s per row, starts in ±1 m, fault at a random time between {EARLIEST_S:g} and "
        f"{LATEST_S:g} s. Recovered: closer than 5 cm for good. Detection delay: from the first moment at which the "
        f"fault changes a thrust by 1 N; least possible: of any test with as few false alarms, on average, if told "
        f"the fault and its moment, under the sensor noise and the disturbance that the adapter allows for. Where a "
        f"current is on all along, the alarms before the fault are those that notice the current.\n"
    )
    print(
        "| fault | condition | recovery median [s] | 90 % [s] | largest error median [m] | 90 % [m] | mean error from "
        "10 s after it [m] | worst flight [m] | detection delay 90 % [s] | least possible 90 % [s] | felt but "
        "unnoticed | alarms before it |"
    )
    print("|" + "---|" * 12)
    for condition in CONDITIONS:
        for fault in FAULTS:
            flown, fault_s = fly_fault(vehicle, policy, fault, condition, count, seconds)
            recovery = recoveries(flown, fault_s, vehicle)
            config = load_adaptation_config(overrides=CONDITIONS[condition][1])
            least = least_delays(flown.flight, fault_s + recovery.felt_s, vehicle, config)
            print(row(fault, condition, recovery, least), flush=True)
    print()
    flights = max(1, round(3600 / seconds * min(1.0, count / 100)))
    for condition in CONDITIONS:
        flown, _ = fly_fault(vehicle, policy, None, condition, flights, seconds)
        alarms = int(flown.alarm.sum())
        later = int(flown.alarm[:, 101:].sum())
        print(
            f"Without a fault, {condition}: {flights * seconds / 3600:.2f} h of flight, {alarms} alarms, {later} of "
            f"them after the first 5 s.\n"
        )
    for sensed in ("velocity", "pose"):
        following, searching = cost_per_step(vehicle, load_adaptation_config(overrides={"sensed": sensed}))
        print(
            f"Cost per control step at batch 1, {sensed}: {following:.2f} ms of CPU while following, "
            f"{searching:.2f} ms while searching, refit included (the fit is recursive: it has no other cost).\n"
        )


if __name__ == "__main__":
    main()
