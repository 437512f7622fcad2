"""What compiled code must know of torch's tensors; imported where some come in, so that numpy needs no torch."""

import torch
from torch import Tensor

from auv_torchrl.physics.kernel.adjoint import DifferentiableSteps

__all__ = ["DifferentiableSteps", "differentiated", "in_plain_memory"]


def in_plain_memory(*tensors: Tensor) -> bool:
    """Whether tensors are on the CPU and not mapped over."""
    return not torch.compiler.is_compiling() and all(tensor.is_cpu and _has_storage(tensor) for tensor in tensors)


def _has_storage(tensor: Tensor) -> bool:
    """Whether numbers of a tensor lie in memory: those that ``torch.func`` maps over or differentiates have none."""
    try:
        tensor.data_ptr()
    except RuntimeError:  # what torch says where there is none; it has no question for it
        return False
    return True


def differentiated(*tensors: Tensor) -> bool:
    """Whether gradients by any of the tensors are wanted."""
    return torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors)
