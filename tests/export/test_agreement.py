"""The files of an export say what torch says, over 10^4 random and extreme inputs.

Networks are asked in double precision: in single, torch itself is off by 1.5e-4 where inputs are large, and by how much
depends on the processor.
"""

import copy
from typing import Any

import numpy as np
import pytest
import torch

from auv_torchrl.ddr.actuation import Actuation, Thrusters
from auv_torchrl.ddr.affine import AffineMap
from auv_torchrl.export.maps import command_graph, effect_graph
from auv_torchrl.export.networks import forward_graph, intended_graph, inverse_graph, policy_graph
from auv_torchrl.extras import library
from auv_torchrl.vehicle import load_vehicle
from tests.export.conftest import drawn

COUNT = 10_000
CHUNK = 250  # rows at a time: Newton's method goes on until the last of them is there
AGREES = 1e-5  # of 1, or of the value where that is larger


UNEVEN = {  # thrusters of a vehicle file may give less one way, nothing the other, and creep at neutral
    "forward_gain": np.array([1, 1, 0.8, 1, 1, 1, 0.6, 1.0]),
    "reverse_gain": np.array([1, 0.7, 1, 1, 0, 1, 1, 1.0]),
    "neutral_offset": np.array([0, 0, 0, 0.03, 0, -0.02, 0, 0]),
}


@pytest.fixture(
    scope="module",
    params=[
        ("paper", "affine", {}),
        pytest.param(("bluerov2_heavy", "thrusters", UNEVEN), marks=pytest.mark.thorough),
        ("bluerov2", "network", {}),
    ],
    ids=["paper", "heavy", "bluerov2"],
)
def given(request):
    """A vehicle and each kind of map."""
    vehicle, kind, fields = request.param
    return drawn(vehicle, kind, **fields)


def inputs(size, seed, largest=1e4):
    """Half of them of the order of 1, half of any size from 1e-3 to ``largest``; some are 0."""
    generator = torch.Generator().manual_seed(seed)
    values = torch.randn(COUNT, size, generator=generator)
    spread = torch.rand(COUNT, 1, generator=generator) * (np.log10(largest) + 3) - 3
    values[::2] *= 10 ** spread[::2]
    values[::97] = 0.0
    return values


def evaluated(data, **given):
    """What onnxruntime makes of a file, chunk by chunk."""
    onnxruntime = library("onnxruntime", "a test", "fly")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session: Any = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    shared = {name: value.numpy() for name, value in given.items() if name in ("weight", "bias")}
    batch = {name: value.numpy() for name, value in given.items() if name not in shared}
    chunks = [{name: value[i : i + CHUNK] for name, value in batch.items()} for i in range(0, COUNT, CHUNK)]
    return torch.from_numpy(np.concatenate([session.run(None, {**chunk, **shared})[0] for chunk in chunks]))


def assert_agree(found, expected):
    """Every number, the extreme ones relative to their size."""
    assert len(found) == COUNT and expected.isfinite().all()
    assert ((found - expected).abs() / expected.abs().clamp_min(1.0)).max() < AGREES


def double(module, *given):
    """What a module says in double precision."""
    return copy.deepcopy(module).double()(*(value.double() for value in given)).detach()


def test_the_policy_agrees(affine):
    """Deterministic, as it is flown."""
    observation = inputs(16, 0)
    expected = double(affine.policy.module.module, observation)
    assert_agree(evaluated(policy_graph(affine.policy.module.module), observation=observation), expected)
    assert expected.abs().max() == 1.0 and (expected.abs() < 0.5).any()


def test_f_r_and_what_an_action_intends_agree(given):
    """Forward and inverse model of the source vehicle, its curve and dead bands included."""
    models = given.adapter.models
    state, following, action = inputs(models.states, 1, 100.0), inputs(models.states, 2, 100.0), inputs(4, 3)
    action = action.clamp(-1, 1)
    assert_agree(evaluated(forward_graph(models.F), state=state, action=action), double(models.F, state, action))
    assert_agree(
        evaluated(inverse_graph(models.R), state=state, next_state=following), double(models.R, state, following)
    )
    expected = models.actuation.intended(action)
    assert_agree(evaluated(intended_graph(models.actuation), action=action), expected)


def learnt(g):
    return {"weight": g.weight, "bias": g.bias}


def test_g_agrees(given):
    """With the weights of the adapter as inputs."""
    g, states = given.adapter.g, given.adapter.models.states
    state, command = inputs(states, 4, 100.0), inputs(g.space.size, 5)
    found = evaluated(effect_graph(g, states), state=state, command=command, **learnt(g))
    assert_agree(found, g(state, g.space.encode(command)))


@pytest.mark.slow
def test_h_agrees(given):
    """Within the limits and far beyond them."""
    g, states = given.adapter.g, given.adapter.models.states
    state, tau = inputs(states, 6, 100.0), 0.7 * inputs(4, 7, 100.0)
    expected = torch.cat(
        [g.space.decode(g.invert(x, y)) for x, y in zip(state.split(CHUNK), tau.split(CHUNK), strict=True)]
    )
    found = evaluated(command_graph(g, states), state=state, tau=tau, **learnt(g))
    assert_agree(found, expected)
    assert found.abs().max() <= 1.0


def test_a_map_to_azimuth_thrusters_is_refused():
    """An exported map is linear in the thrusts, and what a servo pushes grows with the thrust that it turns."""
    g = AffineMap(Thrusters(Actuation(load_vehicle("milliampere"), ("surge", "yaw"), 1.5)), 1e-3)
    for graph in (effect_graph, command_graph):
        with pytest.raises(ValueError, match="a map to azimuth thrusters cannot be exported"):
            graph(g, 8)
