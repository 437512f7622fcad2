"""``python -m auv_torchrl.blind.real FOLDER``: diagnose two runs of a real BlueROV2 Heavy, predict the third.

The third run is simulated from its commands alone, from its first sample to its last, with the published vehicle and
with what was found added. Where to get the runs: ``docs/diagnosis.md``.
"""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch

from auv_torchrl.diagnosis import diagnose
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import VELOCITY, Episode, FlightLog, join, read_flightlog
from auv_torchrl.physics import CONTROL_DT, ActiveTerms, control_step, prepare, rest_state
from auv_torchrl.physics.kinematics import quaternion_from_euler
from auv_torchrl.physics.step import memory_length
from auv_torchrl.vehicle import Vehicle, load_vehicle

VEHICLE = "bluerov2_heavy"
LEARN = ("run_11_40_38.csv", "run_12_09_45.csv")
TEST = "run_11_10_52_sync.csv"  # yaw is never commanded in it
MUST = {"u": 0.049, "v": 0.044, "w": 0.042}  # m/s, the best of the published figures


def simulate(vehicle: Vehicle, episode: Episode) -> np.ndarray:
    """Body velocities (T, 6) at the samples, simulated from the first sample on by the commands alone."""
    c = prepare(vehicle.expand(1)).numpy()
    terms = ActiveTerms.of(c)
    pose, velocity = np.nan_to_num(episode.pose[:1]), np.nan_to_num(episode.velocity[:1])
    memory = memory_length(float(c.delay.max()))
    state = rest_state(pose[:, :3], quaternion_from_euler(*pose[:, 3:].T), velocity, vehicle.thrusters, memory)
    t = episode.t - episode.t[0]
    steps = int(np.ceil(t[-1] / CONTROL_DT)) + 1
    sent = np.clip(np.searchsorted(t, np.arange(steps) * CONTROL_DT + 1e-9, side="right") - 1, 0, None)
    reached = [velocity[0]]
    for k in sent:
        state = control_step(c, terms, state, episode.commands[k][None])
        reached.append(state.velocity[0])
    times = np.arange(len(reached)) * CONTROL_DT
    return np.column_stack([np.interp(t, times, series) for series in np.transpose(reached)])


def changed(vehicle: Vehicle, found: Mapping[str, Mapping[str, float]]) -> Vehicle:
    """The vehicle with effects and their values, in the order of the registry."""
    for name, effect in EFFECTS.items():
        if name in found:
            vehicle = effect.apply(vehicle, found[name])
    return vehicle


def figures(vehicle: Vehicle, log: FlightLog) -> dict[str, float]:
    """Root mean square error per velocity, and the share of the variance of the yaw rate that is accounted for."""
    measured = np.concatenate([episode.velocity for episode in log.episodes])
    error = np.concatenate([simulate(vehicle, episode) for episode in log.episodes]) - measured
    rmse = np.sqrt(np.nanmean(error**2, axis=0))
    yaw = VELOCITY.index("r")
    vaf = 1 - np.nanvar(error[:, yaw]) / np.nanvar(measured[:, yaw])
    return {**dict(zip(VELOCITY, rmse.tolist(), strict=True)), "yaw rate VAF": float(vaf)}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("folder", type=Path, help=f"with {', '.join((*LEARN, TEST))}")
    folder = parser.parse_args().folder
    if missing := [name for name in (*LEARN, TEST) if not (folder / name).is_file()]:
        parser.error(f"{folder} lacks {', '.join(missing)}: docs/diagnosis.md says where to get them")
    torch.set_num_threads(1)
    vehicle = load_vehicle(VEHICLE)
    test = read_flightlog(folder / TEST, vehicle)
    learn = join(read_flightlog(folder / name, vehicle) for name in LEARN)
    diagnosis = diagnose(learn, vehicle, test=[test], vehicle_name=VEHICLE)
    found = {e.name: {k: p.value for k, p in e.parameters.items()} for e in diagnosis.effects}
    before, after = figures(vehicle, test), figures(changed(vehicle, found), test)
    lines = [diagnosis.summary, *(effect.sentence for effect in diagnosis.effects), ""]
    lines += ["| on the third run | before | after | to beat |", "|---|---|---|---|"]
    for key in (*VELOCITY, "yaw rate VAF"):
        target = MUST.get(key) or (0.6 if key == "yaw rate VAF" else "")
        lines.append(f"| {key} | {before[key]:.3f} | {after[key]:.3f} | {target} |")
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
