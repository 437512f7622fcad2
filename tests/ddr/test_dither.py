"""Signs of the dither: held for some steps, and the same again from where they were saved."""

import pytest
import torch

from auv_torchrl.ddr.dither import Dither


@pytest.mark.parametrize("steps", [1, 3, 300])
def test_signs_are_held_for_as_many_steps(steps):
    """And drawn anew then, from the same generator whatever the steps."""
    held, each = Dither(7, steps), Dither(7)
    for _ in range(3):
        drawn = each.signs((2, 3))
        assert all(torch.equal(held.signs((2, 3)), drawn) for _ in range(steps))


@pytest.mark.parametrize(("steps", "before"), [(1, 4), (3, 4), (3, 6), (300, 4)])
def test_saved_signs_go_on(steps, before):
    """In the middle of a held direction, too."""
    dither, again = Dither(7, steps), Dither(0, steps)
    for _ in range(before):
        dither.signs((2, 3))
    again.load_state_dict(dither.state_dict())
    for _ in range(7):
        assert torch.equal(again.signs((2, 3)), dither.signs((2, 3)))
