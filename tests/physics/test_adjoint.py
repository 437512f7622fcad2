"""Gradients through compiled steps are those of torch through the written ones."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.effects import EFFECTS
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.kernel import Advance, native
from auv_torchrl.physics.kernel.reverse import pulled_back
from auv_torchrl.physics.kernel.symbols import Symbols, Tape
from auv_torchrl.physics.step import runge_kutta_steps
from auv_torchrl.vehicle.tensors import tensors
from tests.physics.test_kernel import H, drawn_vehicles, names, seeds

STEPS = 3


def flight(c, rng, dtype=torch.float64):
    """Body, thrust, targets and time of vehicles, of which all but the time are differentiated by."""
    rows, thrusters = c.full_thrust.shape

    def drawn(scale, *shape):
        return torch.as_tensor(scale * rng.normal(size=(rows, *shape)), dtype=dtype).requires_grad_()

    body, thrust = drawn(1.0, 13), drawn(10.0, thrusters)
    targets = [drawn(30.0, thrusters) for _ in range(STEPS)]
    return body, thrust, targets, torch.as_tensor(60 * rng.random(rows), dtype=dtype)


def outcome(advance, c, terms, body, thrust, targets, time, weights):
    """What a way to step leads to, and the gradients of a weighted sum of it."""
    later = advance(c, terms, body, thrust, targets, time, H)
    loss = sum(((part * weight).sum() for part, weight in zip(later, weights, strict=True)), torch.zeros(()))
    return later, torch.autograd.grad(loss, (body, thrust, *targets), materialize_grads=True)


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
@given(name=names, seed=seeds, rows=st.integers(2, 9))
@settings(max_examples=3)
def test_the_compiled_gradient_is_that_of_torch(effect, name, seed, rows):
    """Drawn vehicles with any effect, wherever they move: values within 1e-12 of their size, gradients within 1e-6."""
    rng = np.random.default_rng(seed)
    c = prepare(tensors(drawn_vehicles(name, effect, rows, rng)))
    terms, given_state = ActiveTerms.of(c), flight(c, rng)
    weights = [torch.as_tensor(rng.normal(size=part.shape)) for part in given_state[:2]]
    found, slopes = outcome(Advance(), c, terms, *given_state, weights)
    expected, true_slopes = outcome(runge_kutta_steps, c, terms, *given_state, weights)
    for ours, theirs in zip(found, expected, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-12, atol=1e-12)
    for ours, theirs in zip(slopes, true_slopes, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-6, atol=1e-6 * float(theirs.abs().max()))
    assert found[0].grad_fn.name() == "DifferentiableStepsBackward"


def test_the_gradient_is_there_in_single_precision():
    """To what single precision holds, the gradient is that in double precision."""
    rng = np.random.default_rng(3)
    c = prepare(tensors(drawn_vehicles("bluerov2", EFFECTS["current"], 5, rng)))
    given_state = flight(c, rng)
    weights = [torch.ones_like(part) for part in given_state[:2]]
    _, slopes = outcome(Advance(), c, ActiveTerms.of(c), *given_state, weights)

    def single(tensor):
        return tensor.detach().float().requires_grad_(tensor.requires_grad)

    body, thrust, targets, time = given_state
    light = single(body), single(thrust), [single(target) for target in targets], single(time)
    coarse = type(c)(*(single(field) for field in c))
    _, found = outcome(Advance(), coarse, ActiveTerms.of(c), *light, [single(weight) for weight in weights])
    for ours, theirs in zip(found, slopes, strict=True):
        torch.testing.assert_close(ours.double(), theirs, rtol=1e-3, atol=1e-4 * float(theirs.abs().max()))


@pytest.mark.parametrize("plain", [True, False], ids=["numpy is asked for", "gradients by the vehicles"])
def test_torch_differentiates_what_is_not_compiled(plain, monkeypatch):
    """Where compiled code is not wanted, or a parameter of the vehicles is differentiated by, torch does it."""
    rng = np.random.default_rng(4)
    c = prepare(tensors(drawn_vehicles("paper", EFFECTS["current"], 3, rng)))
    if plain:
        monkeypatch.setenv(native.CHOICE, "numpy")
    else:
        c = c._replace(current=c.current.clone().requires_grad_())
    body, thrust, targets, time = flight(c, rng)
    later, _ = Advance()(c, ActiveTerms.of(c), body, thrust, targets, time, H)
    by = targets[0] if plain else c.current
    (slope,) = torch.autograd.grad(later[:, 7:].square().sum(), by)
    assert slope.isfinite().all() and (slope != 0).any()


def test_an_operation_without_a_derivative_is_named():
    """A new operation of the physics that has no rule in reverse.py ends in an error that tells where it goes."""
    tape = Tape()
    speed = tape.inputs("speed", ())
    odd = Symbols(np.asarray(tape._record(type(tape.operations[0])("cosine", (speed.numbers.item().place,))), object))
    with pytest.raises(ValueError, match="cosine"):
        pulled_back(tape, [odd], [tape.inputs("weight", ())], [speed])
