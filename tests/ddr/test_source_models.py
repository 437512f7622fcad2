"""F and R of the source vehicle, and where they are kept."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from auv_torchrl.ddr import PretrainingConfig
from auv_torchrl.ddr.actuation import Actuation, Channels, Thrusters
from auv_torchrl.ddr.models import Regressor
from auv_torchrl.ddr.pretraining import source_transitions
from auv_torchrl.ddr.store import ingredients, load_or_pretrain
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.pushes import wrench_per_share
from auv_torchrl.physics.thrusters import body_wrench
from auv_torchrl.tasks import Cruise, StationKeeping
from auv_torchrl.vehicle import load_vehicle


def test_the_inverse_model_finds_the_realised_channels(models, vehicle, task):
    """On transitions it has not seen R is off by less than 2 % of a full command (root mean square)."""
    config = PretrainingConfig(transitions=2000, seed=99)
    x, realised, following = (d.float() for d in source_transitions(vehicle, task, models, config)[:3])
    assert (models.R(x, following) - realised).square().mean().sqrt() < 0.02
    change = following - x
    assert (models.F.change(torch.cat((x, realised), -1)) - change).square().mean().sqrt() < 0.05 * change.std()


def test_the_linear_map_is_the_same_wherever_its_data_lie():
    """Least squares repeat to the bit, whatever else was put into memory before."""
    torch.manual_seed(0)
    inputs, outputs = torch.randn(400, 8), torch.randn(400, 4)
    regressor, found, before = Regressor(4, 4, 4, 8), set(), []
    for number in range(24):
        before.append(torch.zeros(1001 * number))
        regressor.standardise(inputs.clone(), outputs.clone())
        found.add(regressor.linear.weight.detach().numpy().tobytes())
    assert len(found) == 1


def test_the_long_form_is_the_projection_onto_what_the_source_can_do(models):
    """R(x, F(x, u)) is u as the source's dead band and limits let it through, to 2 % of a full command."""
    state = 0.2 * (2 * torch.rand(200, 4, generator=torch.Generator().manual_seed(1)) - 1)
    action = 2 * torch.rand(200, 4, generator=torch.Generator().manual_seed(2)) - 1
    error = models.R(state, models.F(state, action)) - models.actuation.realised(action)
    assert error.square().mean().sqrt() < 0.02


def test_pushes_of_azimuth_thrusters_are_linear_in_the_wrench():
    """The channels of thrusts and angles are what the physics pushes, and commands for a push give it back."""
    ferry, task = load_vehicle("milliampere"), Cruise().fitted(load_vehicle("milliampere"))
    actuation, c = Actuation(ferry, task.axes, 1.5), prepare(ferry)
    per_share = wrench_per_share(c, ActiveTerms.of(c), 1.5)[[0, 5]]
    share = torch.tensor([[0.5, 0.3, 0.1, -0.2], [1.0, -0.4, -0.05, 0.1], [0.2, 0.2, 0.0, 0.2]])
    pushes = actuation.pushes(share)
    given = body_wrench(c, ActiveTerms.of(c), share.double().numpy() * ferry.full_thrust, np.zeros(3))[:, [0, 5]]
    np.testing.assert_allclose(pushes.double().numpy() @ per_share.T, given, atol=6.0)  # the angles are small
    torch.testing.assert_close(actuation.shares(pushes), share)
    for space in (Channels(actuation), Thrusters(actuation)):
        command = torch.tensor([[0.8, 0.3], [0.6, -0.5]]) if space.size == 2 else torch.tensor([[0.8, 0.7, 0.3, -0.2]])
        torch.testing.assert_close(space.decode(space.encode(command)), command, rtol=1e-4, atol=1e-4)
    assert actuation.push_limits[1][2] > 2.5 and actuation.push_limits[1][0] == 1.0


def test_servos_have_turned_as_far_as_their_rate_lets_them():
    """Half of the angle after a quarter of a second, and a quarter in the mean over it; thrusters follow at once."""
    actuation = Actuation(load_vehicle("milliampere"), ("surge", "yaw"), 1.5)
    mean, stands = actuation.turning(torch.zeros(1, 4), torch.ones(1, 4), 0.25)
    torch.testing.assert_close(mean, torch.tensor([[1.0, 1.0, 0.25, 0.25]]))
    torch.testing.assert_close(stands, torch.tensor([[1.0, 1.0, 0.5, 0.5]]))


def test_models_are_trained_once(tmp_path, vehicle, task):
    """The second call returns the same networks from the file; other ingredients make another file."""
    config = PretrainingConfig(transitions=200, iterations=3, hidden=4)
    first = load_or_pretrain(vehicle, task, tmp_path, config)
    (path,) = tmp_path.glob("*.safetensors")
    written = path.stat().st_mtime_ns
    second = load_or_pretrain(vehicle, task, tmp_path, config)
    assert path.stat().st_mtime_ns == written
    for name, tensor in first.state_dict().items():
        torch.testing.assert_close(second.state_dict()[name], tensor, rtol=0, atol=0)
    load_or_pretrain(vehicle, replace(task, control_dt=0.04), tmp_path, config)
    assert len(list(tmp_path.glob("*.safetensors"))) == 2
    path.write_bytes(b"damaged")
    with pytest.raises(ValueError, match="move the file away"):
        load_or_pretrain(vehicle, task, tmp_path, config)
    assert path.read_bytes() == b"damaged"


@pytest.mark.parametrize("kind", ["negated", "no digest"])
def test_models_that_are_not_what_was_kept_are_refused(tmp_path, vehicle, task, kind):
    """Changed weights, or none to compare them with: one line with the remedy, and the file stays."""
    config = PretrainingConfig(transitions=200, iterations=3, hidden=4)
    load_or_pretrain(vehicle, task, tmp_path, config)
    (path,) = tmp_path.glob("*.safetensors")
    with safe_open(path, "pt") as file:
        kept = file.metadata() if kind == "negated" else {}
    sign = -1 if kind == "negated" else 1
    save_file({name: sign * tensor for name, tensor in load_file(path).items()}, path, kept)
    content = path.read_bytes()
    with pytest.raises(ValueError, match="digest.*: move the file away to train them again"):
        load_or_pretrain(vehicle, task, tmp_path, config)
    assert path.read_bytes() == content
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_models_of_other_speeds_and_axes_are_kept_apart():
    """Fins push with the square of the speed; of a vehicle that hovers the description is what it was."""
    vehicle, config = load_vehicle("remus100"), PretrainingConfig()
    task = Cruise().fitted(vehicle)
    others = (task, replace(task, speed=1.0), replace(task, controlled=("surge", "yaw")))
    assert len({repr(ingredients(vehicle, other, config)) for other in others}) == 3
    assert ingredients(load_vehicle("paper"), StationKeeping(), config)["task"].keys() == {
        "control_dt", "tilt", "start_speed", "start_yaw_rate",
    }  # fmt: skip
