"""The bag of newest pairs."""

import torch

from auv_torchrl.ddr.bag import Bag, Pairs, bag_size


def numbered(first, count, maps=1, filled=None):
    value = torch.arange(first, first + count, dtype=torch.float32).expand(maps, -1)[..., None]
    mask = torch.ones(maps, count, dtype=torch.bool) if filled is None else filled
    return Pairs(value, value, value, mask)


def content(bag, which=0):
    pairs = bag.pairs()
    return sorted(pairs.state[which, pairs.filled[which], 0].tolist())


def test_the_bag_keeps_the_newest_pairs():
    """More pairs than fit push out the oldest, one at a time or many at once."""
    bag = Bag(1, 5, 1, 1, 1)
    for i in range(7):
        bag.push(numbered(i, 1))
    assert content(bag) == [2, 3, 4, 5, 6]
    bag.push(numbered(100, 9))
    assert content(bag) == [104, 105, 106, 107, 108]


def test_pairs_that_do_not_count_leave_the_bag_as_it_is():
    """Masked pairs are not stored and push nothing out; each map has its own bag."""
    bag = Bag(2, 3, 1, 1, 1)
    for i in range(4):
        bag.push(numbered(i, 1, maps=2, filled=torch.tensor([[True], [i % 2 == 0]])))
    assert content(bag, 0) == [1, 2, 3]
    assert content(bag, 1) == [0, 2]
    assert bag.count.tolist() == [3, 2]
    bag.empty(torch.tensor([True, False]))
    assert bag.count.tolist() == [0, 2]


def test_the_bag_has_half_the_square_of_the_weights():
    """n_b = n_p^2 / 2, capped: 200 pairs for the 20 weights of a 4 x 4 affine map."""
    assert bag_size(20, 400) == 200
    assert bag_size(148, 400) == 400
