"""Files of the policy store: recognised when they are read again, and one line where there is no room for them."""

import errno
import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

_STORAGE = {  # what an operating system says of a folder that cannot hold files, rather than of a defect of ours
    errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.ENOTDIR,
    errno.EEXIST, errno.EISDIR,
}  # fmt: skip


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
