"""How much a run shakes at each frequency: the power of its rates of turn.

A first difference takes out most of the slope that such spectra have, and sine tapers (Riedel and Sidorenko 1995) use
all of a short run with little leakage from one frequency to another.
"""

from collections.abc import Sequence

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.flightlog.log import AXES, Episode

SHAKEN = ("p", "q", "r")  # gyros feel what a propeller does once a turn; what tells speed is slower than that
GRID_HZ = 0.05  # several values for each frequency that a run of ten seconds tells apart
TAPERS = 5  # of a run of ten seconds, which they smooth over a third of a hertz to both sides
DRIFT = 4  # order of the polynomial of time that the motion itself is taken for
GLITCH = 4.0  # typical deviations beyond which a sample of a gyro is none
SETS_OFF_S = 1.0  # s from the start of a run: a leap is in every frequency
FEWEST_SAMPLES = 0.9  # of those that a run should have


def highest_frequency(episodes: Sequence[Episode]) -> float:
    """Half the rate of sampling of the slowest of the episodes, Hz."""
    return min(0.5 / _step(episode) for episode in episodes)


def log_power(episode: Episode, channels: Sequence[str], highest: float) -> Floats:
    """Logarithm (A, F) of the power per hertz of the change of each channel; NaN where samples are too few.

    Args:
        episode: one run.
        channels: A of :data:`SHAKEN`.
        highest: frequency in Hz; F are from 0 up to it by :data:`GRID_HZ`.
    """
    frequencies = np.arange(0.0, highest, GRID_HZ)
    step = _step(episode)
    if 0.5 / step < 0.99 * highest:
        return np.full((len(channels), len(frequencies)), np.nan)
    columns = episode.values[:, [AXES.index(name) for name in channels]]
    since = episode.t - episode.t[0]
    even = np.arange(SETS_OFF_S, since[-1], step)
    return np.array([_log_power(since, column, even, frequencies) for column in columns.T]).reshape(
        len(channels), len(frequencies)
    )


def _log_power(t: Floats, values: Floats, even: Floats, frequencies: Floats) -> Floats:
    seen = np.isfinite(values) & (t >= even[0])
    if seen.sum() < FEWEST_SAMPLES * len(even):
        return np.full(len(frequencies), np.nan)
    typical = np.median(np.abs(values[seen] - np.median(values[seen])))
    middle, reach = np.median(values[seen]), GLITCH * 1.4826 * typical  # of a normal distribution's deviation
    step = even[1] - even[0]
    change = np.diff(np.clip(np.interp(even, t[seen], values[seen]), middle - reach, middle + reach)) / step
    count, place = len(change), np.linspace(-1.0, 1.0, len(change))
    left = change - np.polyval(np.polyfit(place, change, DRIFT), place)
    order = np.arange(1, TAPERS + 1)[:, None]
    tapers = np.sqrt(2.0 / (count + 1)) * np.sin(np.pi * order * np.arange(1, count + 1) / (count + 1))
    waves = np.exp(-2j * np.pi * frequencies[:, None] * np.arange(count) * step)
    power = (np.abs((tapers * left) @ waves.T) ** 2).mean(0) * step
    return np.log(power + np.finfo(float).tiny)


def _step(episode: Episode) -> float:
    return float(np.median(np.diff(episode.t)))
