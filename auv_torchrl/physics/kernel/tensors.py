"""What compiled code must know of torch's tensors; imported where some come in, so that numpy needs no torch."""

import torch
from torch import Tensor

from auv_torchrl.physics.kernel.adjoint import DifferentiableSteps

__all__ = ["DifferentiableSteps", "differentiated", "in_plain_memory"]


def in_plain_memory(*tensors: Tensor) -> bool:
    """Whether tensors are on the CPU and not mapped over."""
    return not torch.compiler.is_compiling() and all(
        tensor.is_cpu and not torch._C._functorch.is_functorch_wrapped_tensor(tensor)  # pyright: ignore[reportAttributeAccessIssue]
        for tensor in tensors
    )


def differentiated(*tensors: Tensor) -> bool:
    """Whether gradients by any of the tensors are wanted."""
    return torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors)
