"""The table of the trial: a row for each case, and what is counted."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from benchmarks.scoring import Score
from benchmarks.trial.cases import Case

HEAD = (
    "case", "vehicle", "what was wrong", "verdict", "named", "right", "half right", "done about it", "cured",
    "MOTOR_DETECT says",
)  # fmt: skip
FRAME_NAMES = {1: "vectored", 2: "vectored_6dof"}

Result = Mapping[str, Any]


def is_cured(result: Result) -> bool:
    """Whether nothing is wrong with the repeated dive."""
    repeated = result["repeated"]
    return repeated is not None and repeated["verdict"] == "no_gap"


def is_gone(case: Case, result: Result) -> bool:
    """Whether the repeated dive shows nothing of what was wrong, whatever else is named there."""
    repeated = result["repeated"]
    if repeated is None or repeated["verdict"] not in ("no_gap", "explained"):
        return False
    return not any(f"{effect} " in repeated["named"] for effect in case.truth)


def is_named(result: Result) -> bool:
    """Whether the true cause is named with its thruster and value, and nothing else is."""
    return result["diagnosed"]["score"] == Score.RIGHT.name


def is_false_alarm(case: Case, result: Result) -> bool:
    """Whether a sound vehicle is called faulty."""
    return not case.truth and result["diagnosed"]["verdict"] != "no_gap"


def row(case: Case, result: Result) -> tuple[str, ...]:
    """The cells of one case."""
    said, repeated = result["diagnosed"], result["repeated"]
    remedy = (said.get("remedy") or {}).get("said", "")
    if not case.truth:
        cured = ""
    elif not case.is_curable:
        cured = "not curable"
    elif repeated is None:
        cured = "no"
    else:
        cured = "yes" if is_cured(result) else f"no: {repeated['verdict']} {repeated['named']}".strip()
    return (
        case.name, FRAME_NAMES[case.frame], wrong(case), said["verdict"], said["named"],
        *Score[said["score"]].cells, remedy, cured, result["detected"]["said"],
    )  # fmt: skip


def wrong(case: Case) -> str:
    """What is wrong with a vehicle."""
    parts = [f"{name} {value:g}" for name, value in case.parameters.items()]
    parts += [f"phase wires of thruster {n}" for n in case.mirrored]
    parts += [f"{effect} {' '.join(f'{k} {v}' for k, v in own.items())}" for effect, own in case.effects.items()]
    return ", ".join(parts) or "nothing"


def lines(results: Sequence[tuple[Case, Result]], drawn: int) -> Iterator[str]:
    """The table and what is counted, as Markdown."""
    yield f"| {' | '.join(HEAD)} |"
    yield "|" + "---|" * len(HEAD)
    for case, result in results:
        yield f"| {' | '.join(row(case, result))} |"
    yield ""
    yield from counts(results, drawn)


def counts(results: Sequence[tuple[Case, Result]], drawn: int) -> Iterator[str]:
    """What came of all cases, a line each."""
    faulty = [(case, result) for case, result in results if case.truth]
    healthy = [(case, result) for case, result in results if not case.truth]
    curable = [(case, result) for case, result in faulty if case.is_curable]
    motors = [(case, result) for case, result in faulty if set(case.truth) == {"thruster_gain"}]
    half = sum(result["diagnosed"]["score"] == Score.HALF.name for _, result in faulty)
    frames = {FRAME_NAMES[case.frame] for case, _ in results}
    yield f"{len(results)} of {drawn} drawn cases were flown, on {' and '.join(sorted(frames))}.\n"
    yield f"- Faults named right: {_of(is_named(r) for _, r in faulty)}, half right: {half}."
    yield f"- False alarms on healthy vehicles: {_of(is_false_alarm(c, r) for c, r in healthy)}."
    more = sum(is_gone(c, r) and not is_cured(r) for c, r in curable)
    yield (
        f"- Cured by the advice: {_of(is_cured(r) for _, r in curable)} that an owner can cure; in {more} more the "
        "repeated dive shows nothing of what was wrong, and something else is named there."
    )
    yield (
        f"- ArduSub's MOTOR_DETECT is right about {_of(r['detected']['names'] for _, r in motors)} vehicles with a "
        f"reversed, weak or dead thruster (the diagnosis: {_of(is_named(r) for _, r in motors)}), and calls "
        f"{_of(_finds_fault(r) for _, r in healthy)} healthy ones faulty."
    )
    seconds = [result["diagnosed"]["cpu_s"] for _, result in results]
    flown = [result["flown"] for _, result in results]
    rates = [one["simulated_s"] / one["cpu_s"] for one in flown if one["cpu_s"]]
    if seconds and rates:
        yield (
            f"- A diagnosis took {sum(seconds) / len(seconds):.0f} s of the processor on the mean; a dive is flown at "
            f"{sum(rates) / len(rates):.0f} x real time of the processor, without the firmware's own."
        )


def _finds_fault(result: Result) -> bool:
    said = result["detected"]["said"]
    return "failed" in said or "reversed" in said


def _of(those: Iterable[bool]) -> str:
    listed = list(those)
    return f"{sum(listed)} of {len(listed)}"
