"""Static actuation of the source vehicle and the command spaces on top of it."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.ddr.actuation import Actuation, Channels, Thrusters
from auv_torchrl.vehicle import load_vehicle
from tests.hovering import HOVERING

VEHICLES = {name: Actuation(load_vehicle(name)) for name in HOVERING}


@pytest.mark.parametrize("name", VEHICLES)
@given(share=st.floats(-1.5, 1.5))
@settings(max_examples=50, deadline=None)
def test_a_command_gives_the_thrust_it_was_made_for(name, share):
    """Commands for thrusts within the limits and outside the dead band deliver them; none is left inside it."""
    actuation = VEHICLES[name]
    wanted = torch.full((actuation.thrusters,), share)
    low, high = actuation.share_limits
    wanted = torch.maximum(torch.minimum(wanted, high), low)
    edge = actuation.coefficients.dead_band / actuation.coefficients.full_thrust
    given_share = actuation.delivered(actuation.command_for(wanted))
    error = (given_share - wanted).abs()
    assert torch.where(wanted.abs() > edge + 1e-3, error < 1e-4, error <= edge / 2 + 2e-4).all()


@pytest.mark.parametrize("name", VEHICLES)
def test_a_single_full_channel_is_realised_as_one(name):
    """A full positive command in one channel is that channel, 1, where thrust is symmetric."""
    actuation = VEHICLES[name]
    symmetric = bool((actuation.coefficients.asymmetry == 0).all())
    realised = actuation.realised(torch.eye(4))
    expected = torch.eye(4) if symmetric else torch.eye(4) * realised.diagonal()
    torch.testing.assert_close(realised, expected, atol=0.15 if not symmetric else 1e-5, rtol=0)


def test_commands_in_the_dead_band_say_nothing_about_the_channels():
    """Pairs are informative unless all thrusters are silent, or only some of those that share a channel."""
    channels = Channels(VEHICLES["paper"])
    surge, tiny, saturated, half_silent = torch.zeros(4, 4).unbind()
    surge[0], tiny[0] = 0.5, 0.05
    surge[2] = 0.05  # heave on its own thrusters
    saturated[[0, 1, 3]] = torch.tensor((0.9, 0.9, 0.5))
    half_silent[[0, 1, 3]] = torch.tensor((0.15, 0.1, 0.1))  # silences thruster 1 alone
    commands = torch.stack((surge, tiny, saturated, half_silent))
    assert channels.informative(commands).tolist() == [True, False, False, False]
    torch.testing.assert_close(channels.encode(surge), torch.tensor((0.5, 0.0, 0.0, 0.0)))
    thrusters = Thrusters(VEHICLES["paper"])
    assert thrusters.informative(torch.stack((torch.full((6,), 0.5), torch.full((6,), 0.05)))).tolist() == [True, False]


def test_a_singular_allocation_is_refused():
    """A source vehicle whose thrusters cannot span the channels is an error that says so."""
    vehicle = load_vehicle("paper")
    vehicle.gain[4:] = 0.0
    with pytest.raises(ValueError, match="singular"):
        Actuation(vehicle)
