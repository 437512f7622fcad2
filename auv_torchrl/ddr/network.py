"""G and H as affine maps with small state-dependent networks on top, for gaps that no affine map closes."""

import torch
from torch import Tensor, nn

from auv_torchrl.ddr.actuation import ControlSpace
from auv_torchrl.ddr.affine import AffineMap
from auv_torchrl.ddr.bag import Pairs

LEARNING_RATE = 1e-2
WEIGHT_DECAY = 1e-3


class NetworkMap(AffineMap):
    """G(x, tau_t) adds a network to the affine fit, H(x, tau_s) one to its inverse.

    The networks start as nothing and are trained for a fixed number of steps: G on Eq. 8, then H with G fixed on
    the cycle loss |H(x, G(x, tau_t)) - tau_t|.
    """

    def __init__(self, space: ControlSpace, ridge: float, states: int, hidden: int, steps: int, seed: int):
        super().__init__(space, ridge)
        self.steps = steps
        channels = space.nominal.shape[0]
        with torch.random.fork_rng(devices=()):
            torch.manual_seed(seed)
            self.g = _silent_network(states + space.size, hidden, channels)
            self.h = _silent_network(states + channels, hidden, space.size)
        self.requires_grad_(False)

    @property
    def weights(self) -> int:
        """n_p, the number of unknown weights of G."""
        return super().weights + sum(p.numel() for p in self.g.parameters())

    def forward(self, state: Tensor, control: Tensor) -> Tensor:
        """G: what controls (n, k) do in states (n, s), in source channels (n, a)."""
        return super().forward(state, control) + self.g(torch.cat((state, control), dim=-1))

    def invert(self, state: Tensor, tau: Tensor) -> Tensor:
        """H: controls (N, k) within limits for source channels (N, a) in states (N, s)."""
        return self.space.shrink(super().invert(state, tau) + self.h(torch.cat((state, tau), dim=-1)))

    def fit(self, pairs: Pairs) -> None:
        """Fit the affine part in closed form and silence the networks, which take longer to train."""
        super().fit(pairs)
        for parameter in (*self.g[-1].parameters(), *self.h[-1].parameters()):
            parameter.zero_()

    def refine(self, pairs: Pairs) -> None:
        """Train both networks on top of the affine fit."""
        self._train(pairs, self.steps)

    def gradient_step(self, pairs: Pairs, rate: float) -> None:
        """One gradient step of both networks over the bag."""
        self._train(pairs, 1)

    def _train(self, pairs: Pairs, steps: int) -> None:
        state, control, source = pairs
        left = source - AffineMap.forward(self, state, control)
        _descend(self.g, torch.cat((state, control), -1), left, steps)
        effect = self(state, control)
        back = (effect - self.bias) @ self.unlimited.mT  # the affine inverse, limits left out
        _descend(self.h, torch.cat((state, effect), -1), control - back, steps)


def _silent_network(inputs: int, hidden: int, outputs: int) -> nn.Sequential:
    """A network of one hidden layer whose output starts at zero."""
    last = nn.Linear(hidden, outputs)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    return nn.Sequential(nn.Linear(inputs, hidden), nn.Tanh(), last)


@torch.enable_grad()
def _descend(network: nn.Sequential, inputs: Tensor, targets: Tensor, steps: int) -> None:
    """Adam on the mean square error over all data."""
    network.requires_grad_(True)
    optimizer = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    for _ in range(steps):
        optimizer.zero_grad()
        (network(inputs) - targets).square().mean().backward()
        optimizer.step()
    network.requires_grad_(False)
