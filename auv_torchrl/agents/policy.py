"""Trained policies as files: safetensors beside readable JSON, under a hash of everything that shaped them."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safetensors.torch import load_file, save_file
from tensordict.nn import TensorDictModule

from auv_torchrl.agents.networks import make_policy

TRAINING_VERSION = 1  # raise it when a change of the training makes old policies stale
WEIGHTS, READABLE = "policy.safetensors", "policy.json"


class PolicyError(ValueError):
    """A kept policy that cannot be used; the message says what to do."""


@dataclass(frozen=True)
class SourcePolicy:
    """A policy, observation -> action, deterministic outside exploration, and what shaped it."""

    module: TensorDictModule
    metadata: dict[str, Any]  # "hash", "ingredients", "network", "result", "curve"


def fingerprint(ingredients: Mapping[str, Any]) -> str:
    """Hash of readable ingredients, the same on every machine."""
    text = json.dumps({"training_version": TRAINING_VERSION, **ingredients}, sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def save_policy(policy: SourcePolicy, folder: Path, partial: Path | None = None) -> None:
    """Write a policy to ``folder``, which appears only when it is complete.

    Args:
        policy: what to write.
        folder: where it is found afterwards.
        partial: folder that is renamed to ``folder``, with what else is in it; None makes one.

    Raises:
        FileExistsError: if the folder is there already.
    """
    if folder.exists():
        raise FileExistsError(f"policy folder {folder} exists: choose another or move it away")
    partial = partial or folder.with_name(f"{folder.name}.partial-{os.getpid()}")
    partial.mkdir(parents=True, exist_ok=True)
    save_file({name: tensor.contiguous() for name, tensor in policy.module.state_dict().items()}, partial / WEIGHTS)
    (partial / READABLE).write_text(json.dumps(policy.metadata, indent=2) + "\n")
    partial.rename(folder)


def load_policy(folder: Path) -> SourcePolicy:
    """Read what :func:`save_policy` wrote.

    Raises:
        FileNotFoundError: if there is no policy in the folder.
        PolicyError: if its files are damaged.
    """
    for name in (WEIGHTS, READABLE):
        if not (folder / name).is_file():
            raise FileNotFoundError(f"no policy in {folder}: {name} is missing; train one first")
    try:
        metadata = json.loads((folder / READABLE).read_text())
        module = make_policy(**metadata["network"])
        module.load_state_dict(load_file(folder / WEIGHTS))
    except Exception as error:  # json, safetensors and torch each raise their own
        raise PolicyError(f"policy in {folder} is damaged ({error}): move the folder away to train it again") from error
    return SourcePolicy(module.eval(), metadata)
