"""The bag of newest pairs."""

import torch

from auv_torchrl.ddr.bag import Bag, Pairs, bag_size


def numbered(first, count):
    value = torch.arange(first, first + count, dtype=torch.float32)[:, None]
    return Pairs(value, value, value)


def content(bag):
    return sorted(bag.pairs().state[:, 0].tolist())


def test_the_bag_keeps_the_newest_pairs():
    """More pairs than fit push out the oldest, one at a time or many at once."""
    bag = Bag(5, 1, 1, 1)
    for i in range(7):
        bag.push(numbered(i, 1))
    assert content(bag) == [2, 3, 4, 5, 6]
    bag.push(numbered(100, 9))
    assert content(bag) == [104, 105, 106, 107, 108]


def test_an_emptied_bag_is_filled_anew():
    """What was in it is forgotten, and no pair at all leaves it as it is."""
    bag = Bag(3, 1, 1, 1)
    bag.push(numbered(0, 4))
    bag.push(numbered(9, 0))
    assert content(bag) == [1, 2, 3]
    bag.empty()
    assert bag.count == 0
    bag.push(numbered(7, 2))
    assert content(bag) == [7, 8]


def test_the_bag_has_half_the_square_of_the_weights():
    """n_b = n_p^2 / 2, capped: 200 pairs for the 20 weights of a 4 x 4 affine map."""
    assert bag_size(20, 400) == 200
    assert bag_size(148, 400) == 400
