"""``python -m benchmarks.blind.ablation FOLDER ...``: which thresholds of the diagnosis change an answer at all.

Each threshold of ``auv_torchrl/diagnosis/thresholds.py`` is divided and multiplied by a factor, one at a time, and the
sealed logs of the folders are diagnosed again, until the answer to one is another one. The labels stay sealed: an
answer is compared with that of the diagnosis as it is. A threshold that moves no answer either way guards against what
these logs do not have, or is not needed. A killed run goes on where it was.
"""

import argparse
import json
import multiprocessing
import os
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from tqdm import tqdm

from benchmarks.blind.table import Table

FACTOR = 4.0  # a threshold that is four times too large or too small lets all pass, or nothing
APART = 0.5  # half widths of its interval, by which a value has moved

Moved = dict[str, tuple[float, str]]  # threshold -> the factor that moved an answer, and what it moved
Case = tuple[Path, str]  # the folder of a sealed log, and its name


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


def ablate(cases: Sequence[Case], names: Sequence[str], factors: Sequence[float], workers: int) -> Moved:
    """What each threshold moves first of some logs, all of which are answered by the diagnosis as it is.

    The factors are tried one after the other, of a threshold that has moved something no further one.
    """
    found: Moved = {}
    context = multiprocessing.get_context("forkserver")  # each process reads the thresholds anew, and them alone
    context.set_forkserver_preload(["auv_torchrl.flightlog", "auv_torchrl.physics.kernel", "auv_torchrl.simulator"])
    with ProcessPoolExecutor(workers, context, max_tasks_per_child=1) as pool:
        for factor in factors:
            still = [name for name in names if name not in found]
            jobs = {pool.submit(moved_by, cases, name, factor): name for name in still}
            try:
                for job in tqdm(as_completed(jobs), total=len(jobs), desc=f"times {factor:g}", unit="threshold"):
                    if moved := job.result():
                        found[jobs[job]] = factor, moved
            except BaseException:  # those that run write their answers, the rest does not begin
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    return found


def moved_by(cases: Sequence[Case], name: str, factor: float) -> str | None:
    """Change a threshold of this process, and diagnose logs until an answer moves; what moved, or None.

    Raises:
        RuntimeError: if something of this process has read the thresholds before.
    """
    from auv_torchrl.diagnosis import thresholds as module

    readers = {module for module in sys.modules if module.startswith("auv_torchrl.diagnosis.")}
    if readers - {module.__name__}:
        raise RuntimeError(f"{name} cannot be changed any more: {', '.join(sorted(readers))} have read it")
    setattr(module, name, scaled(getattr(module, name), factor))
    from benchmarks.blind.examine import examine_one
    from benchmarks.blind.seal import answers_folder

    for folder, task in cases:
        answers = answers_folder(folder)
        mine = answers / "ablation" / f"{name}_{factor:g}"
        mine.mkdir(parents=True, exist_ok=True)
        path = mine / f"{task}.json"
        if not path.exists():
            examine_one(folder, mine, task)
        before, after = (json.loads(file.read_text()) for file in (answers / path.name, path))
        if moved := difference(before, after):
            return f"{folder.name}/{task}: {moved}"
    return None


def difference(before: Mapping[str, Any], after: Mapping[str, Any]) -> str | None:
    """What another answer says otherwise: verdict, names, or values by more than half of what they are unsure by."""
    was, now = _said(before), _said(after)
    if was != now:
        return f"{was} -> {now}"
    if "diagnosis" not in before:
        return None
    for one, other in zip(before["diagnosis"]["effects"], after["diagnosis"]["effects"], strict=True):
        for member, value in one["parameters"].items():
            unsure = max((value["high"] - value["low"]) / 2, 1e-9)
            shift = max(abs(other["parameters"][member][end] - value[end]) for end in ("value", "low", "high"))
            if shift > APART * unsure:
                return f"value or interval of {member} by {shift / unsure:.1f} of what it was unsure by"
    return None


def _said(answer: Mapping[str, Any]) -> str:
    if "diagnosis" not in answer:
        return "refused" if "refused" in answer else "error"
    verdict, effects = answer["diagnosis"]["verdict"], answer["diagnosis"]["effects"]
    named = sorted(" ".join([effect["name"], *map(str, effect["thrusters"])]) for effect in effects)
    return f"{verdict} ({', '.join(named)})" if named else verdict


def table(moved: Moved, names: Sequence[str]) -> Table:
    """Each threshold with the first answer that it moves; those that move nothing come first."""
    rows = [(name, "", "nothing") for name in names if name not in moved]
    rows += [(name, f"{moved[name][0]:g}", moved[name][1]) for name in names if name in moved]
    return Table("Thresholds", ("threshold", "times", "moves"), rows)


def main() -> None:
    """Change one threshold after the other and say which answers move."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind.ablation", description=__doc__)
    parser.add_argument(
        "folders", nargs="+", type=Path, help="of sealed logs, that python -m benchmarks.blind has flown"
    )
    parser.add_argument("--factor", type=float, default=FACTOR, help=f"that thresholds are changed by ({FACTOR:g})")
    parser.add_argument("--only", nargs="*", metavar="NAME", help="of thresholds; all, where none is said")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes of one thread each")
    asked = parser.parse_args()
    names = asked.only or list(thresholds())
    if unknown := set(names) - set(thresholds()):
        parser.error(f"no thresholds: {', '.join(sorted(unknown))}: there are {', '.join(thresholds())}")
    for folder in asked.folders:
        if not (folder / "manifest.json").exists():
            parser.error(f"no sealed logs in {folder}: fly them by python -m benchmarks.blind cases=40 seed=...")
    from benchmarks.blind.report import markdown

    factors = (asked.factor, 1 / asked.factor)
    moved = ablate(quickest_first(asked.folders, asked.workers), names, factors, asked.workers)
    print(markdown(table(moved, names)))


def quickest_first(folders: Sequence[Path], workers: int) -> list[Case]:
    """The logs of some folders by the time that they take, all of them answered by the diagnosis as it is.

    What an answer moves is found soonest so.
    """
    from benchmarks.blind.examine import examine, read_answers
    from benchmarks.blind.seal import answers_folder

    took: dict[Case, float] = {}
    for folder in folders:
        examine(folder, answers_folder(folder), workers)
        answers = read_answers(folder, answers_folder(folder))
        took.update({(folder, name): answer["cpu_s"] for name, answer in answers.items()})
    return sorted(took, key=took.__getitem__)


if __name__ == "__main__":
    main()
