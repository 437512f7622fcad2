"""Exports of policies that nobody has trained: their weights are drawn."""

import importlib.util
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import torch

from auv_torchrl.agents.networks import make_policy
from auv_torchrl.agents.policy import SourcePolicy, fingerprint
from auv_torchrl.ddr.adapter import DDRAdapter
from auv_torchrl.ddr.config import AdapterConfig
from auv_torchrl.ddr.models import Regressor, SourceModels
from auv_torchrl.ddr.network import NetworkMap
from auv_torchrl.effects.effect import changed
from auv_torchrl.tasks import StationKeeping, Task, fitted
from auv_torchrl.vehicle import Vehicle, load_vehicle
from auv_torchrl.vehicle.changed_file import described

MISSING = [name for name in ("onnx", "onnxruntime") if importlib.util.find_spec(name) is None]
EXTRAS = "pip install 'auv_torchrl[export,fly]'"


def pytest_collection_modifyitems(items):
    """Skip what needs the libraries where they are missing."""
    for item in items:
        if MISSING and "tests/export/" in item.nodeid and "without_the_library" not in item.nodeid:
            item.add_marker(pytest.mark.skip(reason=f"{' and '.join(MISSING)} not installed: {EXTRAS}"))


@dataclass(frozen=True)
class Drawn:
    """A policy and an adapter with drawn weights."""

    vehicle: Vehicle
    task: Task
    policy: SourcePolicy
    adapter: DDRAdapter


def drawn(
    vehicle_name: str, kind: str, composition: str = "short", task: Task | None = None, **fields: np.ndarray
) -> Drawn:
    """Of a vehicle, with a map of that kind that has changed; a task other than to keep station is fitted to it."""
    vehicle = changed(load_vehicle(vehicle_name), **fields)
    task = fitted(task or StationKeeping(), vehicle)
    with torch.random.fork_rng(devices=()), torch.no_grad():
        torch.manual_seed(7)
        network: dict[str, Any] = {"observations": len(task.observation_names), "hidden": [64, 64]}
        network["actions"] = len(task.axes)
        ingredients = {"vehicle": described(vehicle), "task": task.described()}
        metadata = {"hash": fingerprint(ingredients), "ingredients": ingredients, "network": network}
        models = SourceModels(vehicle, task).requires_grad_(False)
        for regressor in (models.F.change, models.R.control):
            _spread(regressor)
        adapter = DDRAdapter(models, AdapterConfig(map=kind, composition=composition))
        adapter.g.weight.mul_(1 + 0.3 * torch.randn(adapter.g.weight.shape))
        adapter.g.bias.add_(0.1 * torch.randn(len(task.axes)))
        if isinstance(adapter.g, NetworkMap):
            for parameter in (*adapter.g.g.parameters(), *adapter.g.h.parameters()):
                parameter.add_(0.1 * torch.randn(parameter.shape))
        return Drawn(vehicle, task, SourcePolicy(make_policy(**network).eval(), metadata), adapter)


def _spread(regressor: Regressor) -> None:
    """Means and scales as of data."""
    regressor.input_mean.normal_()
    regressor.output_mean.normal_(std=0.1)
    regressor.input_scale.uniform_(0.5, 2.0)
    regressor.output_scale.uniform_(0.1, 0.5)


@pytest.fixture(scope="session")
def affine():
    """The paper's vehicle, its four channels mapped."""
    return drawn("paper", "affine")
