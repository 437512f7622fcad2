"""The compiled torch fleet."""

import pytest
import torch
from flights import fly, held_actions

from auv_torchrl.envs import TorchFleet
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle


@pytest.mark.slow
@pytest.mark.thorough
# Both are about libraries: which cached function tells numpy from torch, and what torch itself still calls.
@pytest.mark.filterwarnings("ignore:Dynamo detected a call to a `functools.lru_cache`:UserWarning")
@pytest.mark.filterwarnings("ignore:`torch.jit.script_method` is deprecated:DeprecationWarning")
def test_compilation_changes_nothing_but_the_speed():
    """The compiled fleet flies as the plain one, to rounding."""
    vehicle, task = load_vehicle("paper"), StationKeeping()
    plain = TorchFleet(vehicle, task, 8, seed=0, dtype=torch.float64)
    compiled = TorchFleet(vehicle, task, 8, seed=0, dtype=torch.float64, compiled=True)
    start, actions = plain.reset()["start"], held_actions(8, 40)
    one, other = fly(plain, actions, start), fly(compiled, actions, start)
    torch.testing.assert_close(one["position"], other["position"], rtol=0, atol=1e-9)
