"""What sound runs look like: their mean beyond the simulator, how they scatter, and how sessions differ."""

from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.alike.runs import Runs
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.flightlog import FlightLogError

FEWEST = 10  # runs, for a scatter to be measured


@dataclass(frozen=True)
class Normal:
    """Of K numbers per run: N healthy runs."""

    mean: Floats  # (K,) of what is seen less what is simulated
    root: Floats  # (K, K) lower triangle whose product with its transpose is the covariance of runs about the mean
    count: int  # N
    freedom: float  # of Student's distribution that a further run follows
    session: float  # variance between sessions, times that between runs; 0 where nothing shows it

    def whitened(self, numbers: Floats) -> Floats:
        """(..., K) in standard deviations of a run that are independent of each other."""
        return np.linalg.solve(self.root, numbers[..., None])[..., 0]


def learn_normal(healthy: Runs, nominal: Floats) -> Normal:
    """What is normal, from healthy runs and what is simulated (N, C, B) of them.

    Raises:
        FlightLogError: for fewer than :data:`FEWEST` runs.
    """
    count = len(healthy)
    if count < FEWEST:
        raise FlightLogError(f"{count} healthy runs: {FEWEST} at least are needed to tell how sound runs scatter")
    beyond = (healthy.seen - nominal).reshape(count, -1)
    centred = beyond - beyond.mean(0)
    covariance = _shrunk(centred)
    root = np.linalg.cholesky(covariance * (1 + 1 / count))  # the mean is not known better than that
    normal = Normal(beyond.mean(0), root, count, count - 1.0, 0.0)
    return replace(normal, session=_between_sessions(normal.whitened(centred), healthy.session))


def _shrunk(centred: Floats) -> Floats:
    """A covariance (K, K) whose correlations are shrunk as far as chance made them (Schaefer and Strimmer 2005)."""
    count = len(centred)
    size = np.sqrt((centred**2).sum(0) / (count - 1))
    if not (size > 0).all():
        raise FlightLogError("a channel of the healthy runs never changes: leave its column out")
    scaled = centred / size
    products = scaled[:, :, None] * scaled[:, None, :]
    correlation = products.mean(0) * count / (count - 1)
    chance = products.var(0) * count**2 / (count - 1) ** 3
    apart = ~np.eye(len(size), dtype=bool)
    share = float(np.clip(chance[apart].sum() / (correlation[apart] ** 2).sum(), 0.0, 1.0))
    correlation = np.where(apart, (1 - share) * correlation, 1.0)
    return correlation * np.outer(size, size)


def _between_sessions(scatter: Floats, session: np.ndarray) -> float:
    """Variance between sessions in units of that between runs of one, from (N, K) of unit variance."""
    groups = [scatter[session == number] for number in np.unique(session)]
    if len(groups) < 2 or len(groups) == len(scatter):
        return 0.0
    count, k = scatter.shape
    within = sum(((own - own.mean(0)) ** 2).sum() for own in groups) / ((count - len(groups)) * k)
    apart = sum(len(own) * (own.mean(0) ** 2).sum() for own in groups) / ((len(groups) - 1) * k)
    typical = (count - sum(len(own) ** 2 for own in groups) / count) / (len(groups) - 1)
    return float(max(0.0, (apart - within) / (typical * within)))
