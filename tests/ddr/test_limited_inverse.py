"""The nearest command within limits."""

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.optimize import lsq_linear

from auv_torchrl.ddr.actuation import Actuation, Channels, Thrusters
from auv_torchrl.ddr.allocation import RIDGE, Allocation
from auv_torchrl.vehicle import load_vehicle

ACTUATION = Actuation(load_vehicle("paper"))
GAINS = st.lists(st.sampled_from([-1.0, 0.0, 0.2, 1.0, 1.6]), min_size=6, max_size=6)
WANTED = st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4)


def weight_of(space, gains):
    weight = ACTUATION.channels_per_share * torch.tensor(gains)
    return weight @ ACTUATION.mixer if space.size == 4 else weight


@given(gains=GAINS, wanted=WANTED)
@settings(max_examples=60, deadline=None)
def test_commands_stay_within_limits_and_never_reverse_what_is_wanted(gains, wanted):
    """For any gains, also singular ones, the command is finite, within limits, and its effect does not oppose."""
    for space in (Channels(ACTUATION), Thrusters(ACTUATION)):
        weight = weight_of(space, gains)
        tau = torch.tensor(wanted)
        command = space.nearest(weight[None], tau[None])[0]
        reached = space.rows @ command
        assert command.isfinite().all()
        assert (reached <= space.high + 1e-5).all() and (reached >= space.low - 1e-5).all()
        assert float(tau @ (weight @ command)) >= -1e-4


@given(gains=st.lists(st.sampled_from([-1.0, 0.5, 1.0, 1.6]), min_size=6, max_size=6), wanted=WANTED)
@settings(max_examples=40, deadline=None)
def test_the_effect_is_as_near_as_the_optimum(gains, wanted):
    """The distance to the wanted wrench is within 0.05 of that of scipy's bounded least squares."""
    space = Thrusters(ACTUATION)
    weight = weight_of(space, gains)
    command = space.nearest(weight[None], torch.tensor(wanted)[None])[0]
    best = lsq_linear(weight.numpy().astype(float), np.array(wanted), bounds=(-1.0, 1.0)).x
    distance = np.linalg.norm(weight.numpy() @ command.numpy() - wanted)
    assert distance <= np.linalg.norm(weight.numpy() @ best - wanted) + 0.05


@given(
    gains=st.lists(st.sampled_from([-1.0, 0.0, 0.5, 1.0, 1.6]), min_size=6, max_size=6),
    wanted=hnp.arrays(float, (5, 4), elements=st.floats(-3.0, 3.0)),
    reference=hnp.arrays(float, (5, 6), elements=st.floats(-1.0, 1.0)),
)
@settings(max_examples=60, deadline=None)
def test_allocation_is_the_bounded_least_squares_of_scipy(gains, wanted, reference):
    """For any gains, also dead thrusters, and any reference the cost is that of ``lsq_linear``, on both libraries.

    Where limits bind, it is that of a second one, whose aim is the effect of the first.
    """
    effect = weight_of(Thrusters(ACTUATION), gains).double().numpy()
    weight = np.array((1.0, 1.0, 0.5, 0.3))
    low, high = -np.ones(6), np.linspace(0.5, 1.0, 6)
    found = Allocation(weight, low, high)(wanted, effect[None], np.zeros((5, 6, 6)), reference)
    tensors = (torch.from_numpy(values) for values in (wanted, effect[None], np.zeros((5, 6, 6)), reference))
    on_torch = Allocation(*(torch.from_numpy(values) for values in (weight, low, high)))(*tensors)
    np.testing.assert_allclose(on_torch.numpy(), found, atol=1e-4)
    matrix = np.concatenate((np.sqrt(weight)[:, None] * effect, np.sqrt(RIDGE) * np.eye(6)))
    for row in range(5):
        right = np.concatenate((np.sqrt(weight) * wanted[row], np.sqrt(RIDGE) * reference[row]))
        best = np.linalg.lstsq(matrix, right)[0]
        if (best < low).any() or (best > high).any():
            right[:4] = matrix[:4] @ lsq_linear(matrix, right, (low, high), method="bvls", tol=1e-14).x
            best = lsq_linear(matrix, right, (low, high), method="bvls", tol=1e-14).x
        cost, least = (np.square(matrix @ command - right).sum() for command in (found[row], best))
        assert (found[row] >= low).all() and (found[row] <= high).all()
        assert cost <= least + 1e-9 * (1.0 + least)


@given(wanted=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3), seed=st.integers(0, 1000))
@settings(max_examples=60, deadline=None)
def test_thrusters_that_hardly_help_do_nothing_for_what_is_out_of_reach(wanted, seed):
    """The vertical thrusters of a map with errors of 1 / 2000 stay at rest without heave, whatever else is wanted."""
    weight = weight_of(Thrusters(ACTUATION), [1.0, 1.6, 0.2, 1.0, 1.0, 1.0])
    weight = weight + 5e-4 * torch.randn(weight.shape, generator=torch.Generator().manual_seed(seed))
    surge, sway, yaw = wanted
    command = Thrusters(ACTUATION).nearest(weight[None], torch.tensor([[surge, sway, 0.0, yaw]]))[0]
    assert command[4:].abs().max() < 0.1


def test_one_map_per_vehicle_equals_one_at_a_time():
    """A batch of maps gives what each map gives alone."""
    space = Channels(ACTUATION)
    weights = torch.stack([weight_of(space, gains) for gains in ([-1.0, 1, 1, 1, 1, 1], [1.0, 1.6, 0.2, 1, 1, 1])])
    tau = torch.tensor(((0.9, -0.8, 0.1, 0.7), (0.3, 0.9, -0.9, -0.6)))
    alone = [space.nearest(w[None], t[None])[0] for w, t in zip(weights, tau, strict=True)]
    torch.testing.assert_close(space.nearest(weights, tau), torch.stack(alone), atol=1e-5, rtol=0)
