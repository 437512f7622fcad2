"""Source models and targets that the tests of DDR share."""

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
import yaml
from tensordict.nn import TensorDictModule
from torch import Tensor, nn

from auv_torchrl.authority import controlled_allocation
from auv_torchrl.ddr import PretrainingConfig, SourceModels, pretrain
from auv_torchrl.envs import TorchFleet
from auv_torchrl.paths import config_path
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import Vehicle, load_vehicle
from auv_torchrl.vehicle.tensors import tensors

TASK = StationKeeping(start_speed=0.5, tilt=False)  # small models learn level flight in seconds


class StiffPD(nn.Module):
    """A source controller stiff enough to hold millimetres despite the dead band."""

    def forward(self, observation: Tensor) -> Tensor:  # noqa: D102
        velocity, rate, error = observation[..., :3], observation[..., 3:4], observation[..., 4:7]
        heading = torch.atan2(observation[..., 7:8], observation[..., 8:9])
        force = 8.0 * error - torch.tensor((1.0, 1.5, 0.5)) * velocity
        return torch.cat((force, 1.5 * heading - 0.25 * rate), -1).clamp(-1, 1)


@pytest.fixture(scope="session")
def policy() -> TensorDictModule:
    return TensorDictModule(StiffPD(), in_keys=["observation"], out_keys=["action"])


@pytest.fixture(scope="session")
def task() -> StationKeeping:
    return TASK


@pytest.fixture(scope="session")
def vehicle() -> Vehicle:
    return load_vehicle("paper")


@pytest.fixture(scope="session")
def models(vehicle) -> SourceModels:
    return pretrain(vehicle, TASK, PretrainingConfig(transitions=4000, iterations=150))


@pytest.fixture(scope="session")
def scenario(vehicle) -> Callable[[str], Scenario]:
    def read(name: str) -> Scenario:
        return read_scenario(name, yaml.safe_load(config_path("scenario", name).read_text()), vehicle)

    return read


@pytest.fixture(scope="session")
def true_map(vehicle, models) -> Callable[[Scenario], Tensor]:
    """What one unit of each thruster's full thrust really does, in source channels (4, n)."""
    per_command = controlled_allocation(tensors(vehicle)).float()
    return lambda s: torch.linalg.solve(
        per_command @ models.actuation.mixer, controlled_allocation(tensors(s.vehicle_at(vehicle))).float()
    )


@pytest.fixture(scope="session")
def fleet(vehicle) -> Callable[..., TorchFleet]:
    def make(num_envs: int, scenario: Scenario | None = None, thrusters: bool = False, seed: int = 0) -> TorchFleet:
        task = replace(TASK.for_evaluation(box_m=1.0), thruster_commands=thrusters)
        return TorchFleet(vehicle, task, num_envs, scenario=scenario, seed=seed)

    return make
