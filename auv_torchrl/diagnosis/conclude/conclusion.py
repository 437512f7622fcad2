"""What a diagnosis concludes: the verdict, what limits it, and how likely each cause is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from auv_torchrl.diagnosis.conclude.decision import found_effects
from auv_torchrl.diagnosis.conclude.summary import FILE_OFF
from auv_torchrl.diagnosis.doubt import (
    BELIEVED,
    bounded,
    closes_everywhere,
    doubted_alternatives,
    doubts,
    hedged,
    limited,
)
from auv_torchrl.diagnosis.explain import Explained
from auv_torchrl.diagnosis.identify.posterior import SOMETHING_UNKNOWN, alternatives, effect_probabilities
from auv_torchrl.diagnosis.identify.search import Found
from auv_torchrl.diagnosis.localize.wording import does_otherwise
from auv_torchrl.diagnosis.log_search import judge
from auv_torchrl.diagnosis.validate.predict import closed_share, measure_gap
from auv_torchrl.diagnosis.validate.veto import falls_short
from auv_torchrl.diagnosis.verdict import Alternative, FoundEffect, Gap, Verdict, Where
from auv_torchrl.flightlog import Finding, FlightLog

UNKNOWN_WIDTH = 0.03  # of the excess, over which "explained" turns into "something else acts"


@dataclass(frozen=True)
class Conclusion:
    """The verdict on a log, and what it rests on."""

    verdict: Verdict
    if_sound: Verdict  # the verdict where the log itself is right
    gap: Gap
    closed: float | None  # share of the gap that what was found closes; None where there is none
    short: bool  # what explains the log leaves too much of held-out flight
    hedge: bool  # coefficients were corrected, and something is left all the same
    unknown: float  # probability that something unknown acts, too
    doubted: tuple[Finding, ...]  # the findings that limit the verdict


def conclude(explained: Explained, numbers: tuple[int, ...], findings: Sequence[Finding]) -> Conclusion:
    """The verdict of what explains a log.

    Args:
        explained: what explains it.
        numbers: of the episodes that were held out.
        findings: on the log and on what it was explained by; some of them limit the verdict.
    """
    found, predictions, corrected = explained.found, explained.predictions, bool(explained.corrected.effects)
    verdict = judge(found, corrected=corrected)
    closed = closed_share(predictions) if verdict is not Verdict.NO_GAP else None
    gap = measure_gap(predictions, numbers, closed)
    hedge = corrected and (verdict is not Verdict.EXPLAINED or not closes_everywhere(gap))
    short = verdict is Verdict.EXPLAINED and falls_short(predictions, closed)
    partly = verdict is Verdict.EXPLAINED and (short or hedge)
    if_sound, doubted = Verdict.PARTLY_EXPLAINED if partly else verdict, doubts(findings)
    unknown = 1.0 if explained.vetoed or partly else probability_of_unknown(found)
    return Conclusion(limited(if_sound, doubted), if_sound, gap, closed, short, hedge, unknown, doubted)


def probability_of_unknown(found: Found) -> float:
    """Probability that something unknown acts beside the best explanation, by what it leaves."""
    from scipy.special import expit  # here: it takes long to import

    return float(expit((found.excess_as_stated - found.most_left) / UNKNOWN_WIDTH))


@dataclass(frozen=True)
class Causes:
    """What may be the cause, and how likely each is."""

    effects: tuple[FoundEffect, ...]  # corrections of the file, then effects: what the verdict names
    probability: dict[str, float]  # by effect
    alternatives: tuple[Alternative, ...]  # explanations of which one is true


def weigh_causes(log: FlightLog, explained: Explained, concluded: Conclusion) -> Causes:
    """Probabilities of all causes: no cause in the vehicle is believed more than a doubt about the log lets it."""
    found = explained.found
    probability = bounded(effect_probabilities(found, concluded.unknown), concluded.doubted)
    either = alternatives(found, concluded.unknown)
    either = doubted_alternatives(either, 1 - BELIEVED, FILE_OFF) if concluded.hedge else either
    either = doubted_alternatives(either, BELIEVED, "a fault of the log") if concluded.doubted else either
    gapless = concluded.verdict is Verdict.NO_GAP
    named = () if gapless else found_effects(found.problem, found, probability, concluded.closed, log.autopilot)
    corrections = explained.corrected.effects
    corrections = hedged(corrections) if concluded.hedge else corrections
    return Causes(tuple(effect for effect in (*corrections, *named) if effect.departs), probability, either)


def name_located(causes: Causes, where: Where, verdict: Verdict) -> Causes:
    """Causes in which something unknown has the name of the thruster that it was located at."""
    does = does_otherwise(where) if verdict is Verdict.UNEXPLAINED else ""
    if not does:
        return causes
    renamed = (replace(one, besides=does) if one.besides == SOMETHING_UNKNOWN else one for one in causes.alternatives)
    return replace(causes, alternatives=tuple(renamed))
