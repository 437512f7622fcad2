"""How likely every effect is in one run, or in several runs of one manoeuvre."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.identify.explanation import plausible_range
from auv_torchrl.diagnosis.identify.hypotheses import Candidate, Settings, declared
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import ELASTIC_WIDTH, FIXED_WIDTH
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.effect import Origin
from auv_torchrl.monitoring.healthy_runs import RunDistribution
from auv_torchrl.monitoring.run_sensitivities import RunSensitivities
from auv_torchrl.monitoring.runs import Runs
from auv_torchrl.monitoring.vibration import SpectralLine
from auv_torchrl.vehicle import Vehicle

NONE = "none"
VIBRATION = "vibration"  # a line in a spectrum: no effect of the simulator, which turns no propellers
VISIBLE = 4.0  # chi-square of a plausible amount in one run: two standard deviations
SENSITIVITY_ERROR = 0.2  # relative, of the shape of a sensitivity: that of a vehicle whose file is a guess
IN_ITS_RANGE = 4.0  # standard deviations that the plausible range of a parameter holds


@dataclass(frozen=True)
class RunData:
    """What N runs, and G groups of them, are weighed by."""

    nominal: Floats  # (N, C, B) what is simulated of their commands
    runs: Runs
    lines: Sequence[SpectralLine | None]  # (G,) in their spectra


@dataclass(frozen=True)
class RunEvidence:
    """Evidence of G groups of one run or more, about each of M candidates."""

    names: tuple[str, ...]  # "none", effects, "vibration"
    probability: Floats  # (G, E) of these names
    best: np.ndarray  # (G, E) the likeliest change of each effect; -1 for none
    amount: Floats  # (G, M) how much of each change
    deviation: Floats  # (G, M) standard deviation of that
    share: Floats  # (G, M) of each change in its effect
    hidden: tuple[str, ...]  # effects of which no plausible size would show in these runs
    strange: Floats  # (G,) probability that a run departs as far from the best explanation by chance
    lines: tuple[SpectralLine | None, ...]  # (G,) of "vibration"


def weigh_effects(
    data: RunData,
    sensitivities: RunSensitivities,
    healthy: RunDistribution,
    vehicle: Vehicle,
    settings: Settings,
    groups: Sequence[np.ndarray],
) -> RunEvidence:
    """Probabilities of the effects in groups of runs.

    Args:
        data: of N runs.
        sensitivities: of M candidates in these runs.
        healthy: the distribution of healthy runs.
        vehicle: as its file says, empty batch.
        settings: ``prior_none`` is used.
        groups: rows of the runs; runs of a group are taken to have the same effect by the same amount.
    """
    nominal, seen = (table.reshape(len(data.runs), -1) for table in (data.nominal, data.runs.medians))
    apart = healthy.whitened(seen - nominal - healthy.expected(data.runs.beginnings))  # (N, K)
    otherwise = healthy.whitened(nominal - healthy.flown)  # (N, K)
    columns = healthy.whitened(sensitivities.change.reshape(len(sensitivities.candidates), len(apart), -1))  # (M, N, K)
    centre, width = np.array([_amounts(candidate, vehicle) for candidate in sensitivities.candidates]).T
    shows = (centre**2 + width**2) * np.median((columns**2).sum(-1), axis=1) > VISIBLE
    unit = [healthy.unit(data.runs.beginnings[rows], data.runs.session[rows]) for rows in groups]
    fits = [
        _fit(apart[rows] / one, otherwise[rows] / one, columns[:, rows] / one, centre, width, healthy)
        for rows, one in zip(groups, unit, strict=True)
    ]
    from scipy.special import fdtrc, logsumexp  # here, as below: it takes longer to import than numpy

    loglik, amount, deviation, left = (np.stack(part) for part in zip(*fits, strict=True))
    effects = list(
        dict.fromkeys(candidate.effect for candidate, seen in zip(sensitivities.candidates, shows, strict=True) if seen)
    )
    score, best, share = loglik[:, :1], np.full((len(groups), 1), -1), np.zeros_like(amount)
    for effect in effects:
        own = np.array(
            [i for i, candidate in enumerate(sensitivities.candidates) if candidate.effect == effect and shows[i]]
        )
        total = logsumexp(loglik[:, 1 + own], axis=1, keepdims=True)
        share[:, own] = np.exp(loglik[:, 1 + own] - total)
        score = np.append(score, total - np.log(len(own)), axis=1)
        best = np.append(best, own[share[:, own].argmax(1)][:, None], axis=1)
    score = np.append(score, _vibration_score(score, effects, data.lines), axis=1)
    best = np.append(best, np.full((len(groups), 1), -1), axis=1)
    score = score + np.log([settings.prior_none, *_prior(effects, settings.prior_none)])
    probability = np.exp(score - logsumexp(score, axis=1, keepdims=True))
    chosen = probability.argmax(1)
    least = left[np.arange(len(groups)), 1 + best[np.arange(len(groups)), chosen]]
    numbers = apart.shape[1]
    strange = fdtrc(numbers, max(healthy.freedom - numbers + 1, 1), least / numbers)  # of the F distribution
    hidden = [candidate.effect for candidate in sensitivities.candidates if candidate.effect not in effects]
    hidden += [] if any(data.lines) else [VIBRATION]
    names = (NONE, *effects, VIBRATION)
    return RunEvidence(
        names, probability, best, amount, deviation, share, tuple(dict.fromkeys(hidden)), strange, tuple(data.lines)
    )


def _vibration_score(score: Floats, effects: Sequence[str], lines: Sequence[SpectralLine | None]) -> Floats:
    """Log likelihood (G, 1) of a line in the spectrum, alone or beside an effect of the thrusters."""
    from scipy.special import logsumexp

    may_be = [0, *(1 + i for i, name in enumerate(effects) if EFFECTS[name].origin is Origin.ACTUATION)]
    evidence = np.array([line.evidence if line else -np.inf for line in lines])
    return (evidence + logsumexp(score[:, may_be], axis=1) - np.log(len(may_be)))[:, None]


def _fit(
    apart: Floats, otherwise: Floats, columns: Floats, centre: Floats, width: Floats, healthy: RunDistribution
) -> tuple[Floats, Floats, Floats, Floats]:
    """Log likelihood (1 + M,) of nothing and of each change, its amount (M,) with deviation, and what is left (1 + M,).

    Several runs (n, K) are weighed by their mean. All arrays are in standard deviations of healthy runs: the difference
    ``apart`` from healthy runs, the part of it that other commands make (``otherwise``), and sensitivities (M, n, K).
    """
    from scipy.special import log_ndtr

    k = apart.shape[1]
    y, m = apart.mean(0), columns.mean(1)  # (K,), (M, K)
    y_off = y - centre[:, None] * m
    size, along = (m**2).sum(1), (m * y_off).sum(1)
    gain = width**2 / (1 + width**2 * size)
    amount, deviation = centre + gain * along, np.sqrt(gain)
    # Variance of what the file has wrong about other commands, and about a sensitivity, over the numbers.
    other = 1 + SENSITIVITY_ERROR**2 * (otherwise.mean(0) ** 2).sum() / k
    wrong = other + SENSITIVITY_ERROR**2 * amount**2 * size / k
    left = np.concatenate([[float(y @ y) / other], ((y_off**2).sum(1) - gain * along**2) / wrong])
    spread = np.concatenate([[k * np.log(other)], np.log1p(width**2 * size) + k * np.log(wrong)])
    loglik = -0.5 * (healthy.freedom + k) * np.log1p(left / healthy.freedom) - 0.5 * spread
    # A negative amount is the opposite change, which is another candidate.
    loglik[1:] += log_ndtr(amount / deviation) - log_ndtr(centre / width)
    return loglik, amount, deviation * np.sqrt(wrong), left


def _amounts(candidate: Candidate, vehicle: Vehicle) -> tuple[float, float]:
    """Mean and standard deviation of the amounts by which a change may act."""
    if candidate.discrete:
        return 1.0, FIXED_WIDTH
    if candidate.elastic:
        return 1.0, ELASTIC_WIDTH
    known = declared(candidate.effect, vehicle)
    name = max(candidate.values, key=lambda member: abs(candidate.values[member] - known.nominal[member]))
    p = known.parameters[name]
    range_of = plausible_range(p)
    if p.unit == "N":  # more than that, and nobody would have flown it
        range_of = min(range_of, float(vehicle.full_thrust.sum()))
    return 0.0, range_of / IN_ITS_RANGE / abs(candidate.values[name] - known.nominal[name])


def _prior(effects: Sequence[str], none: float) -> list[float]:
    """Of the effects, and of a vibration, which is no rarer than they are."""
    odds = np.array([*(EFFECTS[effect].trial.odds for effect in effects), 1.0])
    return ((1 - none) * odds / odds.sum()).tolist()
