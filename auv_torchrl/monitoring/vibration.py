"""Vibration: a line in the spectrum of a gyro that no healthy run has, as of a propeller that is cut, bent or fouled.

What turns out of balance pushes once a turn. That is a line in the spectrum of a gyro, at a frequency that nobody
knows, for samples alias it. How restless water and vehicle are differs from day to day at all frequencies together,
so that a line is weighed against its neighbours.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import Z95
from auv_torchrl.monitoring.healthy_runs import between_sessions, one_session
from auv_torchrl.monitoring.runs import BIN_S, GRID_HZ, Runs

BAND_HZ = 1.0  # of a line: propellers at some 20 turns a second keep theirs within 2 %, and tapers smear as much
APART_HZ = 0.1  # between a band and what is beside it: where its line has not ended
PLACES = 4  # bands to each width of one
LOUDER = np.log(4.0)  # half-normal width of how much more power a fault adds: twice the amplitude
AMOUNTS = LOUDER * np.linspace(0.0, 4.0, 81)[1:]  # of which it is summed up


@dataclass(frozen=True)
class HealthySpectrum:
    """The spectra of healthy runs, in A channels and C bands."""

    level: Floats  # (A, F) mean logarithm of their power
    mean: Floats  # (A * C,) logarithm of the power of a band over that beside it
    scatter: Floats  # (A * C,) standard deviation of that between runs
    count: int
    session: float  # variance between sessions, times that between runs


@dataclass(frozen=True)
class SpectralLine:
    """The likeliest line in the spectrum of a group of runs."""

    evidence: float  # logarithm of the ratio of likelihoods, with a line somewhere and without
    channel: str
    frequency: float  # Hz, as samples show it
    louder: tuple[float, float, float]  # amplitude over that of healthy runs, with its 95 % interval


def learn_spectrum(runs: Runs) -> HealthySpectrum | None:
    """The spectra of healthy runs; None where no rate is measured fast enough."""
    usable = np.flatnonzero(np.isfinite(runs.power).all((1, 2)))
    if not len(band_centres(runs.power.shape[-1])) or not runs.gyro_axes or len(usable) < 2:
        return None
    power, session = runs.power[usable], runs.session[usable]
    level = power.mean(0)
    over = _contrast(power - level)
    scatter = over.std(0, ddof=1)
    if not (scatter > 0).all():
        return None
    return HealthySpectrum(
        level, over.mean(0), scatter, len(over), between_sessions((over - over.mean(0)) / scatter, session)
    )


def find_lines(runs: Runs, healthy: HealthySpectrum | None, groups: Sequence[np.ndarray]) -> list[SpectralLine | None]:
    """The line of each group of runs; None where nothing can be said."""
    if healthy is None or runs.power.shape[1:] != healthy.level.shape:
        return [None] * len(groups)
    over = _contrast(runs.power - healthy.level)
    seen = np.asarray(np.isfinite(over).all(1))
    return [_line(over[rows[seen[rows]]], runs, healthy, rows[seen[rows]]) for rows in groups]


def band_centres(frequencies: int) -> Floats:
    """Centres (C,) in Hz of bands with room on both sides, on a grid of so many frequencies.

    What is slower than half the rate of the table of medians shows in that table.
    """
    room = 1.5 * BAND_HZ + APART_HZ
    return np.arange(0.5 / BIN_S + room, frequencies * GRID_HZ - room, BAND_HZ / PLACES)


def _contrast(power: Floats) -> Floats:
    """Logarithm (N, A * C) of the power in each band over the power on its two sides, from spectra (N, A, F)."""
    from scipy.special import logsumexp  # here, as below: it takes longer to import than numpy

    frequency = np.arange(power.shape[-1]) * GRID_HZ
    found = []
    for centre in band_centres(len(frequency)):
        away = frequency - centre
        within = np.abs(away) <= 0.5 * BAND_HZ
        beside = (np.abs(away) > 0.5 * BAND_HZ + APART_HZ) & (np.abs(away) <= 1.5 * BAND_HZ + APART_HZ)
        own, low, high = (
            logsumexp(power[..., some], axis=-1) - np.log(some.sum())
            for some in (within, beside & (away < 0), beside & (away > 0))
        )
        found.append(own - 0.5 * (low + high))
    return np.stack(found, axis=-1).reshape(len(power), -1)


def _students(x: Floats, freedom: int) -> Floats:
    """Log density of Student's distribution, up to a constant."""
    return -0.5 * (freedom + 1) * np.log1p(x**2 / freedom)


def _line(over: Floats, runs: Runs, healthy: HealthySpectrum, rows: np.ndarray) -> SpectralLine | None:
    """The line of the runs ``rows``, whose contrast is ``over`` (n, A * C)."""
    from scipy.special import logsumexp

    count = len(over)
    if not count:
        return None
    share = healthy.session * one_session(runs.session[rows]) if count > 1 else 0.0  # in the scatter, of one run
    unit = healthy.scatter * np.sqrt(1.0 / count + share + 1.0 / healthy.count)
    more, freedom = over.mean(0) - healthy.mean, healthy.count - 1
    prior = -0.5 * (AMOUNTS / LOUDER) ** 2
    prior -= logsumexp(prior)
    weight = _students((more[:, None] - AMOUNTS) / unit[:, None], freedom) + prior
    evidence = logsumexp(weight, axis=1) - _students(more / unit, freedom)
    best = int(evidence.argmax())
    share_of = np.exp(weight[best] - logsumexp(weight[best]))
    amount = float(share_of @ AMOUNTS)
    half = Z95 * float(np.sqrt(share_of @ (AMOUNTS - amount) ** 2))
    centres = band_centres(runs.power.shape[-1])
    louder = tuple(float(np.exp(0.5 * max(a, 0.0))) for a in (amount, amount - half, amount + half))
    return SpectralLine(
        float(logsumexp(evidence) - np.log(len(evidence))),
        runs.gyro_axes[best // len(centres)],
        float(centres[best % len(centres)]),
        (louder[0], louder[1], louder[2]),
    )
