"""Whether angles and angular rates are in degrees, where no name says so.

A vehicle that turns over has large angles in radians, too, so that their size tells nothing. What tells is, in order:

1. no vehicle turns faster than :data:`FASTEST_TURN`;
2. an angle that is wrapped jumps by a whole turn, 2 pi or 360;
3. the rotation from sample to sample is what p, q, r say it is, in one pair of units;
4. the vehicle answers its thrusters as its file says, in one of both.

The first three compare rotations, not angles: roll and yaw jump where the vehicle points straight up, its attitude
does not. What stays open is read as radians, with a finding where the angles are beyond what a level vehicle has.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from auv_torchrl.flightlog.checks.motion import blocks, force_balance, responses
from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.log import ANGLES, POSE, VELOCITY, Episode, Floats
from auv_torchrl.physics.kinematics import quaternion_from_euler
from auv_torchrl.vehicle import Vehicle

DEGREES = 180.0 / np.pi
FASTEST_TURN = 15.0  # rad/s; Table 1's vehicle turns at 6
RATES = ("p", "q", "r")  # about the axes of roll, pitch and yaw
_CLEARLY = 8.0  # a ratio above this, about the square root of 57.3, tells degrees from radians
_ATTITUDE = slice(3, 6)
_LAG_S = 0.1  # over which a rotation is measured: noise of 2 degrees is 0.5 rad/s of it
_USUAL = 95  # per cent of the rotations must be possible: estimates of an attitude leap now and then
_TURN, _CIRCLE = 2 * np.pi, 360.0
_ROUNDING = 0.1  # rad beyond the ends of a wrapped angle
_WRAP = 0.85  # of a whole turn, from which a step is a wrap
_EXPLAINED = 0.4  # share of the rates that the rotation must explain to be compared,
_WORSE = 0.2  # and by which another pair of units must be worse to be ruled out
_OBEYS = 0.5  # balance of forces that one unit must reach, while the other leaves twice as much of it open

Units = tuple[bool, bool]  # whether the angles, and whether the rates, are in degrees


def convert_degrees(
    episodes: tuple[Episode, ...], axes: tuple[str, ...], vehicle: Vehicle, settled: frozenset[str] = frozenset()
) -> tuple[tuple[Episode, ...], list[Finding]]:
    """Angles and angular rates in radians, converted where they are in degrees; those of ``settled`` axes stand."""
    angles = tuple(axis for axis in ANGLES if axis in axes and axis not in settled)
    rates = tuple(axis for axis in RATES if axis in axes and axis not in settled)
    likely = {(a, r) for a in ({False, True} if angles else {False}) for r in ({False, True} if rates else {False})}
    why: dict[str, str] = {}
    for witness in (_impossible, _wrapped, _by_rates, _by_yaw):
        for ruled_out, sentence in witness(episodes, angles, rates, axes, vehicle):
            if likely - ruled_out and likely & ruled_out:
                before, likely = likely, likely - ruled_out
                why |= _decided(before, likely, sentence)
    findings = []
    if {a for a, _ in likely} == {False, True} and _beyond_level(episodes, angles):
        felt_unit = _by_forces(episodes, angles, vehicle)
        if felt_unit is None:
            findings.append(_open_finding(angles))
        else:
            likely = {units for units in likely if units[0] is felt_unit}
            why["angles"] = "the vehicle then answers its thrusters"
    in_degrees = all(a for a, _ in likely), all(r for _, r in likely)
    if angles and in_degrees[0]:
        episodes = tuple(replace(e, pose=_scaled(e.pose, angles, POSE)) for e in episodes)
        findings.append(_degrees_finding(angles, why["angles"]))
    if rates and in_degrees[1]:
        episodes = tuple(replace(e, velocity=_scaled(e.velocity, rates, VELOCITY)) for e in episodes)
        findings.append(_degrees_finding(rates, why["rates"]))
    return episodes, findings


def _decided(before: set[Units], after: set[Units], sentence: str) -> dict[str, str]:
    """Which of angles and rates a witness has settled."""
    kinds = {"angles": 0, "rates": 1}
    return {
        kind: sentence for kind, i in kinds.items()
        if len({units[i] for units in before}) > 1 and len({units[i] for units in after}) == 1
    }  # fmt: skip


def _degrees_finding(columns: tuple[str, ...], why: str) -> Finding:
    verb = ("is", "was") if len(columns) == 1 else ("are", "were")
    sentence = f"{', '.join(columns)} {verb[0]} in degrees ({why}) and {verb[1]} converted"
    return Finding(Severity.WARNING, "degrees", sentence, "Log radians", columns)


def _open_finding(angles: tuple[str, ...]) -> Finding:
    verb = "is" if len(angles) == 1 else "are"
    sentence = (
        f"{', '.join(angles)} {verb} read as radians, in which the vehicle turns over or counts its turns; nothing in "
        "the log tells whether they are degrees"
    )
    remedy = f"If they are degrees, name them {', '.join(f'{angle}_deg' for angle in angles)}"
    return Finding(Severity.WARNING, "degrees_or_radians", sentence, remedy, angles, limits=True)


def _scaled(values: Floats, columns: tuple[str, ...], names: tuple[str, ...]) -> Floats:
    values = values.copy()
    values[:, [names.index(column) for column in columns]] /= DEGREES
    return values


_RADIANS = {(False, False), (False, True)}
_IN_DEGREES = {(True, False), (True, True)}
_RADIANS_PER_SECOND = {(False, False), (True, False)}


def _impossible(
    episodes: tuple[Episode, ...], angles: tuple[str, ...], rates: tuple[str, ...], axes: tuple[str, ...], _: Vehicle
) -> Iterator[tuple[set[Units], str]]:
    """What would be faster than any vehicle turns, if it were in radians."""
    if angles:
        turned = np.concatenate([np.linalg.norm(_rotation(e, angles, False)[1], axis=-1) for e in episodes])
        if (speed := _usual(turned)) > FASTEST_TURN:
            yield _RADIANS, f"in radians the vehicle would turn at {speed:.0f} rad/s"
    if rates:
        columns = [VELOCITY.index(rate) for rate in rates]
        speed = max(_usual(np.abs(np.concatenate([e.velocity[:, column] for e in episodes]))) for column in columns)
        if speed > FASTEST_TURN:
            yield _RADIANS_PER_SECOND, f"in radians it would turn at {speed:.0f} rad/s"


def _wrapped(
    episodes: tuple[Episode, ...], angles: tuple[str, ...], rates: tuple[str, ...], axes: tuple[str, ...], _: Vehicle
) -> Iterator[tuple[set[Units], str]]:
    """Angles that stay within one turn and jump from its one end to the other."""
    for angle in angles:
        values = [e.pose[:, POSE.index(angle)] for e in episodes]
        everything = np.concatenate(values)
        if not np.isfinite(everything).any():
            continue
        low, high = float(np.nanmin(everything)), float(np.nanmax(everything))
        step = max((float(np.nanmax(np.abs(np.diff(v)), initial=0.0)) for v in values), default=0.0)
        for turn, ruled_out in ((_TURN, _IN_DEGREES), (_CIRCLE, _RADIANS)):
            rounding = _ROUNDING * turn / _TURN
            inside = (low >= -rounding and high <= turn + rounding) or max(-low, high) <= turn / 2 + rounding
            if inside and step > _WRAP * turn:
                yield ruled_out, f"{angle} jumps by {step:.0f}"


def _by_rates(
    episodes: tuple[Episode, ...], angles: tuple[str, ...], rates: tuple[str, ...], axes: tuple[str, ...], _: Vehicle
) -> Iterator[tuple[set[Units], str]]:
    """How well the rotation explains the rates, by pair of units."""
    measured = [i for i, (angle, rate) in enumerate(zip(ANGLES, RATES, strict=True)) if {angle, rate} <= set(axes)]
    if not measured:
        return
    score: dict[Units, float] = {}
    for in_degrees in {False, bool(angles)}:
        parts = [_rotation(e, angles, in_degrees) for e in episodes]
        turned = np.concatenate([rotation for _, rotation in parts])[:, measured]
        means = [_mean_rate(e, lag)[:, measured] for e, (lag, _) in zip(episodes, parts, strict=True)]
        mean_rates = np.concatenate(means)
        there = np.isfinite(turned).all(-1) & np.isfinite(mean_rates).all(-1)
        for rates_in_degrees in {False, bool(rates)}:
            rate = mean_rates[there] / (DEGREES if rates_in_degrees else 1.0)
            size = np.abs(rate).sum()
            if not size:
                return
            score[in_degrees, rates_in_degrees] = 1.0 - float(np.abs(turned[there] - rate).sum() / size)
    best = max(score.values())
    if best > _EXPLAINED:
        worse = {units for units, share in score.items() if share < best - _WORSE}
        yield worse, "only then the attitude turns as p, q, r say"


def _by_yaw(
    episodes: tuple[Episode, ...], angles: tuple[str, ...], rates: tuple[str, ...], axes: tuple[str, ...], v: Vehicle
) -> Iterator[tuple[set[Units], str]]:
    """A heading that answers the thrusters far too strongly, where no rate tells."""
    if "yaw" not in angles or "r" in axes:
        return
    yaw = responses(blocks(episodes, v)).get("yaw")
    if yaw and yaw.correlation > 0.5 and yaw.slope > _CLEARLY:
        yield _RADIANS, f"yaw answers the thrusters {yaw.slope:.0f} times too strongly"


def _by_forces(episodes: tuple[Episode, ...], angles: tuple[str, ...], vehicle: Vehicle) -> bool | None:
    """Whether the vehicle follows its thrusters in degrees (True) or in radians (False) alone; None otherwise."""
    episodes = tuple(replace(e, velocity=np.full_like(e.velocity, np.nan)) for e in episodes)  # they need no angles
    converted = tuple(replace(e, pose=_scaled(e.pose, angles, POSE)) for e in episodes)
    left = {unit: 1 - force_balance(blocks(read, vehicle)) for unit, read in ((False, episodes), (True, converted))}
    best = min(left, key=lambda unit: left[unit])
    return best if left[best] < min(1 - _OBEYS, left[not best] / 2) else None


def _beyond_level(episodes: tuple[Episode, ...], angles: tuple[str, ...]) -> bool:
    """Whether the angles, in radians, are beyond one turn, or the pitch beyond straight up."""
    most = {"roll": _TURN, "pitch": np.pi / 2, "yaw": _TURN}
    return any(
        np.nanmax(np.abs(e.pose[:, POSE.index(angle)]), initial=0.0) > most[angle] + 2 * _ROUNDING
        for e in episodes for angle in angles
    )  # fmt: skip


def _usual(speed: Floats) -> float:
    return float(np.nanpercentile(speed, _USUAL)) if np.isfinite(speed).any() else 0.0


def _rotation(e: Episode, angles: tuple[str, ...], in_degrees: bool) -> tuple[int, Floats]:
    """Lag in samples, and mean rate (T - lag, 3) in rad/s, body, of the rotation over it.

    Roll, pitch and yaw that are not measured are 0; NaN where one of those that are is missing.
    """
    attitude = _scaled(e.pose, angles, POSE)[:, _ATTITUDE] if in_degrees else e.pose[:, _ATTITUDE]
    attitude = np.where(np.isfinite(attitude).any(0), attitude, 0.0)
    lag = min(max(1, round(_LAG_S / float(np.median(np.diff(e.t))))), len(e) - 1)
    q = np.asarray(quaternion_from_euler(*attitude.T))
    w, v = q[:, :1], q[:, 1:]
    (w0, v0), (w1, v1) = (w[:-lag], v[:-lag]), (w[lag:], v[lag:])
    scalar = w0 * w1 + (v0 * v1).sum(-1, keepdims=True)
    vector = w0 * v1 - w1 * v0 - np.cross(v0, v1)
    vector = np.where(scalar < 0, -vector, vector)
    sine = np.linalg.norm(vector, axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, np.abs(scalar))
    return lag, vector * angle / np.maximum(sine, 1e-12) / (e.t[lag:] - e.t[:-lag])[:, None]


def _mean_rate(e: Episode, lag: int) -> Floats:
    """p, q, r (T - lag, 3) as logged, mean from each sample to the one ``lag`` later."""
    rate = e.velocity[:, _ATTITUDE]
    width = np.diff(e.t)[:, None]
    passed = np.concatenate([np.zeros((1, 3)), np.cumsum(np.nan_to_num((rate[1:] + rate[:-1]) / 2) * width, axis=0)])
    mean = (passed[lag:] - passed[:-lag]) / (e.t[lag:] - e.t[:-lag])[:, None]
    return np.where(np.isfinite(rate).any(0), mean, np.nan)
