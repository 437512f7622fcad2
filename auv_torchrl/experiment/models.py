"""F and R of a source vehicle, trained once and kept beside its policies."""

import logging
from dataclasses import asdict
from pathlib import Path

from safetensors.torch import load_file, save_file

from auv_torchrl.agents.checkpoint import CheckpointError
from auv_torchrl.agents.policy import fingerprint
from auv_torchrl.agents.train_source import locked
from auv_torchrl.ddr import PretrainingConfig, SourceModels, pretrain
from auv_torchrl.envs import RegulationTask
from auv_torchrl.vehicle import Vehicle

log = logging.getLogger(__name__)


def source_models(vehicle: Vehicle, task: RegulationTask, folder: Path) -> SourceModels:
    """Trained F and R, taken from ``folder`` if they were trained before for the same vehicle and task.

    Of several processes that want the same ones, one trains and the others wait.

    Raises:
        CheckpointError: if the kept file is damaged.
    """
    config = PretrainingConfig()
    ingredients = {
        "vehicle": {name: value.tolist() for name, value in vehicle.items()},
        "task": asdict(task),
        "pretraining": asdict(config),
    }
    path = folder / f"{fingerprint(ingredients)}.models.safetensors"
    folder.mkdir(parents=True, exist_ok=True)
    with locked(path.with_suffix(".lock")):
        if path.exists():
            log.info("F and R: taken from %s, trained before", path)
            return _load(path, SourceModels(vehicle, task, config.hidden))
        models = pretrain(vehicle, task, config)
        partial = path.with_suffix(".partial")
        save_file({name: tensor.clone() for name, tensor in models.state_dict().items()}, partial)
        partial.replace(path)
    return models


def _load(path: Path, models: SourceModels) -> SourceModels:
    try:
        models.load_state_dict(load_file(path))
    except Exception as error:  # safetensors and torch each raise their own
        raise CheckpointError(
            f"F and R in {path} are damaged ({error}): delete the file to train them again"
        ) from error
    return models.requires_grad_(False)
