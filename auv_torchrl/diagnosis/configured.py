"""What the parameters of the autopilot say, beside what the flight shows."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from auv_torchrl.diagnosis.verdict import Diagnosis, FoundEffect, Verdict
from auv_torchrl.flightlog import Finding, FlightLog, Severity
from auv_torchrl.flightlog.streams.configuration import SHOWN_BY_FLIGHT, compare_configuration, to_set
from auv_torchrl.flightlog.streams.parameters import known


def configured(
    log: FlightLog, healthy: Sequence[FlightLog], verdict: Verdict, effects: Iterable[FoundEffect]
) -> Iterator[Finding]:
    """The findings of the log, and what is set otherwise than in the healthy flights.

    Where a flight is understood, and shows that a motor turns as it should although its direction or its output was
    changed, wires or plugs were changed, too: nothing is to be set back then.
    """
    advised = _advised(effects)
    understood = verdict in (Verdict.NO_GAP, Verdict.EXPLAINED)
    for finding in (*log.findings, *compare_configuration(log.autopilot, [sound.autopilot for sound in healthy])):
        if finding.code in SHOWN_BY_FLIGHT and understood and not _covered(finding, advised):
            fits = f"{finding.sentence}; the motors push as they should, so that wires or plugs were changed, too"
            yield replace(finding, severity=Severity.INFO, sentence=fits, remedy="", param=())
        else:
            yield finding


def said_too(summary: str, findings: Iterable[Finding], effects: Iterable[FoundEffect]) -> str:
    """The summary, and the faults of the configuration that it does not tell of."""
    if not (faults := set_wrong(findings, effects)):
        return summary
    return f"{summary} Set wrong, say the parameters: {'; '.join(dict.fromkeys(f.sentence for f in faults))}."


def set_wrong(findings: Iterable[Finding], effects: Iterable[FoundEffect]) -> tuple[Finding, ...]:
    """The findings whose remedy is a parameter, but for those that the advice about an effect tells, too."""
    advised = _advised(effects)
    return tuple(f for f in findings if f.param and not _covered(f, advised))


def to_change(diagnosis: Diagnosis) -> dict[str, float]:
    """The parameters of the autopilot to set: what a flight shows goes before what two files of them differ in."""
    return to_set(diagnosis.findings) | _advised(diagnosis.effects)


def _advised(effects: Iterable[FoundEffect]) -> dict[str, float]:
    return known(*(one.param for effect in effects if effect.is_likely for one in effect.advice))


def _covered(finding: Finding, advised: dict[str, float]) -> bool:
    return all(advised.get(name) == value for name, value in finding.param)
