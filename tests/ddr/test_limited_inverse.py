"""The nearest command within limits."""

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from auv_torchrl.ddr.actuation import Actuation, Channels, Thrusters
from auv_torchrl.ddr.limits import LimitedInverse
from auv_torchrl.vehicle import load_vehicle

ACTUATION = Actuation(load_vehicle("paper"))
GAINS = st.lists(st.sampled_from([-1.0, 0.0, 0.2, 1.0, 1.6]), min_size=6, max_size=6)
WANTED = st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4)


def solver(space, gains):
    weight = ACTUATION.channels_per_share * torch.tensor(gains)
    if space.size == 4:
        weight = weight @ ACTUATION.mixer
    return weight, LimitedInverse(weight[None], space.rows, space.low, space.high)


@given(gains=GAINS, wanted=WANTED)
@settings(max_examples=60, deadline=None)
def test_commands_stay_within_limits_and_never_reverse_what_is_wanted(gains, wanted):
    """For any gains, also singular ones, the command is finite, within limits, and its effect does not oppose."""
    for space in (Channels(ACTUATION), Thrusters(ACTUATION)):
        weight, inverse = solver(space, gains)
        tau = torch.tensor(wanted)
        command = inverse(tau[None])[0]
        reached = space.rows @ command
        assert command.isfinite().all()
        assert (reached <= space.high + 1e-5).all() and (reached >= space.low - 1e-5).all()
        assert float(tau @ (weight @ command)) >= -1e-4


@given(gains=st.lists(st.sampled_from([-1.0, 0.5, 1.0, 1.6]), min_size=6, max_size=6), wanted=WANTED)
@settings(max_examples=40, deadline=None)
def test_the_effect_is_as_near_as_the_optimum(gains, wanted):
    """The distance to the wanted wrench is within 0.05 of that of scipy's bounded least squares."""
    weight, inverse = solver(Thrusters(ACTUATION), gains)
    command = inverse(torch.tensor(wanted)[None])[0]
    best = lsq_linear(weight.numpy().astype(float), np.array(wanted), bounds=(-1.0, 1.0)).x
    distance = np.linalg.norm(weight.numpy() @ command.numpy() - wanted)
    assert distance <= np.linalg.norm(weight.numpy() @ best - wanted) + 0.05


def test_one_map_per_vehicle_equals_one_at_a_time():
    """A batch of maps gives what each map gives alone."""
    space = Channels(ACTUATION)
    weights = torch.stack([solver(space, gains)[0] for gains in ([-1.0, 1, 1, 1, 1, 1], [1.0, 1.6, 0.2, 1, 1, 1])])
    together = LimitedInverse(weights, space.rows, space.low, space.high)
    tau = torch.tensor(((0.9, -0.8, 0.1, 0.7), (0.3, 0.9, -0.9, -0.6)))
    alone = [
        LimitedInverse(w[None], space.rows, space.low, space.high)(t[None])[0]
        for w, t in zip(weights, tau, strict=True)
    ]
    torch.testing.assert_close(together(tau), torch.stack(alone), atol=1e-5, rtol=0)
