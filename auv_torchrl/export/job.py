"""What ``auv-export`` does once its command line is read."""

import json
import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from omegaconf import DictConfig, OmegaConf

from auv_torchrl import __version__
from auv_torchrl.agents.networks import TanhPolicy
from auv_torchrl.agents.policy import READABLE, SourcePolicy, load_policy
from auv_torchrl.agents.storage import StorageError
from auv_torchrl.command import Run, checking_input
from auv_torchrl.ddr.adapter import DDRAdapter
from auv_torchrl.ddr.network import NetworkMap
from auv_torchrl.ddr.store import ADAPTER, load_adapter, load_or_pretrain
from auv_torchrl.export.contract import CONTRACT, FRAMES, TILT, entries, motion_name, unit_of, write_export
from auv_torchrl.export.maps import command_graph, effect_graph
from auv_torchrl.export.networks import forward_graph, intended_graph, inverse_graph, policy_graph
from auv_torchrl.export.schema import ExportSchema
from auv_torchrl.extras import library
from auv_torchrl.settings import check
from auv_torchrl.simulator.base import FARTHEST, FASTEST
from auv_torchrl.tasks import Task, read_task
from auv_torchrl.vehicle import Vehicle, index_of, without_entry
from auv_torchrl.vehicle.fields import VEHICLE_FIELDS

log = logging.getLogger("export")

RESULTS = "results.json"


@dataclass(frozen=True)
class Asked:
    """What is to be exported."""

    policy: SourcePolicy
    task: Task
    vehicle: Vehicle  # the source
    adapter: DDRAdapter | None  # None where actions are thruster commands, which DDR does not map
    fitted: bool  # whether the adapter has learnt of a changed vehicle


def export(config: DictConfig, run: Run) -> None:
    """Write the files and the contract."""
    torch.set_num_threads(1)
    with checking_input((ValueError, KeyError, FileNotFoundError, StorageError)):
        library("onnx", "auv-export needs", "export")
        asked = read_asked(config)
        files, about = described(asked)
    folder = run.folder
    write_export(folder, files, about)
    log.info("%s", summary(asked, files))
    log.info("%s and the files that it describes are in %s", CONTRACT, folder)


def read_asked(config: DictConfig) -> Asked:
    """Find the policy, the vehicle and the task that it was trained for, and what was learnt in flight.

    Raises:
        ValueError: for what is no policy or run, or an adapter of another policy.
    """
    content: Any = OmegaConf.to_container(config, resolve=True)
    check(ExportSchema, {"policy": content["policy"], "output": content["output"]})
    given = Path(content["policy"]).expanduser()
    folder, learnt = find_policy(given)
    if content["adapter"] is not None:
        learnt = Path(str(content["adapter"])).expanduser()
        if not learnt.is_file():
            raise ValueError(f"adapter={learnt} is no file: give the {ADAPTER} of a run")
    policy = load_policy(folder)
    shaped = policy.metadata["ingredients"]
    task, vehicle = read_task(shaped["task"]), source_vehicle(shaped["vehicle"])
    if task.thruster_commands:
        if learnt is not None:
            raise ValueError(f"adapter={learnt} maps channels, and the policy in {folder} commands thrusters itself")
        return Asked(policy, task, vehicle, None, False)
    if learnt is not None:
        return Asked(policy, task, vehicle, load_adapter(learnt, policy.metadata["hash"], vehicle, task), True)
    return Asked(policy, task, vehicle, DDRAdapter(load_or_pretrain(vehicle, task, folder.parent)), False)


def find_policy(given: Path) -> tuple[Path, Path | None]:
    """The folder of a policy, and the file of an adapter if there is one, from that folder or the one of a run.

    Raises:
        ValueError: for a folder that is neither.
    """
    if (given / READABLE).is_file():
        return given, None
    if not (given / RESULTS).is_file():
        raise ValueError(
            f"policy={given} holds no policy: give a folder of outputs/policies, or that of a run of auv-train"
        )
    key = json.loads((given / RESULTS).read_text())["policy"]
    policies = Path(OmegaConf.load(given / "config.yaml").policies)
    return policies / key, given / ADAPTER if (given / ADAPTER).is_file() else None


def source_vehicle(source: Mapping[str, Any]) -> Vehicle:
    """The vehicle that a policy was trained for, from what is kept with the policy; the rest does nothing."""
    n = len(source["gain"])
    return Vehicle(
        **{
            name: np.array(source[name], dtype=np.float64) if name in source else without_entry(kind, n)
            for name, kind in VEHICLE_FIELDS.items()
        }
    )


def described(asked: Asked) -> tuple[dict[str, bytes], dict[str, Any]]:
    """The files, and what the contract says of them and of how they are flown."""
    task, vehicle, adapter = asked.task, asked.vehicle, asked.adapter
    network = cast(TanhPolicy, asked.policy.module.module)
    channels: dict[str, str | None] = dict.fromkeys(task.axes, "1")
    thrusters: dict[str, str | None] = {f"thruster_{n}": "1" for n in range(1, vehicle.thrusters + 1)}
    action = thrusters if task.thruster_commands else channels
    observed = entries({name: unit_of(name) for name in task.observation_names})
    files = {"policy": policy_graph(network)}
    graphs = {"policy": _file({"observation": observed}, "action", entries(action, -1, 1))}
    command = action
    if adapter is not None:
        command = thrusters if adapter.config.map == "thrusters" else channels
        files |= map_files(adapter)
        graphs |= _files_of_maps(adapter, entries(channels, -1, 1), entries(command, -1, 1))
    about = {
        "made_by": f"auv_torchrl {__version__}",
        "policy": asked.policy.metadata["hash"],
        "task": {**task.described(), "name": task.name},
        "control_dt_s": task.control_dt,
        "rate_hz": 1.0 / task.control_dt,
        "frames": FRAMES,
        "normalizer": "none: the policy takes the observation in its units",
        "deterministic": True,
        "limits": {"farthest_m": FARTHEST, "fastest_m_s": FASTEST, "command": [-1.0, 1.0]},
        "vehicle": {
            "thrusters": vehicle.thrusters,
            "full_thrust_N": vehicle.full_thrust.tolist(),
            "mixed": command is channels,
            "mixer": vehicle.mixer[:, index_of(task.axes)].tolist(),
            "mixer_is": "thruster commands in [-1, 1] per channel: thrusters = clip(mixer @ command, -1, 1)",
        },
        "command": entries(command, -1, 1),
        "adapter": None if adapter is None else _adapter_entry(adapter, asked.fitted),
        "files": graphs,
    }
    return files, about


def map_files(adapter: DDRAdapter) -> dict[str, bytes]:
    """F, R, what an action intends, G and H."""
    models = adapter.models
    return {
        "F": forward_graph(models.F),
        "R": inverse_graph(models.R),
        "intended": intended_graph(models.actuation),
        "G": effect_graph(adapter.g, models.states),
        "H": command_graph(adapter.g, models.states),
    }


def _adapter_entry(adapter: DDRAdapter, fitted: bool) -> dict[str, Any]:
    learnt = "of a changed vehicle, in flight" if fitted else "nothing: it is that of the source vehicle"
    error = float(adapter.g.standard_error)  # infinite before the first fit
    networks = ["G", "H"] if isinstance(adapter.g, NetworkMap) else []
    return {
        "map": adapter.config.map,
        "composition": adapter.config.composition,
        "commands_are": "H(x, intended(u))" if adapter.config.composition == "short" else "H(x, R(x, F(x, u)))",
        "learnt": learnt,
        "fitted": fitted,
        "state": {"weight": adapter.g.weight.tolist(), "bias": adapter.g.bias.tolist()},
        "standard_error": error if math.isfinite(error) else None,
        "networks_within": networks,
    }


def _files_of_maps(adapter: DDRAdapter, action: list[Any], command: list[Any]) -> dict[str, Any]:
    names = [motion_name(axis) for axis in adapter.models.speeds] + (list(TILT) if adapter.models.tilt else [])
    state = entries({name: unit_of(name) for name in names})
    channels = [{"name": entry["name"], "unit": entry["unit"]} for entry in action]
    learnt = [
        {"name": "weight", "dtype": "float32", "shape": [len(action), len(command)], "from": "adapter.state.weight"},
        {"name": "bias", "dtype": "float32", "shape": [len(action)], "from": "adapter.state.bias"},
    ]
    graphs = {
        "F": _file({"state": state, "action": action}, "next_state", state),
        "R": _file({"state": state, "next_state": state}, "tau", channels),
        "intended": _file({"action": action}, "tau", channels),
        "G": _file({"state": state, "command": command}, "tau", channels),
        "H": _file({"state": state, "tau": channels}, "command", command),
    }
    for name in ("G", "H"):
        graphs[name]["inputs"] += learnt
    return graphs


def _file(inputs: Mapping[str, list[Any]], output: str, columns: list[Any]) -> dict[str, Any]:
    """What one file takes and gives; all have the batch first."""

    def entry_of(name: str, columns: list[Any]) -> dict[str, Any]:
        return {"name": name, "dtype": "float32", "shape": ["N", len(columns)], "entries": columns}

    return {"inputs": [entry_of(name, entry) for name, entry in inputs.items()], "outputs": [entry_of(output, columns)]}


def summary(asked: Asked, files: Mapping[str, bytes]) -> str:
    """What was written, in one sentence."""
    size = sum(map(len, files.values())) / 1e6
    what = f"policy {asked.policy.metadata['hash']} of task {asked.task.name}, {1 / asked.task.control_dt:g} Hz"
    if asked.adapter is None:
        return f"{what}: it commands the thrusters itself, there is nothing to map ({size:.1f} MB)"
    learnt = "as learnt in flight" if asked.fitted else "of the source vehicle"
    return f"{what}, with F, R and the maps G and H {learnt} ({size:.1f} MB)"
