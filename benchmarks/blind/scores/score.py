"""What all judgements together say: the figures that the issue asks for, and tables for people."""

import math
from collections.abc import Iterable, Sequence

from auv_torchrl.effects import EFFECTS
from benchmarks.blind.flights.cases import FAMILIES
from benchmarks.blind.scores.judge import Judgement
from benchmarks.blind.scores.score_damage import by_damage, damage_targets
from benchmarks.blind.scores.table import (
    Bin,
    Share,
    Table,
    calibration_error,
    counted,
    median,
    median_and_largest,
    number,
    quantile,
    reliability,
    targets,
)
from benchmarks.scoring import Score

NO_GAP = {"no_gap": "exactly nominal", "no_gap_slack": "3 % slack on everything"}  # family: as people call it
LENGTH, NOISE = "log of {:.0f} s", "noise {:g} mm, {:g} rad"
PLANTS = {"mujoco": "MuJoCo, 6 degrees of freedom", "foreign": "foreign simulator, 4 degrees of freedom"}
ONSET = ("effect that begins during a log of 120 s", "… its onset found within 2 s")
INFLUENCE_EDGES = (0.0, 1.0, 2.0, 5.0, 10.0, 30.0, math.inf)  # standard deviations of the sensors, after 2 s


def of_families(judgements: Iterable[Judgement], *families: str) -> list[Judgement]:
    """The judgements of some families."""
    return [j for j in judgements if j.family in families]


def numbers(judgements: Sequence[Judgement]) -> Table:
    """The table of the project's targets with what was measured."""
    single, slack = of_families(judgements, "single"), of_families(judgements, "single_slack")
    clean, loose = of_families(judgements, "no_gap"), of_families(judgements, "no_gap_slack")
    outside, pairs = of_families(judgements, "outside"), of_families(judgements, "pair")
    failed = of_families(judgements, "failures")
    known = [j for j in judgements if j.family in ("single", "single_slack", "failures", "pair")]
    p_truth = [j.probability_of_truth for j in calibration_cases(judgements) if j.probability_of_truth is not None]
    mean_p = number(p_truth, lambda v: sum(v) / len(v), ".3f")
    errors = [error for j in single for error in j.errors.values()]
    covered, covered_slack = ([held for j in group for held in j.covered.values()] for group in (single, slack))
    closed = [j.closed for j in known if j.closed is not None]

    def thrusters(group: list[Judgement]) -> Share:
        return Share.of(j.thrusters_right for j in group)

    def all_named(group: list[Judgement]) -> Share:
        return Share.of([j.named == (j.truth,) and bool(j.thrusters_right) for j in group])

    def alarms(group: list[Judgement]) -> Share:
        return Share.of([j.verdict != "no_gap" for j in group])

    rows = [
        ("single effect named first", "≥ 95 %", "≥ 99 %", Share.of([j.right for j in single])),
        ("… or one declared indistinguishable from it", "", "", Share.of([j.right_class for j in single])),
        ("thrusters at fault named (exchangeable ones declared)", "≥ 95 %", "≥ 99 %", thrusters(single)),
        ("two or three thrusters failed, each in its own way: these named, no others", "", "", all_named(failed)),
        ("single effect named first, 3 % slack on everything", "≥ 88 %", "≥ 95 %", Share.of([j.right for j in slack])),
        ("… or one declared indistinguishable from it", "", "", Share.of([j.right_class for j in slack])),
        ("thrusters at fault named, 3 % slack", "", "", thrusters(slack)),
        ("no gap: false alarms", "≤ 3 %", "≤ 1 %", alarms(clean)),
        ("no gap: false alarms, 3 % slack", "≤ 3 %", "≤ 1 %", alarms(loose)),
        ("outside the library: not called explained", "≥ 85 %", "≥ 95 %", Share.of([j.right for j in outside])),
        ("pairs: both found", "≥ 85 %", "≥ 95 %", Share.of([j.right for j in pairs])),
        ("… up to what was declared indistinguishable", "", "", Share.of([j.right_class for j in pairs])),
        ("mean probability on the truth (a declared class counts as one)", "≥ 0.9", "≥ 0.97", mean_p),
        ("expected calibration error", "≤ 0.08", "≤ 0.04", f"{calibration_error(calibration(judgements)):.3f}"),
        ("95 % intervals that hold the truth", "88 to 99 %", "92 to 98 %", Share.of(covered)),
        ("… with the 3 % slack that they allow for", "", "", Share.of(covered_slack)),
        ("parameter error, median", "≤ 4 %", "≤ 2 %", number(errors, median, ".1%")),
        ("parameter error, 90th percentile", "≤ 15 %", "≤ 8 %", number(errors, lambda v: quantile(v, 0.9), ".1%")),
        ("closed share, median, known effects", "≥ 0.90", "≥ 0.97", number(closed, median, ".3f")),
        *damage_targets(judgements),
        ("CPU seconds per log, median / largest", "≤ 60", "≤ 10", median_and_largest([j.cpu_s for j in judgements])),
    ]  # fmt: skip
    return targets("Targets", rows)


def scores(judgements: Iterable[Judgement], groups: Iterable[tuple[str, Sequence[Judgement]]]) -> Table:
    """How many answers of each group, and of all, are right, half right and wrong by the one rule of all benchmarks."""
    names = [score.name.lower() for score in Score]
    every = [*((text, cases) for text, cases in groups if cases), ("all", list(judgements))]
    rows = [(text, *(str(sum(j.score == name for j in cases)) for name in names)) for text, cases in every]
    return Table("Right, half right, wrong", ("", "right", "half right", "wrong"), rows)


def by_family(judgements: Sequence[Judgement]) -> Table:
    """The scores of each family."""
    return scores(judgements, ((family, of_families(judgements, family)) for family in FAMILIES))


def calibration_cases(judgements: Iterable[Judgement]) -> list[Judgement]:
    """Cases with one truth out of the library, at a clear size, or none."""
    return of_families(judgements, "single", "single_slack", "no_gap", "no_gap_slack")


def calibration(judgements: Iterable[Judgement]) -> list[Bin]:
    """Bins of the reliability diagram; a class that was declared indistinguishable counts as one answer."""
    cases = [j for j in calibration_cases(judgements) if j.probability is not None]
    return reliability([j.probability or 0.0 for j in cases], [j.right_class for j in cases])


def by_effect(judgements: Iterable[Judgement]) -> Table:
    """Clear single effects, with and without slack."""
    cases = of_families(judgements, "single", "single_slack")
    rows = []
    for name in EFFECTS:
        if mine := [j for j in cases if j.truth == name]:
            errors = [e for j in mine if j.family == "single" for e in j.errors.values()]
            p = [j.probability_of_truth for j in mine if j.probability_of_truth is not None]
            rows.append(
                (
                    name,
                    Share.of(j.right for j in mine).fraction,
                    Share.of(j.thrusters_right for j in mine).fraction,
                    f"{sum(p) / len(p):.2f}" if p else "–",
                    f"{median(errors):.1%}" if errors else "–",
                    counted(j.answer for j in mine if not j.right),
                )
            )
    head = ("effect", "named first", "thrusters", "mean probability", "median parameter error", "instead")
    return Table("Single effects of clear size, with and without slack", head, rows)


def left_out(judgements: Iterable[Judgement]) -> Table:
    """Each effect taken out of the library in turn."""
    rows = []
    for name in EFFECTS:
        for j in judgements:
            if j.left_out == name:
                rows.append((name, j.verdict, ", ".join(j.named), _share(j.closed), *Score[j.score.upper()].cells))
    return Table("Leave one out", ("left out", "verdict", "named instead", "closed", "right", "half right"), rows)


def outside(judgements: Iterable[Judgement]) -> Table:
    """Effects that no library entry describes."""
    rows = [
        (j.outside or "", j.verdict, ", ".join(j.named), _share(j.closed), *Score[j.score.upper()].cells)
        for j in sorted(of_families(judgements, "outside"), key=lambda j: j.outside or "")
    ]
    return Table("Outside the library", ("effect", "verdict", "named", "closed", "right", "half right"), rows)


def no_gap(judgements: Iterable[Judgement]) -> Table:
    """Healthy vehicles."""
    rows = []
    for family, text in NO_GAP.items():
        cases = of_families(judgements, family)
        alarms = [j for j in cases if j.verdict != "no_gap"]
        named = counted(", ".join(j.named) or j.verdict for j in alarms)
        rows.append((text, str(Share(len(alarms), len(cases))), named))
    return Table("No gap", ("vehicle", "false alarms", "as"), rows)


def by_influence(judgements: Iterable[Judgement]) -> Table:
    """Accuracy against how much the effect shows."""
    cases = of_families(judgements, "single", "single_slack", "severity")
    rows = []
    for span, (low, high) in spans().items():
        mine = [j for j in cases if j.influence is not None and low <= j.influence < high]
        if mine:
            missed = sum(j.verdict == "no_gap" for j in mine)
            rows.append((span, str(Share.of([j.right for j in mine])), str(missed)))
    head = ("error at 2 s, in standard deviations of the sensors", "named first", "no gap seen")
    return Table("By severity", head, rows)


def spans() -> dict[str, tuple[float, float]]:
    """Ranges of the influence, by their names."""
    pairs = zip(INFLUENCE_EDGES, INFLUENCE_EDGES[1:], strict=False)
    return {f"{low:g} to {high:g}" if high < math.inf else f"over {low:g}": (low, high) for low, high in pairs}


def by_condition(judgements: Iterable[Judgement]) -> Table:
    """Accuracy by length of log, noise and simulator."""
    judgements = list(judgements)
    clear = of_families(judgements, "single", "single_slack", "length", "noise")
    groups: list[tuple[str, list[Judgement]]] = []
    for length in sorted({j.seconds_of_log for j in clear}):
        mine = [j for j in clear if j.seconds_of_log == length and j.noise == 1.0]
        groups.append((LENGTH.format(length), mine))
    for noise in sorted({j.noise for j in clear}):
        mine = [j for j in clear if j.noise == noise and j.family != "length"]
        groups.append((NOISE.format(2 * noise, 0.004 * noise), mine))
    for plant, text in PLANTS.items():
        groups.append((text, [j for j in of_families(clear, "single", "single_slack") if j.plant == plant]))
    rows = [(text, str(Share.of([j.right for j in mine]))) for text, mine in groups if mine]
    onset = of_families(judgements, "onset")
    if onset:
        errors = [j.onset_error_s for j in onset if j.onset_error_s is not None]
        within = Share.of([j.onset_error_s is not None and j.onset_error_s < 2.0 for j in onset])
        middle = f", median error {median(errors):.1f} s" if errors else ""
        rows.append((ONSET[0], str(Share.of([j.right for j in onset]))))
        rows.append((ONSET[1], f"{within}{middle}"))
    return Table("By length, noise and simulator", ("", "named first"), rows)


def failures(judgements: Iterable[Judgement]) -> Table:
    """Every case that is not right."""
    rows = []
    for j in judgements:
        wrong_thrusters = j.thrusters_right is False and j.right
        if j.score == Score.RIGHT.name.lower() and j.right and not wrong_thrusters:
            continue
        if j.damage:
            truth = " + ".join((*j.effects, j.damage))
        else:
            truth = j.outside or ("without " if j.left_out else "") + (" + ".join(j.effects) or j.truth)
        answer = j.answered + (" (other thrusters)" if wrong_thrusters else "")
        if j.right_class and not j.right:
            answer += " (declared, or the same by another name)"
        rows.append(failure(j, j.family, truth, answer))
    return failed("family", rows)


def failure(j: Judgement, group: str, truth: str, answer: str) -> tuple[str, ...]:
    """The row of a case that is not right."""
    shows = "" if j.influence is None else f"{j.influence:.1f}"
    half = Score[j.score.upper()].cells[1]
    return j.case, group, truth, shows, f"{answer} {j.message}".strip(), j.verdict, _share(j.probability), half


def failed(group: str, rows: list[tuple[str, ...]]) -> Table:
    """The table of such rows, in which the cases are of some groups."""
    head = ("case", group, "truth", "shows", "answer", "verdict", "its probability", "half right")
    return Table("Cases that fail", head, rows)


def tables(judgements: Sequence[Judgement]) -> list[Table]:
    """All of them, in the order in which they are read."""
    every = (numbers, by_family, by_effect, no_gap, outside, left_out, by_damage, by_influence, by_condition, failures)
    return [table(judgements) for table in every]


def _share(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
