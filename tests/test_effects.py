"""Contracts that hold over the whole registry of effects, on every vehicle."""

import pytest
import torch

from auv_torchrl.effects import EFFECTS
from auv_torchrl.paths import config_names
from auv_torchrl.vehicle import load_vehicle


@pytest.mark.parametrize("name", config_names("vehicle"))
@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
def test_nominal_values_leave_the_vehicle_as_it_is(effect, name):
    """Every effect at its nominal values is the identity."""
    vehicle = load_vehicle(name).expand(3).clone()
    same = effect.apply(vehicle, effect.nominal(vehicle))
    for field, value in vehicle.items():
        torch.testing.assert_close(same.get(field), value, rtol=0, atol=1e-12, msg=field)
