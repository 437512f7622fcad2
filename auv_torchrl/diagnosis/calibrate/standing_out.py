"""Which members of a family depart from the others by more than sound ones do.

A correction of a vehicle's file frees the gain of every thruster, and so takes up a fault of one of them. What all
thrusters lose together is an error of the file, or the volts. What one loses beside the others is a fault. Sound
thrusters of one make differ by some per cent: they are worn, and stand in the wake of the frame. Where the others
differ by more, the correction has taken up what no gain does, and one that differs as much is no outlier.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.calibrate.parameters import Coefficient, shared_family
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import DIFFER_BY, FEWEST_OF_FAMILY, WORTH_AN_EFFECT
from auv_torchrl.sysid.windows import MEDIAN_TO_DEVIATION

LEAST = 1e-9  # of a mean, in units of the file's value: that of members that give nothing together


@dataclass(frozen=True)
class Outlier:
    """A member that stands out."""

    effect: str
    member: str
    ratio: float  # to the mean of the others
    probability: float


def standing_out(coefficients: Sequence[Coefficient], values: Floats, covariance: Floats) -> tuple[Outlier, ...]:
    """The members that stand out, the surest first.

    The ratio of a member to the mean of the others is 1 within ``DIFFER_BY``, or what the others differ by, where all
    are sound. It may be anything between nothing and twice as much, either way round, where that member is at fault.

    Args:
        coefficients: (k,) what was fitted.
        values: (k,) as fitted.
        covariance: (k, k) of the values.
    """
    families: dict[tuple[str, str], list[int]] = {}
    for place, c in enumerate(coefficients):
        family = shared_family(c.effect, c.member)
        if family is not None and c.nominal:
            families.setdefault(family, []).append(place)
    from scipy.special import expit  # here: it takes long to import

    nominal = np.array([c.nominal or 1.0 for c in coefficients])
    values, covariance = values / nominal, covariance / np.outer(nominal, nominal)
    found = []
    for members in families.values():
        while len(members) > FEWEST_OF_FAMILY:
            count = len(members)
            odds = {
                place: _log_odds(
                    *_to_others(place, members, values, covariance), _differ_by(place, members, values), count
                )
                for place in members
            }
            first = max(odds, key=lambda place: odds[place])
            if odds[first] <= 0:
                break
            ratio, _ = _to_others(first, members, values, covariance)
            one = coefficients[first]
            found.append(Outlier(one.effect, one.member, ratio, float(expit(odds[first]))))
            members = [place for place in members if place != first]
    return tuple(sorted(found, key=lambda one: -one.probability))


def _to_others(place: int, members: Sequence[int], values: Floats, covariance: Floats) -> tuple[float, float]:
    """A member as a multiple of the mean of the others, and the standard deviation of that."""
    others = [one for one in members if one != place]
    mean = float(values[others].mean())
    ratio = float(values[place]) / mean
    slope = np.zeros(len(values))
    slope[place], slope[others] = 1 / mean, -ratio / (mean * len(others))
    return ratio, float(np.sqrt(max(slope @ covariance @ slope, 0.0)))


def _differ_by(place: int, members: Sequence[int], values: Floats) -> float:
    """By which share of their mean the members differ but for one, by the median: another outlier plays no part."""
    others = values[[one for one in members if one != place]]
    apart = MEDIAN_TO_DEVIATION * float(np.median(np.abs(others - np.median(others))))
    return max(DIFFER_BY, apart / max(abs(float(others.mean())), LEAST))


def _log_odds(ratio: float, deviation: float, differ_by: float, count: int) -> float:
    """Log odds that one of a ``count`` is at fault, and not as the others are, which differ by a share."""
    sound = np.hypot(deviation, differ_by * np.sqrt(1 + 1 / (count - 1)))
    faulty = np.hypot(deviation, 1.0)
    off = ratio - 1.0
    return float(0.5 * (off / sound) ** 2 - 0.5 * (off / faulty) ** 2 + np.log(sound / faulty)) - WORTH_AN_EFFECT
