"""Where the servos of the source vehicle stand while a map is flown."""

import torch
from tensordict import TensorDict

from auv_torchrl.ddr import AdapterConfig, DDRAdapter, SourceModels
from auv_torchrl.tasks import Cruise
from auv_torchrl.vehicle import load_vehicle


def ferry() -> DDRAdapter:
    """A map to the thrusters and servos of a ferry, before any flight."""
    vehicle = load_vehicle("milliampere")
    return DDRAdapter(SourceModels(vehicle, Cruise().fitted(vehicle), 4), AdapterConfig(map="thrusters"))


def test_servos_are_followed_while_nothing_is_learnt_and_from_state_dict():
    """A quarter of a second turns a servo by half, another one to its end; a restored map goes on in between."""
    adapter, again = ferry(), ferry()
    observed = TensorDict({"observation": torch.zeros(2, 5)}, [2])
    adapter.begin(torch.arange(2), observed)
    command = adapter.maps[0].space.decode(adapter.maps[0].space.encode(torch.ones(2, 4)))
    steps = round(0.25 / adapter.models.control_dt)
    for _ in range(steps):
        adapter.after_step(command, observed, observed)
    again.load_state_dict(adapter.state_dict())
    assert again.servos is not None and adapter.servos is not None
    torch.testing.assert_close(again.servos.stands[:, 2:], torch.full((2, 2), 0.5), atol=1e-3, rtol=0)
    for _ in range(steps):
        again.after_step(command, observed, observed)
    torch.testing.assert_close(again.servos.stands[:, 2:], torch.ones(2, 2), atol=1e-3, rtol=0)
    again.begin(torch.tensor([1]), observed)
    assert again.servos.stands[0, 2] > 0.9 and again.servos.stands[1].abs().max() == 0
    torch.testing.assert_close(adapter.servos.stands[:, 2:], torch.full((2, 2), 0.5), atol=1e-3, rtol=0)


def test_a_vehicle_without_servos_keeps_the_state_it_had():
    """Its ``state_dict`` has no entry of servos, so that maps that were kept before there were any are read."""
    vehicle = load_vehicle("paper")
    adapter = DDRAdapter(SourceModels(vehicle, Cruise().fitted(vehicle), 4))
    assert not [name for name in adapter.state_dict() if "servo" in name]
