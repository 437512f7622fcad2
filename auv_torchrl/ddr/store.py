"""F and R on disk, under a hash of everything that shaped them, so that they are trained once per source vehicle."""

import json
import logging
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from safetensors.torch import load_file, save_file

from auv_torchrl.agents.policy import fingerprint
from auv_torchrl.ddr.models import SourceModels
from auv_torchrl.ddr.pretraining import PretrainingConfig, pretrain
from auv_torchrl.envs import RegulationTask
from auv_torchrl.vehicle import Vehicle

log = logging.getLogger(__name__)

MODELS_VERSION = 2  # raise it when a change of the models or their training makes old ones stale


def load_or_pretrain(
    vehicle: Vehicle, task: RegulationTask, folder: Path, config: PretrainingConfig | None = None
) -> SourceModels:
    """F and R of a source vehicle, from ``folder`` if they were trained before, else trained and kept there.

    Args:
        vehicle: the nominal vehicle (empty batch).
        task: whose observation and control step they see.
        folder: the store, e.g. ``outputs/policies``; made if missing.
        config: data and fit.

    Raises:
        ValueError: if the file in the store is damaged.
    """
    config = config or PretrainingConfig()
    described = ingredients(vehicle, task, config)
    path = folder / f"{fingerprint(described)}.models.safetensors"
    if path.exists():
        models = SourceModels(vehicle, task, config.hidden).requires_grad_(False)
        try:
            models.load_state_dict(load_file(path))
        except Exception as error:  # safetensors and torch each raise their own
            raise ValueError(f"models {path} are damaged ({error}): move the file away to train them again") from error
        log.info("F and R: taken from %s, trained before", path)
        return models
    models = pretrain(vehicle, task, config)
    folder.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(f".partial-{os.getpid()}")
    tensors = {name: tensor.contiguous() for name, tensor in models.state_dict().items()}
    save_file(tensors, partial, metadata={"ingredients": json.dumps(described)})
    partial.replace(path)
    log.info("F and R: kept in %s", path)
    return models


def ingredients(vehicle: Vehicle, task: RegulationTask, config: PretrainingConfig) -> Mapping[str, Any]:
    """Everything that shapes F and R, as plain values."""
    return {
        "models_version": MODELS_VERSION,
        "vehicle": {name: value.tolist() for name, value in vehicle.items()},
        "task": {key: getattr(task, key) for key in ("control_dt", "tilt", "start_speed", "start_yaw_rate")},
        "pretraining": asdict(config),
    }
