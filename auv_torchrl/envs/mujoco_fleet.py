"""The fleet in MuJoCo: contacts, and MuJoCo's integrator."""

import torch

from auv_torchrl.envs.fleet import FleetEnv
from auv_torchrl.envs.start import vehicles_of
from auv_torchrl.scenario import Scenario
from auv_torchrl.simulator import NumpyArrays
from auv_torchrl.simulator.mujoco import MujocoSimulator
from auv_torchrl.simulator.mujoco_model import HULL
from auv_torchrl.tasks import Task
from auv_torchrl.vehicle import Vehicle


class MujocoFleet(FleetEnv):
    """Vehicles in a :class:`MujocoSimulator`.

    Args:
        vehicle: one nominal vehicle or a batch of ``num_envs``.
        task: what is observed, rewarded and where episodes start.
        num_envs: number of vehicles N.
        scenario: effects on top of each vehicle, by episode time; None for none.
        seed: of starts and sensor noise; None draws one.
        device: of the tensors; MuJoCo itself runs on the CPU.
        walls: half sizes in m of a tank around the origin; None for open water.

    Raises:
        ValueError: for no vehicles, a batch of vehicles that is not one per environment, or starts that do not fit
            between the walls.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        task: Task,
        num_envs: int,
        scenario: Scenario | None = None,
        seed: int | None = None,
        device: torch.device | str = "cpu",
        walls: tuple[float, float, float] | None = None,
    ) -> None:
        farthest = task.farthest_start_m + max(HULL)
        if walls is not None and min(walls) < farthest:
            raise ValueError(
                f"fleet: walls at {walls} m, starts reach {farthest:g} m: give farther walls or a smaller box"
            )
        (vehicles, task), arrays = vehicles_of(vehicle, num_envs, task), NumpyArrays(torch.device(device))
        simulator = MujocoSimulator(vehicles, task.control_dt, scenario=scenario, arrays=arrays, walls=walls)
        super().__init__(simulator, task, seed)
