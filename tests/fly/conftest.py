"""A policy that nobody has trained: its network is a controller of position and speed, so that it holds a vehicle."""

import importlib.util
from dataclasses import replace
from typing import Any

import pytest

MISSING = [name for name in ("onnx", "onnxruntime", "pymavlink") if importlib.util.find_spec(name) is None]


def pytest_collection_modifyitems(items):
    """Skip what needs the libraries where they are missing."""
    for item in items:
        if MISSING and "tests/fly/" in item.nodeid:
            item.add_marker(pytest.mark.skip(reason=f"{' and '.join(MISSING)} not installed"))


def steered(vehicle_name="bluerov2_heavy", task=None):
    """A policy for a vehicle: each channel pushes against its error and its speed."""
    import torch

    from auv_torchrl.agents.networks import make_policy
    from auv_torchrl.agents.policy import SourcePolicy, fingerprint
    from auv_torchrl.tasks import StationKeeping
    from auv_torchrl.vehicle import load_vehicle
    from auv_torchrl.vehicle.changed_file import described

    vehicle, task = load_vehicle(vehicle_name), task or StationKeeping()
    names = list(task.observation_names)
    gains = torch.zeros(4, len(names))
    for channel, (error, speed) in enumerate(
        (("error_x", "surge_speed"), ("error_y", "sway_speed"), ("error_z", "heave_speed"), ("yaw_sin", "yaw_rate"))
    ):
        error = next(name for name in names if name == error or (channel == 3 and name.endswith("sin")))
        speed = next(name for name in names if name == speed or (channel == 3 and name.startswith("yaw") and
                                                                  not name.endswith(("sin", "cos"))))  # fmt: skip
        gains[channel, names.index(error)], gains[channel, names.index(speed)] = 1.0, -0.5
    network: dict[str, Any] = {"observations": len(names), "actions": 4, "hidden": [8, 8]}
    policy: Any = make_policy(**network).eval()
    with torch.no_grad():
        linear = [layer for layer in policy.module.network if isinstance(layer, torch.nn.Linear)]
        for layer in linear:
            layer.weight.zero_()
            layer.bias.zero_()
        linear[0].weight.copy_(torch.cat((gains, -gains)))
        linear[1].weight.copy_(torch.eye(8))
        linear[2].weight[:4] = torch.cat((torch.eye(4), -torch.eye(4)), dim=1)
    ingredients = {"vehicle": described(vehicle), "task": task.described()}
    metadata = {"hash": fingerprint(ingredients), "ingredients": ingredients, "network": network}
    return SourcePolicy(policy, metadata), replace(task), vehicle


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    """The folder of the policy's export."""
    from auv_torchrl.export.contract import write_export
    from auv_torchrl.export.job import Asked, described

    policy, task, vehicle = steered()
    folder = tmp_path_factory.mktemp("export")
    write_export(folder, *described(Asked(policy, task, vehicle, None, False)))
    return folder
