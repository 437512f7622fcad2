"""Which tensors compiled code can read."""

import torch
from torch import Tensor


def in_plain_memory(*tensors: Tensor) -> bool:
    """Whether tensors are on the CPU and not mapped over."""
    return not torch.compiler.is_compiling() and all(
        tensor.is_cpu and not torch._C._functorch.is_functorch_wrapped_tensor(tensor)  # pyright: ignore[reportAttributeAccessIssue]
        for tensor in tensors
    )


def differentiated(*tensors: Tensor) -> bool:
    """Whether gradients by any of the tensors are wanted."""
    return torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors)
