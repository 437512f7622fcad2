"""Make examples/flight.csv: six flights of 20 s in MuJoCo, in which thruster 4 gives 55 % of its thrust.

``python examples/make_flight.py [PATH]``. What is wrong with the vehicle is written here and nowhere else.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from tensordict import TensorDictBase

from auv_torchrl.envs import make_fleet
from auv_torchrl.evaluation import draw_starts, fly
from auv_torchrl.flightlog import Episode, FlightLog, write_flightlog
from auv_torchrl.physics.kinematics import euler_angles, wrap_angle
from auv_torchrl.scenario import read_scenario
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle

FAULT = {"effects": {"thruster_gain": {"gain_4": 0.55}}}
FLIGHTS = 6
POSITION_NOISE = 0.002  # m, a motion-capture system under water
ATTITUDE_NOISE = 0.004  # rad
AXES = ("x", "y", "z", "yaw")
DEMAND = 0.3  # amplitude of each wave, of full command
PERIODS = (2.0, 12.0)  # s, of the waves


class Pilot:
    """Moves the stick of each channel slowly to and fro, without looking where the vehicle goes."""

    def __init__(self, flights: int, generator: torch.Generator):
        shape = (flights, 4, 3)
        low, high = PERIODS
        self.frequency = 2 * torch.pi / (low + (high - low) * torch.rand(shape, generator=generator))
        self.phase = 2 * torch.pi * torch.rand(shape, generator=generator)

    def __call__(self, td: TensorDictBase) -> TensorDictBase:
        """Write ``action`` (N, 4) for ``time`` (N, 1)."""
        wave = torch.sin(self.frequency * td["time"][..., None] + self.phase).sum(-1)
        return td.set("action", (DEMAND * wave).clamp(-1, 1).float())


def main(path: Path) -> None:
    """Fly and write the log."""
    vehicle = load_vehicle("paper")
    task = StationKeeping().for_evaluation(box_m=1.0)
    fleet = make_fleet("mujoco", vehicle, task, FLIGHTS, scenario=read_scenario("fault", FAULT, vehicle), seed=0)
    generator = torch.Generator().manual_seed(4)
    flight = fly(fleet, Pilot(FLIGHTS, generator), draw_starts(task, FLIGHTS, seed=4), task.steps)
    rng = np.random.default_rng(4)
    episodes = []
    for number in range(FLIGHTS):
        one = flight.of_start(number)
        attitude = torch.stack(euler_angles(one.quaternion.double()), -1).numpy()
        pose = np.concatenate((one.position.double().numpy(), attitude), -1)
        pose += rng.normal(size=pose.shape) * np.repeat((POSITION_NOISE, ATTITUDE_NOISE), 3)
        pose[:, 3:] = wrap_angle(pose[:, 3:])
        command = one.command.double().numpy()[1:]  # of the step that begins at each sample; the last sample has none
        unseen = np.full_like(pose[:-1], np.nan)
        episodes.append(Episode(number, one.time.double().numpy()[:-1], pose[:-1], unseen, command))
    write_flightlog(FlightLog(path.name, tuple(episodes), AXES), path)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("flight.csv"))
