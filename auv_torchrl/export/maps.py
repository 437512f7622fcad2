"""The control maps as graphs: G says what a command does, H which command does it, within the limits.

Weight and bias of the maps, what an adapter has learnt, are inputs: a map that is learnt on needs no new file.
:class:`auv_torchrl.ddr.allocation.Allocation` is written once more here, as a loop of ONNX, which has no way to solve
equations and none to leave out what one row of a batch does not need. A test holds the two together.
"""

from typing import Any

import numpy as np

from auv_torchrl.ddr.actuation import EDGE, Actuation, Channels
from auv_torchrl.ddr.affine import AffineMap
from auv_torchrl.ddr.allocation import RIDGE, ROUNDS, STIFFNESS
from auv_torchrl.ddr.network import NetworkMap
from auv_torchrl.export.graph import Graph, Namespace
from auv_torchrl.export.networks import array, coefficients, delivered, layers

Array = Any
xp = Namespace
EXACT = 1e-9  # relative slope at the end of a step of Newton's method that counts as none


def effect_graph(g: AffineMap, states: int) -> bytes:
    """G: motion and command to channels of the source vehicle."""
    graph, k, a = Graph("G"), g.space.size, len(g.bias)
    state, command = graph.input("state", states), graph.input("command", k)
    weight, bias = graph.parameter("weight", a, k), graph.parameter("bias", a)
    control = _encode(g, command)
    tau = control @ weight.turned() + bias
    if isinstance(g, NetworkMap):
        tau = tau + layers(g.g, xp.concat([state, control]))
    graph.output("tau", tau, a)
    return graph.bytes()


def command_graph(g: AffineMap, states: int) -> bytes:
    """H: motion and channels of the source vehicle to the command within limits that comes nearest to them."""
    graph, k, a = Graph("H"), g.space.size, len(g.bias)
    state, tau = graph.input("state", states), graph.input("tau", a)
    weight, bias = graph.parameter("weight", a, k), graph.parameter("bias", a)
    limits = [array(limit).astype(float) for limit in (g.space.low, g.space.high)]
    rows = array(g.space.rows).astype(float)
    wanted = (tau - bias).astype(np.float64)
    control = nearest(weight.astype(np.float64), wanted, rows, *limits).astype(np.float32)
    if isinstance(g, NetworkMap):
        added = layers(g.h, xp.concat([state, tau]))
        control = _shrunk(control + added, *(part.astype(np.float32) for part in (rows, *limits)))
    graph.output("command", _decode(g, control), k)
    return graph.bytes()


def nearest(effectiveness: Array, wanted: Array, rows: Array, low: Array, high: Array) -> Array:
    """Commands (N, k) within limits whose effect comes nearest to ``wanted`` (N, a), by the rule of ``Allocation``."""
    k = rows.shape[-1]
    curvature = effectiveness.turned() @ effectiveness
    hessian = (curvature + RIDGE * np.eye(k)).unsqueeze(0)
    linear = wanted @ effectiveness
    free = solve(hessian, linear, k)
    reached = free @ rows.T
    beyond = (reached > high) | (reached < low)
    limited = beyond.astype(np.int64).max(keepdims=True).astype(np.bool_)
    closest = _within(free, hessian, linear, rows, low, high)
    done = closest @ curvature  # what it does is wanted now
    second = _within(solve(hessian, done, k), hessian, done, rows, low, high)
    return _shrunk(xp.where(limited, second, free), rows, low, high)


def _within(start: Array, hessian: Array, linear: Array, rows: Array, low: Array, high: Array) -> Array:
    """The minimiser with springs at the limits, by Newton's method with a line search, from the one without."""
    k = rows.shape[-1]
    stiffness = STIFFNESS * (hessian * np.eye(k)).sum().sum(keepdims=True) / k  # (1, 1)

    def newton(graph: Graph, command: Array) -> tuple[Array, Array]:
        reached = command @ rows.T
        over, under = reached > high, reached < low
        beyond = (over | under).astype(np.float64)
        spring = stiffness * beyond
        bound = xp.where(over, high, low)
        held = (rows.T * spring.unsqueeze(1)) @ rows
        target = solve(hessian + held, linear + (spring * bound) @ rows, k)
        way = target - command
        share = _share(command, way, hessian, linear, rows, low, high, stiffness)
        after = xp.where(share < 1.0, command + share * way, target)
        reached = after @ rows.T
        same = ((reached > high) | (reached < low)).astype(np.float64) == beyond
        return after, graph.op("Not", same.all() & (share == 1.0).all(), dtype=np.bool_)

    return start.graph.loop(ROUNDS, start, newton)


def _share(
    command: Array, way: Array, hessian: Array, linear: Array, rows: Array, low: Array, high: Array, stiffness: Array
) -> Array:
    """How far along ``way`` (N, k) the cost falls, (N, 1) in [0, 1]: its slope is linear between the limits."""
    start, along = command @ rows.T, way @ rows.T  # (N, r)
    curvature = (way * _times(hessian, way)).sum(keepdims=True)
    initial = (way * (_times(hessian, command) - linear)).sum(keepdims=True)
    zero = curvature * 0.0

    def slope(shares: Array) -> Array:
        """Of shares (N, m)."""
        at = start.unsqueeze(1) + shares.unsqueeze(2) * along.unsqueeze(1)
        excess = np.maximum(at - high, 0.0) + np.minimum(at - low, 0.0)
        return initial + shares * curvature + stiffness * (along.unsqueeze(1) * excess).sum()

    still = along == 0.0
    moving = xp.where(still, 1.0, along)
    crossings = [xp.where(still, 1.0, (limit - start) / moving) for limit in (high, low)]
    shares = xp.concat([zero, np.minimum(np.maximum(xp.concat(crossings), 0.0), 1.0), zero + 1.0])
    count = 2 * len(rows) + 2
    shares, _ = shares.graph.op("TopK", shares, shares.graph.constant([count], np.int64), outputs=2, largest=0)
    slopes = slope(shares)
    falling = (slopes <= 0.0).astype(np.int64).sum(keepdims=True)
    after = np.minimum(np.maximum(falling, 1), count - 1)
    a, b = (_picked(shares, after + shift) for shift in (-1, 0))
    fa, fb = (_picked(slopes, after + shift) for shift in (-1, 0))
    share = a + (b - a) * fa / xp.where(fa < fb, fa - fb, -1.0)
    whole = slope(zero + 1.0) <= EXACT * np.abs(slope(zero))
    return xp.where(whole, 1.0, xp.where(fb > 0.0, share, 1.0))


def solve(matrix: Array, vector: Array, k: int) -> Array:
    """Solutions (N, k) for positive definite matrices (N or 1, k, k) and vectors (N, k), by Gauss and Jordan."""
    column = vector.unsqueeze(2)
    matrix = matrix + column * np.zeros((1, k))  # one for each row of the batch
    work = xp.concat([matrix, column])
    one, whole = np.eye(k), np.eye(k + 1)
    for i in range(k):
        row = one[i : i + 1] @ work
        row = row / (row @ whole[:, i : i + 1])
        work = (1.0 - one[:, i : i + 1]) * (work - (work @ whole[:, i : i + 1]) * row) + one[:, i : i + 1] * row
    return (work @ whole[:, k:]).squeeze(2)


def _times(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector.unsqueeze(2)).squeeze(2)


def _picked(values: Array, place: Array) -> Array:
    return values.graph.op("GatherElements", values, place, axis=1)


def _shrunk(command: Array, rows: Array, low: Array, high: Array) -> Array:
    """The longest multiples, at most 1, of commands within the limits."""
    reached = command @ rows.T
    excess = xp.where(reached > 0.0, reached / np.maximum(high, 1e-9), reached / np.minimum(low, -1e-9))
    return command / np.maximum(excess.max(keepdims=True), 1.0)


def _encode(g: AffineMap, command: Array) -> Array:
    """:meth:`ControlSpace.encode`."""
    actuation = _actuation(g)
    if isinstance(g.space, Channels):
        return delivered(actuation, command @ array(actuation.mixer).T) @ array(g.space.unmixer).T
    return delivered(actuation, command)


def _decode(g: AffineMap, control: Array) -> Array:
    """:meth:`ControlSpace.decode`."""
    actuation = _actuation(g)
    if isinstance(g.space, Channels):
        thrusters = _command_for(actuation, control @ array(actuation.mixer).T, skip_dead_band=False)
        return xp.clip(thrusters @ array(g.space.unmixer).T, -1.0, 1.0)
    return _command_for(actuation, control, skip_dead_band=True)


def _actuation(g: AffineMap) -> Actuation:
    actuation = getattr(g.space, "actuation", None)
    if not isinstance(actuation, Actuation):
        raise ValueError(f"a map over {type(g.space).__name__} cannot be exported: over channels or thrusters")
    if actuation.turned is not None:
        raise ValueError("a map to azimuth thrusters cannot be exported: what a servo pushes depends on its thruster")
    return actuation


def _command_for(actuation: Actuation, share: Array, skip_dead_band: bool) -> Array:
    """:meth:`Actuation.command_for`."""
    c = coefficients(actuation, share.dtype)
    low, high = (array(limit) for limit in actuation.share_limits)
    share = np.maximum(np.minimum(share, high), low)
    gain = xp.where(
        share < 0.0, *(np.where(way > 0, way, way.dtype.type(1)) for way in (c.reverse_gain, c.forward_gain))
    )
    size = np.abs(share) / gain  # where the gain is none, so is the share
    if skip_dead_band:
        edge = c.dead_band / c.full_thrust
        size = xp.where(size < edge / 2, 0.0, np.maximum(size, np.where(edge > 0, edge + np.float32(EDGE), 0.0)))
    reach = xp.where(share < 0.0, 1.0 - c.asymmetry, np.ones_like(c.asymmetry))
    command = np.sign(share) * np.minimum(size / reach, 1.0) ** (1.0 / c.exponent)
    return np.maximum(np.minimum(command + c.neutral_offset, 1.0), -1.0)
