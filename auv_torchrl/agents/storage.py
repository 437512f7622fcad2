"""Files of the policy store: known again when they are read, checkpoints, and what is said where there is no room."""

import errno
import hashlib
import io
import json
import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from auv_torchrl.files import write_whole

_STORAGE = {  # what an operating system says of a folder that cannot hold files, rather than of a defect of ours
    errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.ENOTDIR,
    errno.EEXIST, errno.EISDIR,
}  # fmt: skip
log = logging.getLogger(__name__)
DIGEST = hashlib.sha256().digest_size  # bytes, at the end of the file


class StorageError(ValueError):
    """The store cannot hold what was to be kept; the message says what to do."""


def digest(tensors: Mapping[str, Tensor], settings: Mapping[str, Any]) -> str:
    """Hash of weights, to the bit, and of the settings beside them, as plain values."""
    summed = hashlib.sha256(json.dumps(settings, sort_keys=True).encode())
    for name in sorted(tensors):
        tensor = tensors[name].detach().cpu().contiguous()
        summed.update(f"{name} {tensor.dtype} {tuple(tensor.shape)} ".encode())
        summed.update(tensor.numpy().tobytes())
    return summed.hexdigest()


def all_finite(tensors: Mapping[str, Tensor]) -> bool:
    """Whether every weight is a finite number."""
    return all(bool(torch.isfinite(tensor).all()) for tensor in tensors.values())


@contextmanager
def storing(folder: Path, left: str = "") -> Iterator[None]:
    """Turn what the operating system says of a store that is full or may not be written into one line.

    Args:
        folder: the store.
        left: what is kept all the same, a sentence.

    Raises:
        StorageError: naming the folder, the cause and the remedy.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in _STORAGE:
            raise
        raise StorageError(
            f"nothing can be kept in {folder} ({error.strerror}): make room there or give a folder that you may write "
            f"with policies=DIR{left and f'; {left}'}"
        ) from error


class CheckpointError(RuntimeError):
    """A checkpoint that cannot be used; the message says what to do."""


def save_checkpoint(path: Path, fingerprint: str, state: Mapping[str, Any]) -> None:
    """Write ``state`` so that ``path`` holds either the old or the new checkpoint, whenever the process dies."""
    path.parent.mkdir(parents=True, exist_ok=True)
    file = io.BytesIO()  # torch names no cause where a disk is full
    torch.save({"fingerprint": fingerprint, "state": dict(state)}, file)
    content = file.getvalue()
    write_whole(path, content + hashlib.sha256(content).digest())


def load_checkpoint(path: Path, fingerprint: str) -> dict[str, Any]:
    """The state of a checkpoint that was written under the same fingerprint.

    Raises:
        CheckpointError: for a file that is missing, damaged, changed since it was written, or of another training.
    """
    try:
        whole = path.read_bytes()
        if hashlib.sha256(whole[:-DIGEST]).digest() != whole[-DIGEST:]:
            raise ValueError("its digest differs")
        content = torch.load(io.BytesIO(whole[:-DIGEST]), map_location="cpu", weights_only=True)
        found, state = content["fingerprint"], content["state"]
    except Exception as error:  # torch.load raises whatever its unpickler and its zip reader raise
        cause = str(error) if isinstance(error, ValueError | OSError) else type(error).__name__
        raise CheckpointError(
            f"checkpoint {path} cannot be read ({cause}): it is damaged, changed, of an earlier version or no "
            "checkpoint of ours; it is left as it is; move it away to train from the beginning"
        ) from error
    if found != fingerprint:
        raise CheckpointError(
            f"checkpoint {path} belongs to another training ({found}, this one is {fingerprint}): vehicle, task, "
            "randomization, agent settings, seed, backend or version differ; move it away to train from the beginning"
        )
    log.info("going on from checkpoint %s", path)
    return state
