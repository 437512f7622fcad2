"""F and R on disk, under a hash of everything that shaped them, so that they are trained once per source vehicle.

What a run has learnt of a changed vehicle, a whole adapter, is kept beside its results.
"""

import json
import logging
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from safetensors import safe_open
from safetensors.torch import save
from torch import Tensor

from auv_torchrl.agents.policy import fingerprint
from auv_torchrl.agents.storage import all_finite, digest, storing
from auv_torchrl.ddr.adapter import DDRAdapter
from auv_torchrl.ddr.config import AdapterConfig
from auv_torchrl.ddr.models import SourceModels
from auv_torchrl.ddr.pretraining import PretrainingConfig, pretrain
from auv_torchrl.files import write_whole
from auv_torchrl.tasks import Task, cruise_speed
from auv_torchrl.vehicle import Vehicle
from auv_torchrl.vehicle.changed_file import described

log = logging.getLogger(__name__)

ADAPTER = "adapter.safetensors"  # in the folder of a run
MODELS_VERSION = 3  # raise it when a change of the models or their training makes old ones stale


def load_or_pretrain(
    vehicle: Vehicle, task: Task, folder: Path, config: PretrainingConfig | None = None
) -> SourceModels:
    """F and R of a source vehicle, from ``folder`` if they were trained before, else trained and kept there.

    Args:
        vehicle: the nominal vehicle (empty batch).
        task: whose control step they predict, and whether the vehicle tilts.
        folder: the store, e.g. ``outputs/policies``; made if missing.
        config: data and fit.

    Raises:
        ValueError: if the file in the store is damaged, changed since it was written, or of a version without digest.
        StorageError: if the store is full or may not be written.
    """
    config = config or PretrainingConfig()
    shaping = ingredients(vehicle, task, config)
    path = folder / f"{fingerprint(shaping)}.models.safetensors"
    models = SourceModels(vehicle, task, config.hidden).requires_grad_(False)
    if path.exists():
        models.load_state_dict(_read(path, shaping, models.state_dict()))
        log.info("F and R: taken from %s, trained before", path)
        return models
    with storing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(path.with_suffix(".try"), b"room?")  # before a minute of training
        path.with_suffix(".try").unlink()
        models = pretrain(vehicle, task, config)
        tensors = {name: tensor.contiguous() for name, tensor in models.state_dict().items()}
        if not all_finite(tensors):
            raise ValueError("F and R have weights that are no finite numbers: they are not kept; use another seed")
        write_whole(path, save(tensors, {"ingredients": json.dumps(shaping), "digest": digest(tensors, shaping)}))
    log.info("F and R: kept in %s", path)
    return models


def save_adapter(adapter: DDRAdapter, policy: str, path: Path) -> None:
    """Write an adapter with F, R, G, H and what it has learnt.

    Args:
        adapter: on the CPU.
        policy: hash of the source policy that it maps.
        path: of the file.
    """
    tensors = {name: tensor.contiguous() for name, tensor in adapter.state_dict().items()}
    settings = {"policy": policy, "config": asdict(adapter.config), "hidden": adapter.models.hidden}
    settings["count"] = adapter.count
    write_whole(path, save(tensors, {"settings": json.dumps(settings), "digest": digest(tensors, settings)}))


def load_adapter(path: Path, policy: str, vehicle: Vehicle, task: Task) -> DDRAdapter:
    """What :func:`save_adapter` wrote.

    Args:
        path: of the file.
        policy: hash of the source policy that it has to map.
        vehicle: the source vehicle (empty batch).
        task: of the policy.

    Raises:
        ValueError: for a file that is damaged, changed, or the adapter of another policy.
    """
    try:
        with safe_open(path, "pt") as file:
            kept = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        settings = json.loads(kept["settings"])
        if kept["digest"] != digest(tensors, settings):
            raise ValueError("it was changed: its digest differs")
        models = SourceModels(vehicle, task, settings["hidden"]).requires_grad_(False)
        adapter = DDRAdapter(models, AdapterConfig(**settings["config"]), settings.get("count", 1))
        if settings["policy"] == policy:
            adapter.load_state_dict(tensors)
    except Exception as error:  # safetensors, json and torch each raise their own
        cause = " ".join(str(error).split())[:200]
        raise ValueError(f"adapter {path} cannot be used ({cause}): give the {ADAPTER} of a run") from error
    if settings["policy"] != policy:
        raise ValueError(
            f"adapter {path} maps the policy {settings['policy']}, this one is {policy}: give the adapter of its run"
        )
    return adapter


def _read(path: Path, shaping: Mapping[str, Any], shape: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The weights in a file, which must be those that were kept for these ingredients."""
    try:
        with safe_open(path, "pt") as file:
            kept = file.metadata() or {}
            weights = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        if {n: t.shape for n, t in weights.items()} != {n: t.shape for n, t in shape.items()}:
            raise ValueError("its weights are those of other networks")
        if "digest" not in kept:
            raise ValueError("it has no digest: it is of an earlier version, whether it was changed cannot be told")
        if kept["digest"] != digest(weights, shaping):
            raise ValueError("it was changed: its digest differs")
        if not all_finite(weights):
            raise ValueError("it holds weights that are no finite numbers")
    except Exception as error:  # safetensors raises its own
        cause = " ".join(str(error).split())[:200]
        raise ValueError(f"models {path} are damaged ({cause}): move the file away to train them again") from error
    return weights


def ingredients(vehicle: Vehicle, task: Task, config: PretrainingConfig) -> Mapping[str, Any]:
    """Everything that shapes F and R, as plain values."""
    trained_on: dict[str, Any] = {
        key: getattr(task, key) for key in ("control_dt", "tilt", "start_speed", "start_yaw_rate")
    }
    if speed := cruise_speed(task):  # left out of a task that hovers, so that models kept before are found
        trained_on |= {"axes": list(task.axes), "speed": speed}
    return {
        "models_version": MODELS_VERSION,
        "vehicle": described(vehicle),
        "task": trained_on,
        "pretraining": asdict(config),
    }
