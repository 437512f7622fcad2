"""``python -m benchmarks.blind.ablation FOLDER``: which thresholds of the diagnosis change an answer at all.

Each threshold of ``auv_torchrl/diagnosis/thresholds.py`` is divided and multiplied by a factor, one at a time, and
sealed logs that the benchmark has flown are diagnosed again, until the answer to one is another one. The labels stay
sealed: an answer is compared with that of the diagnosis as it is. A threshold that moves no answer either way guards
against what these logs do not have, or is not needed. A killed run goes on where it was.
"""

import argparse
import json
import multiprocessing
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from tqdm import tqdm

from benchmarks.blind.table import Table

FACTOR = (
    4.0  # a threshold that is four times too large or too small is as good as none at all, or one that never lets go
)
LOGS = 24  # of a folder: the first ones, which hold every family in its share
PLAIN = "as it is"
APART = 0.5  # half widths of its interval, by which a value has moved


def thresholds() -> dict[str, Any]:
    """Every threshold by name: a number, some, or some by unit."""
    from auv_torchrl.diagnosis import thresholds as module

    return {name: value for name, value in vars(module).items() if name.isupper()}


def scaled(value: Any, factor: float) -> Any:
    """A threshold times a factor; a count stays one."""
    if isinstance(value, Mapping):
        return {key: scaled(one, factor) for key, one in value.items()}
    if isinstance(value, tuple):
        return tuple(scaled(one, factor) for one in value)
    if isinstance(value, int):
        return max(1, round(value * factor))
    return value * factor


def _change(name: str, factor: float) -> None:
    """Change a threshold of this process, before anything reads it."""
    loaded = [module for module in sys.modules if module.startswith("auv_torchrl.diagnosis.")]
    from auv_torchrl.diagnosis import thresholds as module

    if set(loaded) - {"auv_torchrl.diagnosis.thresholds"}:
        raise RuntimeError(f"{name} cannot be changed any more: {', '.join(sorted(loaded))} have read it")
    if name != PLAIN:
        setattr(module, name, scaled(getattr(module, name), factor))


def answers(folder: Path, tasks: Sequence[str], kept: Path, name: str, factor: float, first: str) -> str | None:
    """Diagnose logs with a threshold changed until an answer moves; what moved, or None. Runs in a process of its own.

    Args:
        folder: of sealed logs.
        tasks: names of logs, in their order.
        kept: folder for the answers, one folder in it for each threshold.
        name: of the threshold.
        factor: that it is multiplied by.
        first: the folder in ``kept`` to compare with.
    """
    _change(name, factor)
    from benchmarks.blind.examine import examine_one

    mine = kept / _folder_of(name, factor)
    mine.mkdir(parents=True, exist_ok=True)
    for task in tasks:
        path = mine / f"{task}.json"
        if not path.exists():
            examine_one(folder, mine, task)
        if first != mine.name:
            moved = difference(json.loads((kept / first / f"{task}.json").read_text()), json.loads(path.read_text()))
            if moved:
                return f"{task}: {moved}"
    return None


def _folder_of(name: str, factor: float) -> str:
    return name if name == PLAIN else f"{name}_{factor:g}"


def difference(before: Mapping[str, Any], after: Mapping[str, Any]) -> str | None:
    """What another answer says otherwise: verdict, names, or values by more than half of what they are unsure by."""
    said = [_said(answer) for answer in (before, after)]
    if said[0] != said[1]:
        return " -> ".join(said)
    if "diagnosis" not in before:
        return None
    for one, other in zip(before["diagnosis"]["effects"], after["diagnosis"]["effects"], strict=True):
        for member, was in one["parameters"].items():
            now = other["parameters"][member]
            unsure = max((was["high"] - was["low"]) / 2, 1e-9)
            shift = max(abs(now[end] - was[end]) for end in ("value", "low", "high"))
            if shift > APART * unsure:
                return f"{member} {was['value']:.3g} -> {now['value']:.3g}, its interval by {shift / unsure:.1f} of it"
    return None


def _said(answer: Mapping[str, Any]) -> str:
    if "diagnosis" not in answer:
        return "refused" if "refused" in answer else "error"
    named = sorted(" ".join([e["name"], *map(str, e["thrusters"])]) for e in answer["diagnosis"]["effects"])
    return f"{answer['diagnosis']['verdict']} ({', '.join(named)})" if named else answer["diagnosis"]["verdict"]


def table(moved: Mapping[tuple[str, float], str | None], names: Iterable[str], factor: float) -> Table:
    """Each threshold with the first answer that it moves, if there is one; those that move nothing first."""
    rows = [(name, *(moved.get((name, f)) or "nothing" for f in (1 / factor, factor))) for name in names]
    rows.sort(key=lambda row: -sum(entry == "nothing" for entry in row[1:]))
    return Table("Thresholds", ("threshold", f"divided by {factor:g} moves", f"times {factor:g} moves"), rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly nothing; change one threshold after the other and see which answers move."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind.ablation", description=__doc__)
    parser.add_argument("folder", type=Path, help="of sealed logs, which python -m benchmarks.blind has flown")
    parser.add_argument("--logs", type=int, default=LOGS, help=f"how many of them, from the first on ({LOGS})")
    parser.add_argument("--factor", type=float, default=FACTOR, help=f"that thresholds are changed by ({FACTOR:g})")
    parser.add_argument("--only", nargs="*", help="names of thresholds; all, where none is said")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes of one thread each")
    asked = parser.parse_args(arguments)
    names = asked.only or list(thresholds())
    if unknown := set(names) - set(thresholds()):
        parser.error(f"no thresholds: {', '.join(sorted(unknown))}")
    from benchmarks.blind.report import markdown

    print(markdown(table(ablate(asked.folder, names, asked.logs, asked.factor, asked.workers), names, asked.factor)))


def ablate(
    folder: Path, names: Sequence[str], logs: int, factor: float, workers: int
) -> dict[tuple[str, float], str | None]:
    """By threshold and factor, the first answer that it moves; None for none."""
    tasks = sorted(json.loads((folder / "manifest.json").read_text())["tasks"])[:logs]
    kept = folder / "ablation"
    found: dict[tuple[str, float], str | None] = {}
    context = multiprocessing.get_context("spawn")  # each process reads the thresholds anew
    with ProcessPoolExecutor(workers, context, max_tasks_per_child=1) as pool:
        one_by_one = [pool.submit(answers, folder, [task], kept, PLAIN, 1.0, PLAIN) for task in tasks]
        for job in tqdm(as_completed(one_by_one), total=len(tasks), desc=PLAIN, unit="log", disable=None):
            job.result()
        jobs = {
            pool.submit(answers, folder, tasks, kept, name, by, PLAIN): (name, by)
            for name in names
            for by in (1 / factor, factor)
        }
        try:
            for job in tqdm(as_completed(jobs), total=len(jobs), desc="changed", unit="threshold", disable=None):
                found[jobs[job]] = job.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return found


if __name__ == "__main__":
    main()
