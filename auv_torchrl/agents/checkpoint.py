"""Checkpoints: one file, written at once or not at all, refused with a remedy where it does not fit."""

import logging
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

log = logging.getLogger(__name__)


class CheckpointError(RuntimeError):
    """A checkpoint that cannot be used; the message says what to do."""


def save_checkpoint(path: Path, fingerprint: str, state: Mapping[str, Any]) -> None:
    """Write ``state`` so that ``path`` holds either the old or the new checkpoint, whenever the process dies."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    try:
        with partial.open("wb") as file:
            torch.save({"fingerprint": fingerprint, "state": dict(state)}, file)
            file.flush()
            os.fsync(file.fileno())
    except BaseException:
        partial.unlink(missing_ok=True)  # on a full disk half a checkpoint takes the room of the next
        raise
    partial.replace(path)


def load_checkpoint(path: Path, fingerprint: str) -> dict[str, Any]:
    """The state of a checkpoint that was written under the same fingerprint.

    Raises:
        CheckpointError: for a file that is missing, damaged, or of another training.
    """
    if not path.is_file():
        raise CheckpointError(f"there is no checkpoint {path}: train without resume to start from the beginning")
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        found, state = content["fingerprint"], content["state"]
    except Exception as error:  # torch.load raises whatever its unpickler and its zip reader raise
        raise CheckpointError(
            f"checkpoint {path} cannot be read ({type(error).__name__}): it is damaged or no checkpoint of ours; "
            "it is left as it is; move it away to train from the beginning"
        ) from error
    if found != fingerprint:
        raise CheckpointError(
            f"checkpoint {path} belongs to another training ({found}, this one is {fingerprint}): vehicle, task, "
            "randomization, agent settings, seed, backend or version differ; resume with the settings it was made "
            "with, or train without resume to start from the beginning"
        )
    log.info("going on from checkpoint %s", path)
    return state
