"""Exports of policies of vehicles that steer by turning: axes, motion and limits follow from the vehicle."""

import json

import numpy as np
import pytest
import torch

from auv_torchrl.export.contract import CONTRACT, write_export
from auv_torchrl.export.flight import ExportedPolicy
from auv_torchrl.export.job import Asked, described
from auv_torchrl.fly.flyer import Flyer
from auv_torchrl.tasks import Cruise
from tests.export.conftest import drawn

AXES = {"remus100": ["surge", "pitch", "yaw"], "otter": ["surge", "yaw"]}


def states(count):
    """Of vehicles under way, as keywords."""
    generator = np.random.default_rng(3)
    quaternion = generator.normal(size=(count, 4)) * 0.2 + [1.0, 0.0, 0.0, 0.0]
    return {
        "position": generator.normal(size=(count, 3)),
        "quaternion": quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True),
        "velocity": 0.3 * generator.normal(size=(count, 6)) + [1.5, 0, 0, 0, 0, 0],
        "time_s": np.zeros(count),
    }


@pytest.mark.parametrize(
    ("name", "kind", "composition"),
    [("remus100", "affine", "long"), ("remus100", "thrusters", "short"), ("otter", "network", "long")],
)
@torch.no_grad()
def test_commands_are_those_of_the_simulation(name, kind, composition, tmp_path):
    """Through policy, F, R and H, or what an action intends; the contract names the axes and the motion in order."""
    given = drawn(name, kind, composition, Cruise())
    write_export(tmp_path, *described(Asked(given.policy, given.task, given.vehicle, given.adapter, True)))
    pilot, seen = ExportedPolicy(tmp_path), states(40)
    position, quaternion, velocity, time = (torch.from_numpy(part) for part in seen.values())
    action = given.policy.module.module(given.task.observe(position, quaternion, velocity, time).float())
    state = given.adapter.models.state_of(quaternion, velocity).float()
    expected = given.adapter.translate(state, action).numpy()
    found = pilot.command(**seen)
    assert np.abs(found - expected).max() < 1e-5 and np.abs(expected).max() > 0.2
    assert pilot.thrusters(found).shape == (40, given.vehicle.thrusters)
    contract = json.loads((tmp_path / CONTRACT).read_text())
    assert [entry["name"] for entry in contract["files"]["policy"]["outputs"][0]["entries"]] == AXES[name]
    for told in contract["files"].values():
        for array in (*told["inputs"], *told["outputs"]):
            assert "from" in array or all(entry["name"] and entry["unit"] for entry in array["entries"])


def test_ardusub_is_not_steered_along_other_axes(tmp_path):
    """The sentence says which axes there are."""
    given = drawn("otter", "affine", task=Cruise())
    write_export(tmp_path, *described(Asked(given.policy, given.task, given.vehicle, given.adapter, False)))
    with pytest.raises(ValueError, match="commands surge, yaw, and ArduSub takes surge, sway, heave, yaw"):
        Flyer(tmp_path)
