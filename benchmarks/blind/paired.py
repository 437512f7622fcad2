"""``python -m benchmarks.blind.paired FOLDER ... --before ANSWERS``: two versions of the diagnosis, log by log.

Both diagnosed the same sealed logs, of one kind. The answers of the version before are made by its own code, in a
checkout of it::

    python -c "from pathlib import Path; from benchmarks.blind.examine import examine; examine(Path(...), Path(...), 2)"

with the folder of the logs and one in it for the answers. All answers are scored by the rule of today.
"""

import argparse
import statistics
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from auv_torchrl.paths import PROJECT
from auv_torchrl.vehicle import load_vehicle
from benchmarks import published
from benchmarks.blind.examine import read_answers
from benchmarks.blind.flights.sensor_sets import sensor_set
from benchmarks.blind.scores.judge import Judgement, judge
from benchmarks.blind.scores.table import Z_95, Table
from benchmarks.blind.seal import answers_folder, open_labels, read_manifest
from benchmarks.scoring import Score

PAGE, SECTION = PROJECT / "docs" / "results" / "ablation.md", "paired"  # with the kind of logs, where they have one
RIGHT = Score.RIGHT.name.lower()
ALL, TIMES = "all", "CPU s, median / largest"  # rows
COUNTED: dict[str, Callable[[Judgement], bool]] = {  # what must not become more, and when an answer is one
    "a sound vehicle called faulty": lambda one: one.family.startswith("no_gap") and one.verdict != "no_gap",
    "something sound blamed for a damaged log": lambda one: bool(one.wrong_causes),
    "nothing of the library flown, and called explained": lambda one: one.family == "outside" and not one.right,
    "no answer": lambda one: one.verdict in ("error", "refused") and one.damage is None,
}


class Pair(NamedTuple):
    """The answers of both versions to one log."""

    before: Judgement
    now: Judgement


def difference(gained: int, lost: int, count: int) -> tuple[float, float, float]:
    """By how much a share rose, and its 95 % interval: adjusted for pairs as by Agresti and Min 2005, section 3.

    Args:
        gained: logs that are right now and were not before.
        lost: logs that were right before and are not now.
        count: logs in all.
    """
    n, b, c = count + 2, gained + 0.5, lost + 0.5
    half = Z_95 * max(b + c - (b - c) ** 2 / n, 0.0) ** 0.5 / n
    return (gained - lost) / max(count, 1), max((b - c) / n - half, -1.0), min((b - c) / n + half, 1.0)


def pairs_of(folder: Path, before: Path) -> list[Pair]:
    """Both answers to every log, judged."""
    vehicle = load_vehicle(sensor_set(read_manifest(folder)["settings"].get("sensors")).vehicle)
    answers = [read_answers(folder, each) for each in (before, answers_folder(folder))]
    labels = open_labels(folder)
    return [Pair(*(judge(name, label, each[name], vehicle) for each in answers)) for name, label in labels.items()]


def kind_of(folder: Path) -> str:
    """What kind of logs a folder holds: of which sensors, or of strangers; nothing for the main part."""
    settings = read_manifest(folder)["settings"]
    return "strangers" if settings.get("strangers") else settings.get("sensors") or ""


def tables(pairs: Sequence[Pair], called: str, kind: str = "") -> list[Table]:
    """What changed: by family, what must not be more, time, and each log of which the score changed."""
    ordered = sorted(pairs, key=lambda pair: pair.now.family)
    families = [(name, list(group)) for name, group in groupby(ordered, key=lambda pair: pair.now.family)]
    rows = [_row(name, group) for name, group in [*families, (ALL, list(pairs))]]
    head = ("family", f"right, {called}", "right, now", "difference (95 % interval)")
    counts = [
        (what, *(str(sum(is_one(one) for one in side)) for side in zip(*pairs, strict=True)))
        for what, is_one in COUNTED.items()
    ]
    times = [(TIMES, *(_times(side) for side in zip(*pairs, strict=True)))]
    changed = [
        (pair.now.case, pair.now.family, _truth(pair.now), _answer(pair.before), _answer(pair.now))
        for pair in pairs
        if pair.before.score != pair.now.score
    ]
    return [
        Table(", ".join(filter(None, ("The same sealed logs, before and now", kind))), head, rows),
        Table("What must not become more", ("", called, "now"), [*counts, *times]),
        Table("Logs of which the score changed", ("case", "family", "truth", called, "now"), changed),
    ]


def _row(name: str, group: Sequence[Pair]) -> tuple[str, ...]:
    was, now = ([one.score == RIGHT for one in side] for side in zip(*group, strict=True))
    gained = sum(b and not a for a, b in zip(was, now, strict=True))
    lost = sum(a and not b for a, b in zip(was, now, strict=True))
    share, low, high = difference(gained, lost, len(group))
    shown = f"{100 * share:+.1f} points ({100 * low:+.0f} to {100 * high:+.0f})"
    return name, f"{sum(was)}/{len(group)}", f"{sum(now)}/{len(group)}", shown


def _times(side: Iterable[Judgement]) -> str:
    seconds = [one.cpu_s for one in side]
    return f"{statistics.median(seconds):.1f} / {max(seconds):.0f}"


def _truth(one: Judgement) -> str:
    return " + ".join(one.effects) or one.outside or one.left_out or one.damage or "nothing"


def _answer(one: Judgement) -> str:
    return f"{one.answered} ({one.verdict}): {one.score.replace('_', ' ')}"


def main() -> None:
    """Print, or write the page."""
    description = (__doc__ or "").split("\n", 1)[0]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind.paired", description=description)
    parser.add_argument("folders", nargs="+", type=Path, help="of sealed logs, diagnosed by python -m benchmarks.blind")
    parser.add_argument("--before", required=True, help="name of the folder in each with the answers of before")
    parser.add_argument("--called", default="before", help="what that version is called, e.g. its commit")
    parser.add_argument("--publish", action="store_true", help=f"write the tables into {PAGE.relative_to(PROJECT)}")
    asked = parser.parse_args()
    kind, *others = sorted({kind_of(folder) for folder in asked.folders})
    if others:
        kinds = ", ".join(one or "main" for one in (kind, *others))
        parser.error(f"the folders hold logs of several kinds ({kinds}): give those of one")
    section = f"{SECTION} {kind}".strip()
    commit = published.commit_to_name(parser, PAGE, section, asked.publish)
    from benchmarks.blind.scores.report import markdown

    pairs = [pair for folder in asked.folders for pair in pairs_of(folder, folder / asked.before)]
    text = "\n\n".join(map(markdown, tables(pairs, asked.called, kind)))
    print(text)
    if asked.publish:
        names = " ".join("/".join(folder.parts[-2 if kind else -1 :]) for folder in asked.folders)
        command = f"python -m benchmarks.blind.paired {names} --called {asked.called}"
        published.publish(PAGE, section, text, command, commit)


if __name__ == "__main__":
    main()
