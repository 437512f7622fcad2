"""Random signs that are added to commands while a map is uncertain; a saved flight goes on with the same ones."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn


class Dither(nn.Module):
    """Draws signs; the state of its generator is in ``state_dict``, and the signs where they are held.

    Args:
        seed: of the generator.
        steps: control steps for which signs are held.
    """

    def __init__(self, seed: int, steps: int = 1):
        super().__init__()
        self.generator = torch.Generator().manual_seed(seed)
        self.steps = steps
        self._left, self._held = 0, torch.zeros(0, dtype=torch.long)

    def signs(self, shape: Sequence[int]) -> Tensor:
        """-1 or 1, whole numbers on the CPU."""
        if not self._left or self._held.numel() != math.prod(shape):
            self._held = torch.randint(0, 2, tuple(shape), generator=self.generator) * 2 - 1
            self._left = self.steps
        self._left -= 1
        return self._held.reshape(tuple(shape))

    def get_extra_state(self) -> Tensor:
        """State of the generator; behind it the signs that are held, and for how many steps more."""
        state = self.generator.get_state()
        if not self._left:
            return state
        held = (self._held.flatten() > 0).to(state)
        return torch.cat((state, torch.tensor((self._left % 256, self._left // 256)).to(state), held))

    def set_extra_state(self, state: Tensor) -> None:
        """Take up the signs where they were; called by ``load_state_dict``."""
        state, length = state.cpu(), len(self.generator.get_state())
        self.generator.set_state(state[:length])
        low, high, *held = (state[length:] if len(state) > length else torch.zeros(2)).tolist()
        self._left, self._held = int(low + 256 * high), torch.tensor(held, dtype=torch.long) * 2 - 1
