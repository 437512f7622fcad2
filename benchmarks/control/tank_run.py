"""The paper's tank run, simulated: python -m benchmarks.control.tank_run [--count N].

Lu et al. 2023, section 5.2 and figure 20: from (0.18, -0.46, -0.40) m to the origin, disturbed by a propeller fixed to
the tank, measured by motion capture at 60 Hz. The paper gives neither the propeller's wash nor the vehicle's
parameters.
"""

import argparse
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from tensordict import TensorDict
from torchrl.envs import TransformedEnv

from auv_torchrl.adaptation import InFlightAdapter, load_adaptation_config
from auv_torchrl.adaptation.flight import fly_adapting
from auv_torchrl.ddr.transform import observing
from auv_torchrl.envs import TorchFleet
from auv_torchrl.evaluation import STEADY_FROM_S, Policy, fly, steady_errors
from auv_torchrl.flight import Flight
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.hydrodynamics import drag
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import Vehicle, load_vehicle
from auv_torchrl.vehicle.tensors import tensors
from benchmarks.control.source import STORE, source_policy

START_M = (0.18, -0.46, -0.40)  # section 5.2
RATE_HZ = 60  # of the motion capture, section 5.2
NOISE = {"position": 0.002, "attitude": 0.0035}  # m and rad: "sub-centimeter", as for Nokov's system
FLIGHT_S = 30.0
WASH_MPS, FLUCTUATION_MPS = 0.10, 0.05  # mean and standard deviation of the wash along its axis; assumed
GUST_S = 1.0  # correlation time of the fluctuation; assumed
HOLD_S = 0.5  # the wash is held so long
PUBLISHED_M = 0.15  # section 5.2, where "0.15 mm" is a misprint


@dataclass(frozen=True)
class Tank:
    """One row of the table."""

    name: str
    vehicle: str  # conf/vehicle that is flown; the source is always paper
    effects: dict[str, Any]  # beside noise and wash
    controller: str  # u_s or u_t


RUNS = (
    Tank("`paper`", "paper", {}, "u_s"),
    Tank("`paper`", "paper", {}, "u_t"),
    Tank("`paper`, thruster 1 reversed", "paper", {"thruster_gain": {"gain_1": -1.0}}, "u_s"),
    Tank("`paper`, thruster 1 reversed", "paper", {"thruster_gain": {"gain_1": -1.0}}, "u_t"),
    Tank("`bluerov2`, a tenth of the drag", "bluerov2", {}, "u_s"),
    Tank("`bluerov2`, a tenth of the drag", "bluerov2", {}, "u_t"),
)


def wash(generator: torch.Generator) -> dict[str, Any]:
    """The propeller's wash as currents one after another: a mean along a horizontal axis, with correlated gusts."""
    keep = math.exp(-HOLD_S / GUST_S)
    gust, effects = torch.zeros(3, dtype=torch.float64), {}
    axis = torch.nn.functional.normalize(torch.tensor((1.0, 1.0, 0.0), dtype=torch.float64), dim=0)
    for k in range(round(FLIGHT_S / HOLD_S)):
        draw = torch.randn(3, generator=generator, dtype=torch.float64)
        gust = keep * gust + (1 - keep**2) ** 0.5 * FLUCTUATION_MPS * draw
        north, east, down = (WASH_MPS * axis + gust).tolist()
        times = {"start_s": k * HOLD_S, "stop_s": (k + 1) * HOLD_S}
        effects[f"wash_{k}"] = {"effect": "current", "north": north, "east": east, "down": down, **times}
    return effects


def tank_scenario(run: Tank, vehicle: Vehicle, seed: int) -> Scenario:
    """Noise, wash and what is wrong with the vehicle."""
    effects = {"sensor_noise": NOISE, **run.effects, **wash(torch.Generator().manual_seed(seed))}
    return read_scenario(run.name, {"effects": effects}, vehicle)


def fly_tank(run: Tank, source: Vehicle, policy: Policy, count: int, seed: int) -> tuple[Flight, int]:
    """``count`` flights through the same wash, each with its own noise, and the number of alarms in them.

    u_t sees the poses of the motion capture and velocities estimated from them, u_s the same poses and, in its favour,
    the true velocities.
    """
    adapted = run.controller == "u_t"
    vehicle = load_vehicle(run.vehicle)
    task = replace(
        StationKeeping().for_evaluation(1.0), control_dt=1.0 / RATE_HZ, episode_s=FLIGHT_S, thruster_commands=adapted
    )
    fleet = TorchFleet(vehicle, task, count, scenario=tank_scenario(run, vehicle, seed), seed=seed)
    starts = TensorDict(
        {
            "position": torch.tensor(START_M, dtype=torch.float64).expand(count, 3),
            "quaternion": torch.tensor((1.0, 0.0, 0.0, 0.0), dtype=torch.float64).expand(count, 4),
            "velocity": torch.zeros(count, 6, dtype=torch.float64),
        },
        [count],
    )
    if not adapted:
        return fly(fleet, policy, starts, task.steps), 0
    adapter = InFlightAdapter(source, task, load_adaptation_config(overrides={"sensed": "pose"}), count)
    flown = fly_adapting(TransformedEnv(fleet, observing(adapter, task)), policy, starts, task.steps)
    return flown.flight, int(flown.alarm.sum())


def push(vehicle: Vehicle, seed: int) -> tuple[float, float]:
    """Mean and largest force in N of the wash on a vehicle that holds its place."""
    changes = tank_scenario(RUNS[0], vehicle, seed).changes
    speeds = [[c.values["north"], c.values["east"], c.values["down"]] for c in changes if c.effect.name == "current"]
    relative = torch.nn.functional.pad(-torch.tensor(speeds, dtype=torch.float64), (0, 3))
    c = prepare(tensors(vehicle))
    force = drag(c, ActiveTerms.of(c), relative)[:, :3].norm(dim=-1)
    return float(force.mean()), float(force.max())


def line(run: Tank, flights: list[tuple[Flight, int]]) -> str:
    """One row of the table."""
    mean = torch.cat([steady_errors(flight) for flight, _ in flights])
    largest = torch.cat([flight.position_error[:, flight.time[0] >= STEADY_FROM_S].amax(1) for flight, _ in flights])
    alarms = sum(count for _, count in flights) / len(mean)
    return (
        f"| {run.name} | {run.controller} | {float(mean.mean()):.4f} | {float(mean.max()):.4f} | "
        f"{float(largest.max()):.3f} | {f'{alarms:.1f}' if run.controller == 'u_t' else '–'} |"
    )


def main() -> None:
    """Fly and print Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10, help="flights per wash, which differ in noise")
    parser.add_argument("--washes", type=int, default=3, help="draws of the wash")
    parser.add_argument("--policies", type=Path, default=STORE, help="store of policies")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    source = load_vehicle("paper")
    policy = source_policy(source, arguments.policies).module
    mean, largest = (max(values) for values in zip(*(push(source, w) for w in range(arguments.washes)), strict=True))
    print(
        f"{arguments.washes} draws of the propeller's wash with {arguments.count} flights of {FLIGHT_S:g} s each, from "
        f"rest at {START_M} m. Wash, assumed: {WASH_MPS:g} m/s with fluctuations of {FLUCTUATION_MPS:g} m/s in all "
        f"directions; it pushes a vehicle `paper` that holds its place with {mean:.0f} N on average and {largest:.0f} "
        f"N at most. "
        f"Commands and measurements at {RATE_HZ} Hz, noise of {1e3 * NOISE['position']:g} mm and "
        f"{math.degrees(NOISE['attitude']):.1f}°. The source policy was trained on `paper` in still water. The paper "
        f"held its vehicle within {PUBLISHED_M:g} m.\n"
    )
    print(
        "| vehicle | controller | mean error for t ≥ 10 s [m] | worst flight [m] | largest error for t ≥ 10 s [m] | "
        "alarms per flight |"
    )
    print("|---|---|---:|---:|---:|---:|")
    for run in RUNS:
        flights = [fly_tank(run, source, policy, arguments.count, seed) for seed in range(arguments.washes)]
        print(line(run, flights), flush=True)


if __name__ == "__main__":
    main()
