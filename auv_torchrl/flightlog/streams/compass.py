"""Whether a compass turns with the current that the thrusters draw, by what it measured itself.

The field of a current is added to that of the earth, along the axes of the body, in proportion. So it is looked for
there, beside all that a compass is off by otherwise: an offset, soft iron, and a heading that drifts. The heading is
that of the gyro, because a filter that follows the compass follows its errors.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.signals import integral, interpolate
from auv_torchrl.flightlog.streams.stream import Floats, Stream, Streams
from auv_torchrl.physics.kinematics import (
    conjugate,
    least_turn,
    matvec,
    quaternion_from_euler,
    quaternion_product,
    rotation_matrix,
)
from auv_torchrl.quantities import percent, quantity

COMPASSES = ("compass", "compass_2", "compass_3")  # streams
SURE = 0.999  # quantile that what is found must exceed if there were nothing
LEAST_RAD = 0.05  # heading error at the largest current, below which it does no harm: 3 degrees
USUAL = 0.95  # quantile of the current that counts as its largest; what is below the opposite one as its least
SAMPLES = 4000  # of a compass that are looked at, at most; more of them say the same again
MOST_SAMPLES = 20_000  # that are kept of a long log
MOST_ANGLES = 1_000_000  # likewise of the attitude
DRIFT_S = 20.0  # within which the heading of the gyro is straight; a current that changes slower shows nothing
MOST_DRIFTS = 60  # knots of that; longer logs are straight for longer
BLOCK_S = 10.0  # errors of samples that are farther apart are independent
FEWEST_BLOCKS = 6
ROUNDS = 3  # of the fit, which is linear in the drift
LEVEL = 0.5  # cosine of the tilt; beyond it headings say little
PAUSE_S = 1.0  # between attitudes, over which a gyro is not integrated
CURRENT, OUTPUTS = "A", "of all thrusters at full command"


class Interference(NamedTuple):
    """The field that a compass felt beside that of the earth, per unit of what is drawn."""

    field: Floats  # (3,) mG, forward, right, down
    covariance: Floats  # (3, 3)
    horizontal: float  # mG, of the earth's field
    blocks: int  # of independent errors

    @property
    def slope(self) -> float:
        """Largest error of the heading, over all headings of a level vehicle, in rad per unit."""
        return float(np.linalg.norm(self.field[:2])) / self.horizontal

    @property
    def error(self) -> float:
        """Standard error of the slope."""
        along = self.field[:2] / np.linalg.norm(self.field[:2])
        return float(np.sqrt(along @ self.covariance[:2, :2] @ along)) / self.horizontal

    @property
    def is_sure(self) -> bool:
        """Whether a field along the horizontal axes is there at all."""
        across = self.field[:2]
        size = float(across @ np.linalg.solve(self.covariance[:2, :2], across)) / 2
        from scipy.special import fdtri  # of the F distribution; scipy would be half of what `--help` waits for

        return size > float(fdtri(2, self.blocks - 2, SURE))


@threadpool_limits.wrap(limits=1)  # the matrices are slim: a second thread only waits
def check_compass(streams: Streams, parameters: Mapping[str, float]) -> list[Finding]:
    """A finding for each compass whose heading the current turns by more than 3 degrees."""
    return list(_turned(streams, parameters))


def _turned(streams: Streams, parameters: Mapping[str, float]) -> Iterator[Finding]:
    attitude, (drawn, unit) = streams.streams.get("attitude"), _drawn(streams)
    if attitude is None or drawn is None or len(attitude) < 2 or not set(COMPASSES) & set(streams.streams):
        return
    every = 1 + len(attitude) // MOST_ANGLES
    attitude = replace(attitude, t=attitude.t[::every], values=attitude.values[::every])
    rotation = rotation_matrix(quaternion_from_euler(*_steered(attitude, streams.streams.get("gyro")).T))
    for number, name in enumerate(COMPASSES, start=1):
        compass = streams.streams.get(name)
        if compass is None or parameters.get(_named("COMPASS_USE", number), 1.0) == 0:
            continue
        inside = (compass.t >= max(attitude.t[0], drawn.t[0])) & (compass.t <= min(attitude.t[-1], drawn.t[-1]))
        kept = np.flatnonzero(inside)[:: 1 + int(inside.sum()) // SAMPLES]
        t = compass.t[kept]
        load = np.interp(t, drawn.t, drawn.values[:, 0])
        found = interference(t, compass.values[kept], _between(attitude.t, rotation, t), load)
        most = float(np.subtract(*np.quantile(load, (USUAL, 1 - USUAL)))) if len(t) else 0.0
        if found is not None and found.is_sure and found.slope * most > LEAST_RAD:
            yield _finding(found, number, most, unit, parameters)


def _between(known: Floats, rotation: Floats, t: Floats) -> Floats:
    """Rotations (T, 3, 3) at times that lie between neighbours that hardly differ."""
    after = np.clip(np.searchsorted(known, t), 1, len(known) - 1)
    share = ((t - known[after - 1]) / (known[after] - known[after - 1]))[:, None, None]
    return (1 - share) * rotation[after - 1] + share * rotation[after]


def _named(parameter: str, number: int) -> str:
    """``COMPASS_MOT_X`` of the first compass, ``COMPASS_MOT2_X`` of the second."""
    first, second, *rest = parameter.split("_")
    return "_".join([first, second + (str(number) if number > 1 else ""), *rest])


def _finding(found: Interference, number: int, most: float, unit: str, parameters: Mapping[str, float]) -> Finding:
    per = "per ampere" if unit == CURRENT else "with all of them"
    size = f"{quantity(most, CURRENT)}" if unit == CURRENT else f"{percent(most)} {unit}"
    sentence = (
        f"compass {number} turns with the current drawn: its heading is off by up to "
        f"{quantity(found.slope * most, 'rad', 2)} at {size} ({quantity(found.slope, 'rad', 2)} {per}, standard error "
        f"{quantity(found.error, 'rad', 1)})"
    )
    remedy = "Move the compass away from the power cables and speed controllers, or twist the cables together"
    way = parameters.get("COMPASS_MOTCT", 0.0)  # of taking it out: 0 none, 1 by throttle, 2 by current
    if unit == CURRENT and way != 1:
        names = [_named(f"COMPASS_MOT_{axis}", number) for axis in "XYZ"]
        before = [parameters.get(name, 0.0) if way == 2 else 0.0 for name in names]
        new = [old - float(value) for old, value in zip(before, found.field, strict=True)]
        set_to = ", ".join(f"{name} to {value:.2f}" for name, value in zip(names, new, strict=True))
        remedy += f"; or let the autopilot take it out: set COMPASS_MOTCT to 2 and {set_to}"
    return Finding(Severity.WARNING, "compass_interference", sentence, remedy, ("yaw",))


def _drawn(streams: Streams) -> tuple[Stream | None, str]:
    """The current in A, or where none is measured the share of full command that all outputs have together."""
    battery, outputs = streams.streams.get("battery"), streams.streams.get("outputs")
    if battery is not None and "current" in battery.channels:
        current = battery.values[:, [battery.channels.index("current")]]
        if np.isfinite(current).all() and np.ptp(current) > 0 and current.min() >= 0:
            return replace(battery, values=current), CURRENT
    if outputs is None or not streams.vehicle.motors:
        return None, ""
    pulses = np.nan_to_num(outputs.values[:, : streams.vehicle.motors], nan=1500.0)
    share = np.abs(np.where(pulses > 0, pulses - 1500.0, 0.0)).mean(-1, keepdims=True) / 400.0  # us
    return replace(outputs, values=share), OUTPUTS


def _steered(attitude: Stream, gyro: Stream | None) -> Floats:
    """Angles (T, 3) without what the filter turned the heading by otherwise than the gyro felt."""
    angles = attitude.values
    if gyro is None or len(gyro) < 2:
        return angles
    q = quaternion_from_euler(*angles.T)
    turned = np.diff(interpolate(attitude.t, gyro.t, integral(gyro.t, gyro.values)), axis=0)
    size = np.linalg.norm(turned, axis=-1, keepdims=True)
    step = np.concatenate([np.cos(size / 2), 0.5 * np.sinc(size / (2 * np.pi)) * turned], axis=-1)
    expected = quaternion_product(q[:-1], step)
    beside = quaternion_product(q[1:], conjugate(expected))  # in the earth frame
    correction = least_turn(2 * np.arctan2(beside[:, 3], beside[:, 0]))
    correction[(np.diff(attitude.t) > PAUSE_S) | ~np.isfinite(correction)] = 0.0
    heading = angles[:, 2] - np.concatenate([[0.0], np.cumsum(correction)])
    return np.concatenate([angles[:, :2], heading[:, None]], axis=-1)


def interference(t: Floats, felt: Floats, rotation: Floats, drawn: Floats) -> Interference | None:
    """The field per unit drawn; None where too little was flown, or nothing was drawn.

    Args:
        t: (T,) s.
        felt: (T, 3) mG, forward, right, down.
        rotation: (T, 3, 3) from body to earth, by a heading that drifts.
        drawn: (T,) A.
    """
    good = np.isfinite(felt).all(-1) & np.isfinite(rotation).all((-1, -2)) & (rotation[:, 2, 2] > LEVEL)
    t, felt, rotation, drawn = t[good], felt[good], rotation[good], drawn[good]
    block = np.unique((t / BLOCK_S).astype(int), return_inverse=True)[1] if len(t) else np.zeros(0, int)
    blocks = int(block.max()) + 1 if len(t) else 0
    if blocks < FEWEST_BLOCKS or np.ptp(drawn) == 0:
        return None
    knots = _knots(t)
    fit = _fitted(felt, rotation, drawn, knots, np.zeros(len(t)), _earth_field(felt, rotation))
    for _ in range(ROUNDS - 1):
        fit = _fitted(felt, rotation, drawn, knots, fit.drift, fit.earth)
    errors = (fit.pushed * (fit.left - fit.pushed @ fit.field)[:, None]).reshape(len(t), 3, 3).sum(1)  # (T, 3)
    scores = np.stack([np.bincount(block, column, blocks) for column in errors.T], -1)
    inverse = np.linalg.pinv(fit.pushed.T @ fit.pushed)
    covariance = inverse @ (scores.T @ scores) @ inverse * blocks / (blocks - 1)
    return Interference(fit.field, covariance, max(float(np.hypot(*fit.earth[:2])), 1e-9), blocks)


class _Fit(NamedTuple):
    field: Floats  # (3,) mG per unit drawn
    pushed: Floats  # (3 T, 3) what a unit of it does, beyond all that is as good an explanation
    left: Floats  # (3 T,) mG, what was felt, likewise
    drift: Floats  # (T,) rad that headings are larger by
    earth: Floats  # (3,) mG


def _fitted(felt: Floats, rotation: Floats, drawn: Floats, knots: Floats, drift: Floats, earth: Floats) -> _Fit:
    """One round, from the drift and the field of the earth that are known so far."""
    columns = _otherwise(_turn_north(rotation, drift), earth, knots)
    base = np.linalg.qr(columns)[0]
    felt_flat, load = felt.reshape(-1), np.kron(drawn[:, None], np.eye(3))
    left, pushed = (given - base @ (base.T @ given) for given in (felt_flat, load))
    field = np.asarray(np.linalg.lstsq(pushed, left, rcond=None)[0], np.float64)
    rest = np.linalg.lstsq(columns, felt_flat - load @ field, rcond=None)[0]
    drift = drift + knots @ rest[-knots.shape[1] :]
    return _Fit(field, pushed, left, drift, _earth_field(felt - drawn[:, None] * field, _turn_north(rotation, drift)))


def _turn_north(rotation: Floats, drift: Floats) -> Floats:
    """Rotations (T, 3, 3) whose headings are larger by ``drift`` (T,) rad."""
    zero, one = np.zeros_like(drift), np.ones_like(drift)
    cos, sin = np.cos(drift), np.sin(drift)
    turn = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], -1).reshape(-1, 3, 3)
    return turn @ rotation


def _earth_field(felt: Floats, rotation: Floats) -> Floats:
    """The field (3,) mG in the earth frame that explains most, beside an offset in the body."""
    ways = rotation.mT.reshape(-1, 3)
    columns = np.concatenate([ways, np.tile(np.eye(3), (len(felt), 1))], axis=-1)
    return np.asarray(np.linalg.lstsq(columns, felt.reshape(-1), rcond=None)[0][:3], np.float64)


def _knots(t: Floats) -> Floats:
    """Hats (T, k) over time whose sums are lines that bend every DRIFT_S."""
    count = int(np.clip((t[-1] - t[0]) / DRIFT_S, 1, MOST_DRIFTS)) + 1
    at = np.linspace(t[0], t[-1], count)
    return np.stack([np.interp(t, at, row) for row in np.eye(count)], -1)


def _otherwise(rotation: Floats, earth: Floats, knots: Floats) -> Floats:
    """What a compass may be off by besides, (3 T, k): the field, soft iron, an offset, and a heading that drifts."""
    here = matvec(rotation.mT, earth)  # (T, 3) what it should feel
    count = len(here)
    iron = np.einsum("ti,jk->tjki", here, np.eye(3)).reshape(3 * count, 9)  # each axis by each field
    offset = np.tile(np.eye(3), (count, 1))
    turned = matvec(rotation.mT, np.array([earth[1], -earth[0], 0.0]))  # by a heading that is larger by 1 rad
    drifting = (turned[:, :, None] * knots[:, None, :]).reshape(3 * count, -1)
    return np.concatenate([iron, offset, drifting], axis=-1)
