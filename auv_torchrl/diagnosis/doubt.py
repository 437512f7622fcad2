"""What may be otherwise is not said as a fact.

Findings are evidence: while the log itself is in doubt, no cause in the vehicle is more likely than not. Coefficients
that are corrected on the log are many, and take up a part of any fault: the file is off only where that closes the gap.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.posterior import NONE, UNKNOWN
from auv_torchrl.diagnosis.thresholds import CLOSED_IF_EXPLAINED, STILL_FAR
from auv_torchrl.diagnosis.verdict import Alternative, Errors, FoundEffect, Gap, Verdict
from auv_torchrl.flightlog import Finding, FlightLog

BELIEVED = 0.5  # of the probability of a cause, where it may as well be what the finding says about the log


def doubts(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """The findings that limit what can be concluded."""
    return tuple(finding for finding in findings if finding.limits)


def unless_shared(findings: Sequence[Finding], healthy: Sequence[FlightLog]) -> tuple[Finding, ...]:
    """The findings of a log; one that a healthy flight has too limits nothing: the vehicle's file may as well be off.

    Where thrust is weaker than the file says, all logs of the vehicle look as if their clock or their units were off.
    """
    shared = {(finding.code, finding.columns) for log in healthy for finding in log.findings}
    return tuple(replace(one, limits=False) if (one.code, one.columns) in shared else one for one in findings)


def limited(verdict: Verdict, doubted: Sequence[Finding]) -> Verdict:
    """The verdict where the log is ``doubted``: what explains it may not be the vehicle."""
    return Verdict.PARTLY_EXPLAINED if doubted and verdict is Verdict.EXPLAINED else verdict


def bounded(probability: Mapping[str, float], doubted: Sequence[Finding]) -> dict[str, float]:
    """Probabilities by effect, what is taken from them added to that of something unknown."""
    if not doubted:
        return dict(probability)
    kept = {name: p if name in (NONE, UNKNOWN) else BELIEVED * p for name, p in probability.items()}
    kept[UNKNOWN] = max(kept.get(UNKNOWN, 0.0), 1 - BELIEVED)
    return dict(sorted(kept.items(), key=lambda item: -item[1]))


def doubted_alternatives(
    alternatives: Sequence[Alternative], probability: float, besides: str
) -> tuple[Alternative, ...]:
    """Alternatives that are true with a ``probability``, and one more: what ``besides`` says of the log."""
    kept = [replace(one, probability=probability * one.probability) for one in alternatives]
    kept.append(Alternative((), besides, 1.0 - probability))
    return tuple(sorted(kept, key=lambda one: -one.probability))


def behind_doubts(summary: str, verdict: Verdict, doubted: Sequence[Finding]) -> str:
    """The summary behind what makes it doubtful."""
    if not doubted or verdict is Verdict.NO_GAP:
        return summary
    return (
        f"The log itself is in doubt: {'; '.join(finding.sentence for finding in doubted)}. If it is right: {summary}"
    )


def closes_everywhere(gap: Gap) -> bool:
    """Whether what predicts held-out flight afterwards closes the gap in each degree of freedom that has one."""
    return all(_closes(errors) for errors in gap.dof.values())


def _closes(errors: Errors) -> bool:
    """Whether errors end near their floors, or as near to them as what explains a gap must."""
    before, after, floor = (np.array(row) for row in (errors.before, errors.after, errors.floor))
    seen = np.isfinite(floor) & (floor > 0)
    if not seen.any():
        return True
    first, last = (float(np.sqrt(np.mean((row[seen] / floor[seen]) ** 2))) for row in (before, after))
    if not np.isfinite(first):  # the simulator of the file diverges
        return bool(np.isfinite(last))
    return last < STILL_FAR or first - last > CLOSED_IF_EXPLAINED * (first - 1.0)


def hedged(corrections: Sequence[FoundEffect]) -> tuple[FoundEffect, ...]:
    """Corrections of the file that leave some of the gap open: something else may be what they take up."""
    return tuple(replace(effect, probability=min(effect.probability, BELIEVED)) for effect in corrections)
