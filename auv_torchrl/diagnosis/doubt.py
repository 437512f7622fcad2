"""Findings are evidence: while the log itself is in doubt, no cause in the vehicle is more likely than not."""

from collections.abc import Mapping, Sequence

from auv_torchrl.diagnosis.identify.posterior import NONE, UNKNOWN
from auv_torchrl.diagnosis.verdict import Verdict
from auv_torchrl.flightlog import Finding

BELIEVED = 0.5  # of the probability of a cause, where it may as well be what the finding says about the log


def doubts(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """The findings that limit what can be concluded."""
    return tuple(finding for finding in findings if finding.limits)


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


def said_first(summary: str, verdict: Verdict, doubted: Sequence[Finding]) -> str:
    """The summary behind what makes it doubtful."""
    if not doubted or verdict is Verdict.NO_GAP:
        return summary
    return (
        f"The log itself is in doubt: {'; '.join(finding.sentence for finding in doubted)}. If it is right: {summary}"
    )
