"""A flight by the files of an export, without torch."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
import torch
from torchrl.envs import TransformedEnv

from auv_torchrl.agents.policy import save_policy
from auv_torchrl.ddr.store import ADAPTER, save_adapter
from auv_torchrl.envs import make_fleet
from auv_torchrl.export.contract import CONTRACT, ContractError, write_export
from auv_torchrl.export.flight import ExportedPolicy
from auv_torchrl.export.job import Asked, described
from auv_torchrl.paths import PROJECT
from tests.command_lines import answers_of
from tests.export.conftest import drawn

STEPS = 60
BLOCKED = """
import json, sys
from importlib.abc import MetaPathFinder

class Blocked(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.partition(".")[0] in {"torch", "torchrl", "tensordict", "mujoco", "dm_control", "hydra"}:
            raise ModuleNotFoundError(f"{name} is blocked")

sys.meta_path.insert(0, Blocked())
from auv_torchrl.export.flight import ExportedPolicy
given = json.load(sys.stdin)
pilot = ExportedPolicy(given.pop("folder"))
print(json.dumps(pilot.command(**given).tolist()))
"""


@pytest.fixture(scope="module", params=["short", "long"])
def exported(request, tmp_path_factory):
    """A policy and an adapter as a run leaves them, and the folder of their export; the short form by the command."""
    given = drawn("paper", "affine", request.param)
    folder = tmp_path_factory.mktemp("export")
    if request.param == "long":
        write_export(folder, *described(Asked(given.policy, given.task, given.vehicle, given.adapter, True)))
        return given, folder
    key = given.policy.metadata["hash"]
    save_policy(given.policy, folder / "policies" / key)
    run = folder / "run"
    run.mkdir()
    (run / "results.json").write_text(json.dumps({"policy": key}))
    (run / "config.yaml").write_text(f"policies: {folder / 'policies'}\n")
    save_adapter(given.adapter, key, run / ADAPTER)
    line = [f"policy={run}", f"output={folder / 'out'}"]
    ((code, _, errors),) = answers_of("auv_torchrl.export.command", {"it": line}).values()
    assert code == 0, errors
    return given, folder / "out"


@pytest.fixture(scope="module")
def pilot(exported):
    """Who flies it."""
    return ExportedPolicy(exported[1])


def states(count):
    """Of vehicles, as keywords."""
    generator = np.random.default_rng(3)
    quaternion = generator.normal(size=(count, 4))
    return {
        "position": generator.normal(size=(count, 3)),
        "quaternion": quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True),
        "velocity": 0.3 * generator.normal(size=(count, 6)),
        "time_s": np.zeros(count),
    }


@torch.no_grad()
def by_torch(given, position, quaternion, velocity, time_s):
    """The command as a fleet in simulation is given it."""
    parts = [torch.from_numpy(part) for part in (position, quaternion, velocity, time_s)]
    action = given.policy.module.module(given.task.observe(*parts).float())
    return given.adapter.translate(given.adapter.models.state_of(*parts[1:3]).float(), action).numpy()


def test_its_commands_are_those_of_the_simulation(exported, pilot):
    """Observation, policy, F, R, and H with what the adapter has learnt."""
    expected = by_torch(exported[0], **states(50))
    assert np.abs(pilot.command(**states(50)) - expected).max() < 1e-5
    assert np.abs(expected).max() > 0.3 and pilot.outputs == 4


def test_it_is_flown_where_there_is_no_torch(exported):
    """In a process that cannot import torch, torchrl, tensordict, mujoco or hydra: the same commands."""
    given, folder = exported
    content = json.dumps({"folder": str(folder), **{name: value.tolist() for name, value in states(5).items()}})
    environment = {**os.environ, "PYTHONPATH": str(PROJECT), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", BLOCKED]
    run = subprocess.run(command, input=content, capture_output=True, text=True, cwd=folder, env=environment)
    assert run.returncode == 0, run.stderr
    assert np.abs(np.array(json.loads(run.stdout)) - by_torch(given, **states(5))).max() < 1e-5


def test_a_flight_with_it_is_that_with_the_policy(exported, pilot):
    """Position by position, in the simulator."""
    given, _ = exported
    fleet = make_fleet("torch", given.vehicle, given.task, num_envs=3, seed=0)
    adapted = make_fleet("torch", given.vehicle, given.task, num_envs=3, seed=0)
    expected = TransformedEnv(adapted, given.adapter).rollout(STEPS, given.policy.module, break_when_any_done=False)
    given.adapter.reset_parent()
    now = fleet.reset()
    for step in range(STEPS):
        measured = {name: now["measured", name].numpy() for name in ("position", "quaternion", "velocity")}
        command = pilot.command(**measured, time_s=now["along"][:, 0].numpy())
        now = fleet.step(now.set("action", torch.from_numpy(command.astype(np.float32))))["next"]
        assert (now["position"] - expected["next", "position"][:, step]).abs().max() < 1e-3


@pytest.mark.parametrize("part", ["position", "quaternion", "velocity", "time_s"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_measurement_that_is_no_number_makes_its_own_vehicle_neutral(pilot, part, value):
    """The others fly on."""
    given = states(3)
    before = pilot.command(**given)
    given[part][1] = value
    after = pilot.command(**given)
    assert (after[1] == 0).all() and (after[[0, 2]] == before[[0, 2]]).all()


def test_without_a_changed_vehicle_the_policy_is_flown_as_it_was_trained(tmp_path):
    """Its actions are the commands, whatever the map of the source vehicle makes of its limits."""
    given = drawn("paper", "affine")
    write_export(tmp_path, *described(Asked(given.policy, given.task, given.vehicle, given.adapter, False)))
    pilot = ExportedPolicy(tmp_path)
    assert (pilot.command(**states(20)) == pilot.action(pilot.observe(**states(20)))).all()


def test_the_contract_names_every_number(exported):
    """Name, unit and shape of each column, the rate, the frames and the limits."""
    contract = json.loads((exported[1] / CONTRACT).read_text())
    assert set(contract["files"]) == {"policy", "F", "R", "intended", "G", "H"}
    for told in contract["files"].values():
        for array in (*told["inputs"], *told["outputs"]):
            assert "from" in array or all(entry["name"] and entry["unit"] for entry in array["entries"])
    assert contract["rate_hz"] == 20.0 and contract["control_dt_s"] == 0.05
    assert (
        contract["adapter"]["fitted"] and contract["adapter"]["composition"] == exported[0].adapter.config.composition
    )
    assert contract["frames"]["earth"].startswith("NED") and contract["limits"]["command"] == [-1.0, 1.0]


def test_a_file_of_another_export_is_refused(exported, tmp_path):
    """By its digest."""
    for path in exported[1].iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "policy.onnx").write_bytes((tmp_path / "R.onnx").read_bytes())
    with pytest.raises(ContractError, match="not the file of its contract"):
        ExportedPolicy(tmp_path)
    (tmp_path / "policy.onnx").unlink()
    with pytest.raises(ContractError, match="incomplete"):
        ExportedPolicy(tmp_path)
    with pytest.raises(ContractError, match=r"give the folder that auv-export policy=\.\.\. wrote"):
        ExportedPolicy(tmp_path / "nowhere")
