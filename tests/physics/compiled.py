"""That every way to run the physics says the same, for vehicles of any kind."""

import numpy as np
import torch

from auv_torchrl.physics import ActiveTerms, Advance, State, control_step, prepare, rates
from auv_torchrl.vehicle import Vehicle
from auv_torchrl.vehicle.tensors import tensors


def assert_same_steps(vehicle: Vehicle, state: State, command: np.ndarray) -> None:
    """States and thrusts after a step from states (N,): array physics on numpy, compiled, and on torch."""
    vehicles = vehicle.expand(len(command))
    c = prepare(vehicles)
    terms = ActiveTerms.of(c)
    plain = control_step(c, terms, state, command)
    compiled = control_step(c, terms, state, command, advance=Advance())
    for one, other in zip(plain, compiled, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
    there = type(state)(*map(torch.as_tensor, state))
    other = control_step(prepare(tensors(vehicles)), terms, there, torch.as_tensor(command))
    np.testing.assert_allclose(other.velocity.numpy(), plain.velocity, rtol=1e-9, atol=1e-12)


def assert_same_gradients(vehicle: Vehicle, state: State, command: np.ndarray) -> None:
    """Of a compiled step those of torch, by velocity, by thrust and by command."""
    count = len(command)
    c = prepare(tensors(vehicle.expand(count)).clone())
    terms, found = ActiveTerms.of(c), []
    for advance in (None, Advance()):
        given = [torch.as_tensor(part).clone().requires_grad_() for part in (state.velocity, state.thrust, command)]
        start = type(state)(*map(torch.as_tensor, state))._replace(velocity=given[0], thrust=given[1])
        after = control_step(c, terms, start, given[2], advance=advance)
        weights = torch.linspace(0.5, 1.5, 6 * count, dtype=torch.float64).reshape(count, 6)
        found.append(torch.autograd.grad((weights * after.velocity).sum() + after.thrust.sum(), given))
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-7, atol=1e-9)


def assert_same_accelerations(vehicle: Vehicle, state: State, thrust: np.ndarray, monkeypatch) -> None:
    """Along a motion that is known, under thrusts (N, n)."""
    states = np.concatenate(state[:3], axis=-1)[:, None, None]
    c = prepare(vehicle.expand(1))
    given = (c, ActiveTerms.of(c), states, thrust[:, None, None], np.zeros((len(thrust), 1, 1)))
    compiled = rates(*given)
    monkeypatch.setenv("AUV_PHYSICS", "numpy")
    np.testing.assert_allclose(rates(*given), compiled, rtol=1e-9, atol=1e-10)
