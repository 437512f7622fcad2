"""One map for each vehicle of a fleet: ``adapter.shared=false``."""

from dataclasses import replace

import pytest
import torch
from torchrl.envs import TransformedEnv, check_env_specs

from auv_torchrl.ddr import AdapterConfig, DDRAdapter, adapt
from auv_torchrl.ddr.store import load_adapter, save_adapter
from auv_torchrl.effects import get_effect
from auv_torchrl.envs import TorchFleet

OWN = AdapterConfig(shared=False, seed=3)


@pytest.fixture(scope="module")
def mixed(vehicle, task):
    """Makes three vehicles: a healthy one, one with thruster 1 reversed, one with thruster 1 reversed and 2 dead."""
    gains = torch.ones(3, 6, dtype=torch.float64)
    gains[1, 0] = gains[2, 0] = -1.0
    gains[2, 1] = 0.0
    values = {f"gain_{i + 1}": gains[:, i] for i in range(6)}
    fleet = get_effect("thruster_gain").apply(vehicle.expand(3), values)
    return lambda count, seed=7: TorchFleet(fleet, replace(task.for_evaluation(1.0)), count, seed=seed)


def test_each_vehicle_learns_its_own_map(mixed, models, policy):
    """After 4 s of each, three maps are those of three vehicles, and new starts are held; one map for all is not."""
    found = adapt(mixed, policy, models, OWN, count=3)
    mixer, channels = models.actuation.mixer, models.actuation.channels_per_share
    for g, gains in zip(found.adapter.maps, ((1.0, 1.0), (-1.0, 1.0), (-1.0, 0.0)), strict=True):
        scale = torch.diag(torch.tensor((*gains, 1.0, 1.0, 1.0, 1.0)))
        torch.testing.assert_close(g.weight, channels @ scale @ mixer, atol=0.05, rtol=0)
    errors = {}
    for shared in (False, True):
        adapter = DDRAdapter(models, replace(OWN, shared=shared), 3)
        if shared:
            adapter.g.load_state_dict(found.adapter.maps[1].state_dict())
        else:
            adapter.load_state_dict(found.adapter.state_dict())
        with torch.no_grad():
            flight = TransformedEnv(mixed(3, seed=8), adapter).rollout(280, policy, break_when_any_done=False)
        errors[shared] = flight["next", "position"][:, 200:].norm(dim=-1).mean(-1)
    assert errors[False].max() < 0.01 < errors[True].max()


def test_of_one_vehicle_both_kinds_are_the_same(fleet, models, policy, scenario):
    """A fleet of one learns and does bit for bit the same, whether its map is shared or not."""
    maps = []
    for shared in (True, False):
        found = adapt(lambda n: fleet(n, scenario("swap"), seed=7), policy, models, replace(OWN, shared=shared))
        maps.append(found)
    assert torch.equal(maps[0].adapter.g.weight, maps[1].adapter.g.weight)
    assert (maps[0].pairs, maps[0].residual) == (maps[1].pairs, maps[1].residual)


def test_specs_hold_and_another_number_of_vehicles_is_refused(fleet, models):
    """Three maps serve three vehicles."""
    check_env_specs(TransformedEnv(fleet(3), DDRAdapter(models, OWN, 3)))
    with pytest.raises(ValueError, match="maps for 3 vehicles, and the fleet has 2: give DDRAdapter"):
        TransformedEnv(fleet(2), DDRAdapter(models, OWN, 3)).rollout(1)
    with pytest.raises(ValueError, match="there are 3 maps"):
        _ = DDRAdapter(models, OWN, 3).g


def test_a_file_keeps_every_map(models, vehicle, task, tmp_path):
    """What is written comes back with as many maps."""
    adapter = DDRAdapter(models, OWN, 2)
    adapter.maps[1].weight.mul_(0.5)
    save_adapter(adapter, "policy", tmp_path / "a.safetensors")
    back = load_adapter(tmp_path / "a.safetensors", "policy", vehicle, task)
    assert torch.equal(back.maps[1].weight, adapter.maps[1].weight) and len(back.maps) == 2
