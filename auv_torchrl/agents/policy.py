"""Trained policies as files: safetensors beside readable JSON, under a hash of everything that shaped them."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safetensors.torch import load_file, save
from tensordict.nn import TensorDictModule

from auv_torchrl.agents.networks import make_policy
from auv_torchrl.agents.storage import all_finite, digest
from auv_torchrl.files import write_whole

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
    """Write a policy to ``folder``, which appears only when it is complete; a digest in it tells when it was changed.

    Args:
        policy: what to write.
        folder: where it is found afterwards.
        partial: folder that is renamed to ``folder``, with what else is in it; None makes one.

    Raises:
        FileExistsError: if the folder is there already.
        PolicyError: for weights that are no numbers.
    """
    if folder.exists():
        raise FileExistsError(f"policy folder {folder} exists: choose another or move it away")
    weights = {name: tensor.cpu().contiguous() for name, tensor in policy.module.state_dict().items()}
    if not all_finite(weights):
        raise PolicyError("the policy has weights that are no finite numbers: it is not kept; train another one")
    partial = partial or folder.with_name(f"{folder.name}.partial-{os.getpid()}")
    partial.mkdir(parents=True, exist_ok=True)
    readable = json.dumps({"digest": digest(weights, policy.metadata), **policy.metadata}, indent=2) + "\n"
    write_whole(partial / WEIGHTS, save(weights))
    write_whole(partial / READABLE, readable.encode())
    partial.rename(folder)


def load_policy(folder: Path, key: str | None = None) -> SourcePolicy:
    """Read what :func:`save_policy` wrote.

    Args:
        folder: where it is.
        key: the hash of the ingredients that it must have been trained from; None for whatever it is.

    Raises:
        FileNotFoundError: if there is no such folder.
        PolicyError: if its files are incomplete, damaged, changed since they were written, of another training, or
            from a version that kept no digest. They are left as they are.
    """
    if not folder.exists():
        raise FileNotFoundError(f"no policy in {folder}: train one first")
    for name in (WEIGHTS, READABLE):
        if not (folder / name).is_file():
            raise _unusable(folder, f"is incomplete: {name} is missing")
    try:
        metadata = json.loads((folder / READABLE).read_text(encoding="utf-8"))
        kept = metadata.pop("digest", None)
        weights = load_file(folder / WEIGHTS)
        same = kept == digest(weights, metadata)
        module = make_policy(**metadata["network"])
        module.load_state_dict(weights)
    except Exception as error:  # json, safetensors and torch each raise their own
        raise _unusable(folder, f"is damaged ({' '.join(str(error).split())[:200]})") from error
    if kept is None:
        raise _unusable(folder, "has no digest: it is of an earlier version, and whether it was changed cannot be told")
    if not same:
        raise _unusable(folder, "was changed: weights and settings are not those that were kept (the digest differs)")
    if not all_finite(weights):
        raise _unusable(folder, "has weights that are no finite numbers")
    if key is not None and (metadata.get("hash") != key or fingerprint(metadata.get("ingredients", {})) != key):
        raise _unusable(folder, f"is of another training ({metadata.get('hash')}, wanted is {key})")
    return SourcePolicy(module.eval(), metadata)


def _unusable(folder: Path, cause: str) -> PolicyError:
    return PolicyError(f"policy in {folder} {cause}: move the folder away to train it again")
