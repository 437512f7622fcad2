"""The networks as graphs: policy, F and R; and what the source vehicle's thrusters make of an action.

They compute in double precision between inputs and outputs in single: sums of large numbers of both signs lose four
digits, and which ones depends on the processor.
"""

from typing import Any

import numpy as np
from torch import Tensor, nn

from auv_torchrl.agents.networks import TanhPolicy
from auv_torchrl.ddr.actuation import Actuation
from auv_torchrl.ddr.models import ForwardModel, InverseModel, Regressor
from auv_torchrl.export.graph import Graph, Namespace
from auv_torchrl.physics import Coefficients
from auv_torchrl.physics.thrusters import thrust_target

Array = Any


def array(tensor: Tensor) -> Array:
    """As numpy has it."""
    return tensor.detach().cpu().numpy()


def layers(network: nn.Sequential, x: Array) -> Array:
    """A perceptron on ``x`` (N, d).

    Raises:
        ValueError: for a layer of another kind.
    """
    for layer in network:
        if isinstance(layer, nn.Linear):
            x = x @ array(layer.weight).T + array(layer.bias)
        elif isinstance(layer, nn.ReLU):
            x = np.maximum(x, 0.0)
        elif isinstance(layer, nn.Tanh):
            x = np.tanh(x)
        else:
            raise ValueError(f"a network with a layer {type(layer).__name__} cannot be exported: Linear, ReLU and Tanh")
    return x


def _given(graph: Graph, name: str, size: int) -> Array:
    """An input (N, size), as what is computed with."""
    return graph.input(name, size, dtype=np.float32).astype(graph.dtype)


def _give(graph: Graph, name: str, value: Array, size: int) -> bytes:
    """The file of a graph with one output (N, size)."""
    graph.output(name, value.astype(np.float32), size)
    return graph.bytes()


def policy_graph(policy: TanhPolicy) -> bytes:
    """Observation to action, deterministic: tanh of the mean."""
    inputs = next(layer.in_features for layer in policy.network if isinstance(layer, nn.Linear))
    graph = Graph("policy", "float64")
    output = layers(policy.network, _given(graph, "observation", inputs))
    return _give(graph, "action", np.tanh(output.columns(0, policy.actions)), policy.actions)


def forward_graph(model: ForwardModel) -> bytes:
    """F: motion and action to the motion a control step later."""
    graph = Graph("F", "float64")
    states = model.change.states
    state, action = _given(graph, "state", states), _given(graph, "action", model.actuation.channels)
    change = regression(model.change, state, realised(model.actuation, action))
    return _give(graph, "next_state", state + change, states)


def inverse_graph(model: InverseModel) -> bytes:
    """R: two motions, a control step apart, to what the source vehicle's thrusters realised, in channels."""
    graph = Graph("R", "float64")
    states = model.control.states
    state, following = _given(graph, "state", states), _given(graph, "next_state", states)
    return _give(graph, "tau", regression(model.control, state, following - state), model.control.linear.out_features)


def intended_graph(actuation: Actuation) -> bytes:
    """Action to what it would give on the source vehicle without dead band and limits, in channels."""
    graph = Graph("intended", "float64")
    channels = actuation.channels
    return _give(graph, "tau", intended(actuation, _given(graph, "action", channels)), channels)


def regression(regressor: Regressor, state: Array, rest: Array) -> Array:
    """:meth:`Regressor.forward` of state (N, s) and the other inputs (N, r)."""
    xp = Namespace
    states = regressor.states
    rows, columns = (np.eye(states)[array(index)].T for index in (regressor.row, regressor.column))
    products = (state @ rows) * (state @ columns)
    x = xp.concat([state, rest, products, state * np.abs(state)])
    x = (x - array(regressor.input_mean)) / array(regressor.input_scale)
    (first, *_) = regressor.network
    assert isinstance(first, nn.Linear)
    linear = x @ array(regressor.linear.weight).T + array(regressor.linear.bias)
    outputs = linear + layers(regressor.network, x.columns(0, first.in_features))
    return outputs * array(regressor.output_scale) + array(regressor.output_mean)


def coefficients(actuation: Actuation, dtype: Any) -> Coefficients:
    """Of the thrusters, as numpy has them, in the precision of what they are applied to."""
    fields = (array(field) for field in actuation.coefficients)
    return Coefficients(*(field.astype(dtype) if field.dtype.kind == "f" else field for field in fields))


def delivered(actuation: Actuation, command: Array) -> Array:
    """:meth:`Actuation.delivered`."""
    c = coefficients(actuation, command.dtype)
    return thrust_target(c, actuation.terms, command) / c.full_thrust


def realised(actuation: Actuation, action: Array) -> Array:
    """:meth:`Actuation.realised`."""
    return delivered(actuation, action @ array(actuation.mixer).T) @ array(actuation.channels_per_share).T


def intended(actuation: Actuation, action: Array) -> Array:
    """:meth:`Actuation.intended`."""
    command = action @ array(actuation.mixer).T
    c = coefficients(actuation, command.dtype)
    beyond = np.maximum(np.abs(command).max(keepdims=True), 1.0)
    smooth = c._replace(dead_band=np.zeros_like(c.dead_band))
    share = thrust_target(smooth, actuation.terms, command / beyond) / smooth.full_thrust
    return (beyond * share) @ array(actuation.channels_per_share).T
