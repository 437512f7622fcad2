"""What several flights of one vehicle share, and by how much each of them differs: random effects."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.calibrate.nuisance import Centred
from auv_torchrl.diagnosis.motion.reduce import Quadratic
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.sysid.bounded import least_within

STATED_FLIGHTS = 2.0  # flights that the stated spread counts for, against those that were flown
ROUNDS = 30


@dataclass(frozen=True)
class Shared:
    """The numbers (k,) of a vehicle over its flights."""

    mean: Floats  # (k,) deviations that all flights share
    covariance: Floats  # (k, k) of the mean
    sizes: tuple[float, ...]  # of what is stated of each spread


@dataclass(frozen=True)
class Told:
    """What one flight tells of the numbers (k,): chi-square is ``a A a - 2 h a`` and a constant."""

    A: Floats  # (k, k)
    h: Floats  # (k,)

    @staticmethod
    def of(quadratic: Quadratic, at: Floats) -> "Told":
        """That of a quadratic in the amounts beyond deviations ``at`` (k,)."""
        k = len(at)
        return Told(quadratic.A[:k, :k], quadratic.b[:k] + quadratic.A[:k, :k] @ at)


def share(flights: Sequence[Told], centred: Centred) -> Shared:
    """The mean over flights and the spread between them, by expectation-maximization (Dempster, Laird, Rubin 1977).

    The mean keeps within bounds, and what a number at its bound leaves goes to the others: a file that is wrong by
    factors has added masses which end at nothing. One flight shows no spread, which is as stated: what its file has
    wrong would be taken for what flights differ by, and that lets the mean go back to the file.

    Args:
        flights: what each flight tells.
        centred: where the vehicle's file is, how wide it may be of the truth, and flights of each other.
    """
    (prior_mean, prior), nuisance, bounds = centred.prior, centred.nuisance, centred.bounds
    stated_size = np.array([np.linalg.matrix_rank(part) for part in nuisance.spread])
    inverse = [np.linalg.pinv(part, hermitian=True) for part in nuisance.spread]
    sizes, mean, covariance = np.ones(len(nuisance.spread)), prior_mean, prior
    for _ in range(ROUNDS):
        between = nuisance.between_flights(sizes.tolist())
        reduced = [np.linalg.inv(np.eye(len(prior)) + flight.A @ between) for flight in flights]
        informed = sum((r @ flight.A for r, flight in zip(reduced, flights, strict=True)), prior)
        pull = sum((r @ flight.h for r, flight in zip(reduced, flights, strict=True)), prior @ prior_mean)
        covariance = np.linalg.inv(0.5 * (informed + informed.T))
        mean = least_within(informed, pull, bounds, np.eye(len(prior)))
        if len(flights) == 1:
            break
        squares = np.zeros_like(between)
        for r, flight in zip(reduced, flights, strict=True):
            gain = between @ r
            own = gain @ (flight.h - flight.A @ mean)
            along = gain @ flight.A
            squares += np.outer(own, own) + gain + along @ covariance @ along.T
        seen = np.array([float((part * squares).sum()) for part in inverse])
        fresh = np.sqrt((STATED_FLIGHTS * stated_size + seen) / (stated_size * (STATED_FLIGHTS + len(flights))))
        settled = np.allclose(fresh, sizes, rtol=1e-3)
        sizes = fresh
        if settled:
            break
    return Shared(mean, covariance, tuple(sizes.tolist()))
