"""Units that the format asks for and logs often miss: seconds, commands in [-1, 1], radians."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.log import ANGLES, POSE, VELOCITY, Episode, Floats
from auv_torchrl.flightlog.motion import blocks, responses
from auv_torchrl.vehicle import Vehicle

SLOWEST_S = 2.0  # a log with a longer sampling interval shows no dynamics, and its t is probably not in seconds
COMMAND_LIMIT = 1.5  # rounding and mixing overshoot 1, other units exceed this
GLITCH_SHARE = 0.01
FASTEST_TURN = 15.0  # rad/s; Table 1's vehicle turns at 6
DEGREES = 180.0 / np.pi
_CLEARLY = 8.0  # a ratio above this, about the square root of 57.3, tells degrees from radians
_ATTITUDE = slice(3, 6)


def check_commands(name: str, columns: Sequence[str], values: Floats, row: np.ndarray) -> list[Finding]:
    """Commands (T, k) outside [-1, 1]: glitches become NaN in place.

    Raises:
        FlightLogError: if the commands are in another unit.
    """
    findings = []
    size = np.abs(values)
    for i, column in enumerate(columns):
        beyond = np.flatnonzero(size[:, i] > COMMAND_LIMIT)
        if len(beyond) > GLITCH_SHARE * len(values):
            low, high = np.nanmin(values[:, i]), np.nanmax(values[:, i])
            remedy = (
                "(pulse - 1500) / 400" if high > 500 else "command / 100" if high > 10 else "command / full command"
            )
            raise FlightLogError(f"{name}: {column} lies in [{low:g}, {high:g}]: give commands in [-1, 1], as {remedy}")
        over = np.flatnonzero(size[:, i] > 1.0 + 1e-6)
        if len(beyond):
            code, where = "command_glitch", beyond
            sentence = f"{column} leaves [-1, 1] in {len(beyond)} rows, which are left out"
            values[beyond, i] = np.nan
        elif len(over):
            code, where = "command_clipped", over
            sentence = f"{column} exceeds 1 by up to {np.nanmax(size[:, i]) - 1:.3f} and is clipped"
        else:
            continue
        rows = (int(row[where[0]]), int(row[where[-1]]))
        findings.append(Finding(Severity.WARNING, code, sentence, "Give commands in [-1, 1]", (column,), rows))
    return findings


def check_time_unit(name: str, t: Floats) -> None:
    """Refuse a log whose samples are seconds apart.

    Raises:
        FlightLogError: naming the likely unit.
    """
    steps = np.abs(np.diff(t[np.isfinite(t)]))  # backwards where the rows are reversed
    steps = steps[steps > 0]
    if len(steps) and (step := float(np.median(steps))) > SLOWEST_S:
        remedy = "t looks like milliseconds or microseconds: give seconds" if step >= 5 else "log at 2 Hz or faster"
        raise FlightLogError(f"{name}: samples are {step:g} s apart in t: {remedy}")


def convert_degrees(
    episodes: tuple[Episode, ...], axes: tuple[str, ...], vehicle: Vehicle, settled: frozenset[str] = frozenset()
) -> tuple[tuple[Episode, ...], list[Finding]]:
    """Angles and angular rates in radians, converted where they evidently are in degrees."""
    angles = tuple(axis for axis in ANGLES if axis in axes)
    rates = tuple(axis for axis in ("p", "q", "r") if axis in axes)
    findings = []
    why = _angles_in_degrees(episodes, vehicle) if angles else ""
    if why:
        episodes = tuple(replace(e, pose=_scaled(e.pose)) for e in episodes)
        findings.append(_degrees_finding(angles, why))
    ratio = _rate_over_r(episodes)
    if rates and (_fast(episodes, VELOCITY.index("r")) or (ratio is not None and ratio < 1 / _CLEARLY)):
        episodes = tuple(replace(e, velocity=_scaled(e.velocity)) for e in episodes)
        findings.append(_degrees_finding(rates, "the heading turns more slowly than r says"))
    return episodes, findings


def _degrees_finding(columns: tuple[str, ...], why: str) -> Finding:
    verb = ("is", "was") if len(columns) == 1 else ("are", "were")
    sentence = f"{', '.join(columns)} {verb[0]} in degrees ({why}) and {verb[1]} converted"
    return Finding(Severity.WARNING, "degrees", sentence, "Log radians", columns)


def _scaled(values: Floats) -> Floats:
    values = values.copy()
    values[:, _ATTITUDE] /= DEGREES
    return values


def _angles_in_degrees(episodes: tuple[Episode, ...], vehicle: Vehicle) -> str:
    """Why the angles must be in degrees; empty where they are not."""
    pitch = np.concatenate([e.pose[:, POSE.index("pitch")] for e in episodes])
    if np.nanmax(np.abs(pitch), initial=0.0) > np.pi / 2 + 0.1:
        return f"pitch reaches {np.nanmax(np.abs(pitch)):.0f}"
    for axis in ("roll", "yaw"):
        column = POSE.index(axis)
        largest = max(float(np.nanmax(np.abs(e.pose[:, column]), initial=0.0)) for e in episodes)
        if largest > 2 * np.pi + 0.2 and (_fast_angle(episodes, column) or _wraps_at_360(episodes, column)):
            return f"{axis} reaches {largest:.0f}"
    ratio = _rate_over_r(episodes)
    if ratio is not None and ratio > _CLEARLY:
        return f"yaw turns {ratio:.0f} times faster than r"
    yaw = responses(blocks(episodes, vehicle)).get("yaw")
    if ratio is None and yaw and yaw.correlation > 0.5 and yaw.slope > _CLEARLY:
        return f"yaw answers the thrusters {yaw.slope:.0f} times too strongly"
    return ""


def _fast_angle(episodes: tuple[Episode, ...], column: int) -> bool:
    speed = [np.abs(np.diff(e.pose[:, column]) / np.diff(e.t)) for e in episodes]
    return bool(np.nanpercentile(np.concatenate(speed), 95) > FASTEST_TURN)


def _fast(episodes: tuple[Episode, ...], column: int) -> bool:
    speed = np.abs(np.concatenate([e.velocity[:, column] for e in episodes]))
    return bool(np.isfinite(speed).any() and np.nanpercentile(speed, 95) > FASTEST_TURN)


def _wraps_at_360(episodes: tuple[Episode, ...], column: int) -> bool:
    jumps = np.concatenate([np.abs(np.diff(e.pose[:, column])) for e in episodes])
    return bool(((jumps > 270) & (jumps < 361)).any())


def _rate_over_r(episodes: tuple[Episode, ...]) -> float | None:
    """Size of d(yaw)/dt over size of r, away from wraps; None where one is not measured or nothing turns."""
    slopes, rates = [], []
    for e in episodes:
        step = np.diff(e.pose[:, POSE.index("yaw")])
        r = e.velocity[:, VELOCITY.index("r")]
        smooth = np.abs(step) < 2.0 * np.nanmedian(np.abs(step)) + 1e-9 if np.isfinite(step).any() else step > 0
        slopes.append(np.abs(step / np.diff(e.t))[smooth])
        rates.append(np.abs((r[1:] + r[:-1]) / 2)[smooth])
    slope, rate = np.concatenate(slopes), np.concatenate(rates)
    if not len(slope) or not np.isfinite(rate).any() or np.nanmedian(rate) < 0.01:
        return None
    return float(np.nanmedian(slope) / np.nanmedian(rate))
