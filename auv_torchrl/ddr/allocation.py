"""The commands whose effect comes nearest to what is wanted, within the limits of the thrusters."""

from typing import Any

from array_api_compat import array_namespace

Array = Any
RIDGE = 1e-4  # keeps commands that make no difference at their reference; costs 0.1 % of the effect on six thrusters
STIFFNESS = 1e7  # of a limit, relative to the mean curvature: 1e-7 of a full command beyond it, then cut off
ROUNDS = 30  # of Newton's method at most; 2 to 4 are the rule
_PLAIN = 4  # of them without a line search, which few problems need


class Allocation:
    """Minimise the expected squared error of the effect within limits, batch first, on numpy or torch, in float64.

    Where the limits leave something undone, nothing may be done for it that hardly helps: thrusters against each other
    at full thrust, for a hundredth of what is missing, which may be no more than the error of an identified map. So of
    the commands that do what was found to be nearest, those nearest to the reference are taken.

    A limit that is exceeded is a stiff spring; Newton's method finds which ones are, and ends
    there after few rounds. scipy's ``lsq_linear`` solves one problem at a time, and boxes alone: for the 100 vehicles
    of a flight it takes longer than they fly. A test compares the two.

    Args:
        weight: (w,) on the squared error of each degree of freedom.
        low: (r,) or (N, r) smallest values of the commands, or of ``rows @ command`` where rows are given.
        high: (r,) or (N, r) largest ones.
        rows: (r, k) what is limited, if not the commands themselves; no command at all must be within these limits.
    """

    def __init__(self, weight: Array, low: Array, high: Array, rows: Array | None = None):
        self.weight, self.low, self.high, self.rows = weight, low, high, rows

    def __call__(self, wanted: Array, effectiveness: Array, caution: Array = 0.0, reference: Array = 0.0) -> Array:
        """Commands (N, k), within the limits.

        Args:
            wanted: (N, w) effect.
            effectiveness: (N, w, k) or (1, w, k) effect per command.
            caution: (N, k, k) weighted covariance of it: uncertain commands are used less.
            reference: (N, k) commands to stay near where that costs nothing.
        """
        xp = array_namespace(wanted, effectiveness)
        pulled = effectiveness.mT * self.weight
        eye = xp.eye(effectiveness.shape[-1], dtype=wanted.dtype, device=wanted.device)
        rows = eye if self.rows is None else self.rows
        curvature = pulled @ effectiveness + caution
        hessian, linear = curvature + RIDGE * eye, (pulled @ wanted[..., None])[..., 0]
        command = _solve(hessian, linear + RIDGE * reference)
        limited = xp.any(self._beyond(command @ rows.T), axis=-1, keepdims=True)
        if xp.any(limited):
            nearest = self._within(command, hessian, linear + RIDGE * reference, rows)
            linear = (curvature @ nearest[..., None])[..., 0] + RIDGE * reference  # what it does is wanted now
            command = xp.where(limited, self._within(_solve(hessian, linear), hessian, linear, rows), command)
        if self.rows is None:
            return xp.clip(command, self.low, self.high)
        return shrunk(command, rows, self.low, self.high)

    def _beyond(self, reached: Array) -> Array:
        return (reached > self.high) | (reached < self.low)

    def _within(self, command: Array, hessian: Array, linear: Array, rows: Array) -> Array:
        """The minimiser with springs at the limits, from the one without."""
        xp = array_namespace(command)
        stiffness = STIFFNESS * xp.mean(xp.linalg.diagonal(hessian), axis=-1)[:, None]
        reached = command @ rows.T
        beyond = self._beyond(reached)
        one = xp.ones_like(command[:, :1])
        for number in range(ROUNDS if xp.any(beyond) else 0):
            spring = stiffness * xp.astype(beyond, command.dtype)
            bound = xp.where(reached > self.high, self.high, self.low)
            target = _solve(hessian + (rows.T * spring[:, None, :]) @ rows, linear + (spring * bound) @ rows)
            way = target - command
            share = one if number < _PLAIN else self._share(command, way, hessian, linear, rows, stiffness)
            command = xp.where(share < 1.0, command + share * way, target)
            before, reached = beyond, command @ rows.T
            beyond = self._beyond(reached)
            if xp.all(beyond == before) and xp.all(share == 1.0):
                break
        return command

    def _share(self, command: Array, way: Array, hessian: Array, linear: Array, rows: Array, stiffness: Array) -> Array:
        """How far along ``way`` (N, k) the cost falls, (N, 1) in [0, 1]: its slope is linear between the limits."""
        xp = array_namespace(command)
        start, along = (command @ rows.T)[:, None], (way @ rows.T)[:, None]
        curvature = xp.sum(way * (hessian @ way[..., None])[..., 0], axis=-1)[:, None]
        initial = xp.sum(way * ((hessian @ command[..., None])[..., 0] - linear), axis=-1)[:, None]
        low, high = (xp.broadcast_to(limit, start[:, 0].shape)[:, None] for limit in (self.low, self.high))

        def slope(share: Array) -> Array:
            at = start + share[..., None] * along
            excess = xp.clip(at - high, 0.0, None) + xp.clip(at - low, None, 0.0)
            return initial + share * curvature + stiffness * xp.sum(along * excess, axis=-1)

        one = xp.ones_like(curvature)
        if xp.all(slope(one) <= 1e-9 * xp.abs(slope(0.0 * one))):
            return one
        moving = xp.where(along == 0.0, xp.ones_like(along), along)
        crossings = xp.where(along == 0.0, xp.ones_like(along), xp.concat((high - start, low - start), axis=1) / moving)
        shares = xp.concat((0.0 * one, xp.clip(crossings.reshape(len(one), -1), 0.0, 1.0), one), axis=-1)
        shares = xp.sort(shares, axis=-1)
        slopes = slope(shares)
        after = xp.clip(xp.sum(xp.astype(slopes <= 0.0, xp.int64), axis=-1)[:, None], 1, shares.shape[-1] - 1)
        (a, b), (fa, fb) = (
            [xp.take_along_axis(values, after + shift, axis=-1) for shift in (-1, 0)] for values in (shares, slopes)
        )
        return xp.where(fb > 0.0, a + (b - a) * fa / xp.where(fb > fa, fa - fb, -one), one)


def shrunk(command: Array, rows: Array, low: Array, high: Array) -> Array:
    """The longest multiples, at most 1, of commands (N, k) with ``low <= rows @ command <= high``."""
    xp = array_namespace(command)
    reached = command @ rows.T
    excess = xp.where(reached > 0, reached / xp.clip(high, 1e-9, None), reached / xp.clip(low, None, -1e-9))
    return command / xp.clip(xp.max(excess, axis=-1, keepdims=True), 1.0, None)


def _solve(matrix: Array, vector: Array) -> Array:
    """Solutions (N, k) for matrices (N or 1, k, k) and vectors (N, k)."""
    return array_namespace(matrix, vector).linalg.solve(matrix, vector[..., None])[..., 0]
