"""The distribution of healthy runs: their mean beyond the simulator, their scatter, and how sessions differ."""

from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.flightlog import FlightLogError
from auv_torchrl.monitoring.runs import Runs
from auv_torchrl.quantities import counted

FEWEST = 10  # runs, for a scatter to be measured, and for each number that they are taken to depend on
ROUNDS = 2  # of the mean, which sessions weigh in, and of how much sessions differ from it


@dataclass(frozen=True)
class RunDistribution:
    """Of K numbers per run: N healthy runs, of which H numbers are known before they start."""

    line: Floats  # (1 + H, K) of what is seen less what is simulated: mean, and slopes with how a run begins
    flown: Floats  # (K,) mean of what is simulated of their commands
    middle: Floats  # (H,) of how they begin
    covariance: Floats  # (1 + H, 1 + H) covariance of each column of the line, in variances of a run
    root: Floats  # (K, K) lower triangle whose product with its transpose is the covariance of runs about the line
    count: int  # N
    freedom: float  # of Student's distribution that a further run follows
    session: float  # variance between sessions, times that between runs; 0 where nothing shows it

    def whitened(self, numbers: Floats) -> Floats:
        """(..., K) in standard deviations of a run that are independent of each other."""
        return np.linalg.solve(self.root, numbers[..., None])[..., 0]

    def expected(self, beginnings: Floats) -> Floats:
        """What runs with these beginnings (n, H) show beyond the simulator, (n, K)."""
        return _design(beginnings, self.middle) @ self.line

    def unit(self, beginnings: Floats, session: np.ndarray) -> float:
        """Standard deviation of the mean of runs with beginnings (n, H) and sessions (n,), in units of one run."""
        one = _design(beginnings, self.middle).mean(0)
        own = 1 / len(session) + self.session * one_session(session) if len(session) > 1 else 1.0  # the scatter has it
        return float(np.sqrt(own + one @ self.covariance @ one))


def learn_distribution(healthy: Runs, nominal: Floats) -> RunDistribution:
    """The distribution of healthy runs, from their tables and what is simulated (N, C, B) of their commands.

    Raises:
        FlightLogError: for fewer than :data:`FEWEST` runs.
    """
    count = len(healthy)
    if count < FEWEST:
        raise FlightLogError(
            f"{counted(count, 'healthy run')}: {FEWEST} at least are needed to tell how sound runs scatter"
        )
    beyond = (healthy.medians - nominal).reshape(count, -1)
    beginnings = (
        healthy.beginnings if count >= FEWEST * (1 + healthy.beginnings.shape[1]) else healthy.beginnings[:, :0]
    )
    middle = np.nanmean(beginnings, axis=0)
    known, same = _design(beginnings, middle), healthy.session[:, None] == healthy.session
    session, freedom = 0.0, count - known.shape[1]

    def least_squares(session: float) -> tuple[Floats, Floats, Floats, Floats]:
        """By generalized least squares: the line, its covariance, what is left, and the root of how runs scatter."""
        own = np.linalg.solve(np.eye(count) + session * same, known)
        covariance = np.linalg.pinv(known.T @ own, hermitian=True)
        line = covariance @ own.T @ beyond
        left = beyond - known @ line
        return line, covariance, left, np.linalg.cholesky(_shrunk(left - left.mean(0), freedom))

    line, covariance, left, root = least_squares(session)
    for _ in range(ROUNDS):
        session = between_sessions(np.linalg.solve(root, left.T).T, healthy.session)
        line, covariance, left, root = least_squares(session)
    return RunDistribution(
        line, nominal.reshape(count, -1).mean(0), middle, covariance, root, count, float(freedom), session
    )


def _design(beginnings: Floats, middle: Floats) -> Floats:
    """(n, 1 + H) by which the line is multiplied; what is not known of a run counts as usual."""
    away = np.nan_to_num(beginnings[:, : len(middle)] - middle)
    return np.concatenate([np.ones((len(beginnings), 1)), away], axis=1)


def _shrunk(centred: Floats, freedom: int) -> Floats:
    """A covariance (K, K) whose correlations are shrunk as far as chance made them (Schaefer and Strimmer 2005)."""
    count = len(centred)
    size = np.sqrt((centred**2).sum(0) / freedom)
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


def one_session(session: np.ndarray) -> float:
    """Share of the variance between sessions that the mean of runs with these sessions (n,) keeps; 1 if it is one."""
    _, runs = np.unique(session, return_counts=True)
    return float(((runs / len(session)) ** 2).sum())


def between_sessions(scatter: Floats, session: np.ndarray) -> float:
    """Variance between sessions in units of that between runs of one, from (N, K) of unit variance."""
    groups = [scatter[session == number] for number in np.unique(session)]
    if len(groups) < 2 or len(groups) == len(scatter):
        return 0.0
    count, k = scatter.shape
    within = sum(((own - own.mean(0)) ** 2).sum() for own in groups) / ((count - len(groups)) * k)
    apart = sum(len(own) * (own.mean(0) ** 2).sum() for own in groups) / ((len(groups) - 1) * k)
    typical = (count - sum(len(own) ** 2 for own in groups) / count) / (len(groups) - 1)
    return float(max(0.0, (apart - within) / (typical * within)))
