"""Training over what a vehicle's own file says is uncertain in it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from auv_torchrl.diagnosis.calibrate.kept import read_kept
from auv_torchrl.diagnosis.calibrate.uncertainty import read_uncertainty
from auv_torchrl.envs.randomize import TOGETHER
from auv_torchrl.vehicle import Vehicle

UNCERTAINTY = "uncertainty"  # of a randomization: standard deviations to each side


def spelt_out(ranges: Mapping[str, Any], content: Mapping[str, Any], vehicle: Vehicle) -> dict[str, Any]:
    """A randomization in which ``uncertainty: 2.0`` is replaced by the ranges that it stands for.

    Args:
        ranges: as in ``conf/randomization``; the effects in it stand beside those of the vehicle's file.
        content: the vehicle's file.
        vehicle: that it describes, empty batch.

    Raises:
        ValueError: for a file that says nothing is uncertain, or no positive number.
    """
    given = dict(ranges)
    if UNCERTAINTY not in given:
        return given
    widths = given.pop(UNCERTAINTY)
    if isinstance(widths, bool) or not isinstance(widths, int | float) or not 0 < widths < float("inf"):
        raise ValueError(f"randomization.{UNCERTAINTY} is {widths!r}: give a number of standard deviations above 0")
    coefficients = read_uncertainty(content.get("uncertainty"), vehicle)
    if not coefficients:
        raise ValueError(
            f"randomization.{UNCERTAINTY}: the file of vehicle={content.get('name', 'unnamed')} says nothing is "
            "uncertain: give randomization=default, or a vehicle with a section uncertainty"
        )
    kept = read_kept(content.get("calibration"), coefficients)
    taken = [place for place, c in enumerate(coefficients) if c.effect not in given]
    found: dict[str, Any] = {}
    for c in (coefficients[place] for place in taken):
        low, high = c.nominal - widths * c.width, c.nominal + widths * c.width
        found.setdefault(c.effect, {})[c.member] = [max(low, c.low), min(high, c.high)]
    found |= given
    return found if kept is None or not taken else {**found, TOGETHER: _triangle(kept.together, taken)}


def _triangle(root: np.ndarray, taken: Sequence[int]) -> list[list[float]]:
    """Of some of the numbers, the lower triangle (rows of 1, 2, ...) that makes their correlation."""
    some = root[list(taken)]
    lower = np.transpose(np.linalg.qr(some.T, mode="r"))
    lower = lower * np.where(np.diag(lower) < 0, -1.0, 1.0)
    return [row[: i + 1] for i, row in enumerate(lower.tolist())]
