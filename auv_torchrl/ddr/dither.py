"""Random signs that are added to commands while a map is uncertain; a saved flight goes on with the same ones."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn


class Dither(nn.Module):
    """Draws signs; the state of its generator is in ``state_dict``."""

    def __init__(self, seed: int):
        super().__init__()
        self.generator = torch.Generator().manual_seed(seed)

    def signs(self, shape: Sequence[int]) -> Tensor:
        """-1 or 1, whole numbers on the CPU."""
        return torch.randint(0, 2, tuple(shape), generator=self.generator) * 2 - 1

    def get_extra_state(self) -> Tensor:
        """State of the generator."""
        return self.generator.get_state()

    def set_extra_state(self, state: Tensor) -> None:
        """Take up the signs where they were; called by ``load_state_dict``."""
        self.generator.set_state(state.cpu())
