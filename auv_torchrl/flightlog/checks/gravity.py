"""Whether an accelerometer keeps to unit and frame of the format: m/s^2, (0, 0, -9.8) at rest, forward, right, down.

A vehicle under water is pushed by tenths of a metre per second squared, so that the mean of what is felt is its weight,
along the axes of a body whose roll and pitch the log tells, or which is taken to be level.
"""

from dataclasses import replace

import numpy as np

from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.log import ACCELERATION, POSE, Episode, Floats
from auv_torchrl.vehicle.fields import GRAVITY

UNITS = {"g": GRAVITY, "mg": GRAVITY * 1e-3, "feet per second squared": 0.3048}  # m/s^2 in one of each
NAMED_WITHIN = 0.08  # relative, of the weight: no accelerometer is as far off, and no two of these units are as near
FITS = 0.35  # of the weight, by which means may miss it: 3 m/s^2, more than any bias that is looked for
REMEDY = "Log specific force in m/s^2 along forward, right, down: az is about -9.8 at rest"


def check_gravity(
    episodes: tuple[Episode, ...], axes: tuple[str, ...], units_known: bool = False
) -> tuple[tuple[Episode, ...], tuple[str, ...], list[Finding]]:
    """The episodes with accelerations in m/s^2, without those in which the weight is not where it belongs.

    Where the units are known nothing is converted.
    """
    felt = tuple(axis for axis in ACCELERATION if axis in axes)
    if not felt:
        return episodes, axes, []
    if "az" not in felt:
        return _left_out(episodes, axes, felt, "has no az, without which nothing tells its unit and its frame")
    columns = [ACCELERATION.index(axis) for axis in felt]
    found = np.concatenate([e.acceleration[:, columns] for e in episodes if e.acceleration is not None])
    weight = np.concatenate([_weight(e)[:, columns] for e in episodes])
    known = np.isfinite(found).all(-1)
    mean, expected = (np.median(values[known], axis=0) for values in (found, weight))
    if _near(mean, expected):
        return episodes, axes, []
    size = float(np.linalg.norm(mean) / np.linalg.norm(expected))
    unit = next((name for name, one in UNITS.items() if abs(size * one - 1) < NAMED_WITHIN), "")
    if unit and not units_known:
        factor = UNITS[unit]
        if _near(factor * mean, expected):
            scaled = tuple(replace(e, acceleration=_times(factor, e.acceleration)) for e in episodes)
            verb = "was" if len(felt) == 1 else "were"
            why = f"the weight in it is {np.linalg.norm(mean):.3g}"
            sentence = f"{', '.join(felt)} {verb} in {unit} ({why}) and {verb} converted"
            return scaled, axes, [Finding(Severity.WARNING, "acceleration_unit", sentence, REMEDY, felt)]
        mean = factor * mean
    if mean[-1] > (1 - FITS) * GRAVITY:
        return _left_out(episodes, axes, felt, "has its weight upwards: z is up, or its signs are turned")
    if np.linalg.norm(mean) < FITS * GRAVITY:
        return _left_out(episodes, axes, felt, "feels no weight: it was taken out, or it is no accelerometer")
    weights = ", ".join(f"{axis} {value:.3g}" for axis, value in zip(felt, mean.tolist(), strict=True))
    return _left_out(episodes, axes, felt, f"feels its weight elsewhere than it is ({weights})")


def _times(factor: float, felt: Floats | None) -> Floats | None:
    return None if felt is None else factor * felt


def _near(mean: Floats, expected: Floats) -> bool:
    return bool(np.linalg.norm(mean - expected) < FITS * GRAVITY)


def _weight(episode: Episode) -> Floats:
    """What is felt at rest (T, 3) in m/s^2, in the attitude of each row; level where it is not measured."""
    roll, pitch = (np.nan_to_num(episode.pose[:, POSE.index(axis)]) for axis in ("roll", "pitch"))
    down = np.stack([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)], axis=-1)
    return -GRAVITY * down


def _left_out(
    episodes: tuple[Episode, ...], axes: tuple[str, ...], felt: tuple[str, ...], why: str
) -> tuple[tuple[Episode, ...], tuple[str, ...], list[Finding]]:
    sentence = f"the accelerometer {why}; {', '.join(felt)} {'is' if len(felt) == 1 else 'are'} left out"
    finding = Finding(Severity.WARNING, "acceleration_frame", sentence, REMEDY, felt)
    kept = tuple(axis for axis in axes if axis not in felt)
    return tuple(replace(e, acceleration=None) for e in episodes), kept, [finding]
