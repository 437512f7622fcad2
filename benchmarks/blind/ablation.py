"""``python -m benchmarks.blind.ablation FOLDER ...``: which parts of the diagnosis change an answer at all.

Each threshold of ``auv_torchrl/diagnosis/thresholds.py`` is multiplied by a factor, or with ``--off`` each part that a
threshold can switch off is switched off, one at a time or ``--together``, and the sealed logs of the folders are
diagnosed again, until the answer to one is another one. The labels stay sealed: an answer is compared with that of the
diagnosis as it is. What moves no answer guards against what these logs do not have, or is not needed. A killed run goes
on where it was.
"""

import argparse
import hashlib
import json
import math
import multiprocessing
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from tqdm import tqdm

from benchmarks.blind.scores.table import Table

FACTOR = 4.0  # a threshold that is four times too large or too small lets all pass, or nothing
APART = 0.5  # half widths of its interval, by which a value has moved

# What switches a part off: it is never begun, or nothing is ever beyond it.
OFF: dict[str, Any] = {
    "BENT": 0.0, "CLOSES": 0.0, "CONTENDS": 0.0, "FEW_LOST": 0.0, "FITTED_ON": 0, "FLICKERS": 0.0,
    "HEIRS": 0, "HOPELESS": 0.0, "HUBER": math.inf, "LEAST_NOISE": 0.0, "LOST_START": math.inf,
    "MANY_OUTLIERS": 0.0, "MANY_WINDOWS": math.inf, "MINOR": 0.0, "MODEL_ERROR": 0.0, "MOSTLY_LOST": 1.0, "NEAR": 0.0,
    "NOISE_MATTERS": math.inf, "NOTHING_TO_MAP": 0.0, "ONSET_CLEAR": math.inf, "RELINEARISED": 0,
    "SEEN_AT_ALL": 0.0, "SETTLING": 1, "SMALL_SWING": 0.0, "STANDS_IN": 1.0, "STILL_GAINS": math.inf, "TELLS": 0.0,
    "TELLS_SCALES": 0.0, "THRESHOLD_REACH": (), "WALKS": 0,
}  # fmt: skip

Changed = Mapping[str, Any]  # threshold -> its other value
Moved = dict[str, str]  # what was changed -> the first answer that it moved
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


def ablate(cases: Sequence[Case], changes: Mapping[str, Changed], label: str, workers: int) -> Moved:
    """What each change of thresholds moves first of some logs, all of which are answered by the diagnosis as it is."""
    found: Moved = {}
    context = multiprocessing.get_context("forkserver")  # each process reads the thresholds anew, and them alone
    context.set_forkserver_preload(["auv_torchrl.flightlog", "auv_torchrl.simulator.plain"])
    with ProcessPoolExecutor(workers, context, max_tasks_per_child=1) as pool:
        jobs = {pool.submit(moved_by, cases, name, changed, label): name for name, changed in changes.items()}
        try:
            for job in tqdm(as_completed(jobs), total=len(jobs), desc=label, unit="threshold", disable=None):
                if moved := job.result():
                    found[jobs[job]] = moved
        except BaseException:  # those that run write their answers, the rest does not begin
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return found


def moved_by(cases: Sequence[Case], name: str, changed: Changed, label: str) -> str | None:
    """Change thresholds of this process, and diagnose logs until an answer moves; what moved, or None.

    Raises:
        RuntimeError: if something of this process has read the thresholds before.
    """
    from auv_torchrl.diagnosis import thresholds as module

    readers = {module for module in sys.modules if module.startswith("auv_torchrl.diagnosis.")}
    if readers - {module.__name__}:
        raise RuntimeError(f"{name} cannot be changed any more: {', '.join(sorted(readers))} have read it")
    for threshold, value in changed.items():
        setattr(module, threshold, value)
    from benchmarks.blind.examine import examine_one
    from benchmarks.blind.seal import answers_folder

    short = name if len(changed) == 1 else hashlib.sha256(name.encode()).hexdigest()[:16]  # a file's name has an end
    for folder, task in cases:
        answers = answers_folder(folder)
        mine = answers / "ablation" / f"{short}_{label}"
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
    was, now = _answer(before), _answer(after)
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


def _answer(answer: Mapping[str, Any]) -> str:
    if "diagnosis" not in answer:
        return "refused" if "refused" in answer else "error"
    verdict, effects = answer["diagnosis"]["verdict"], answer["diagnosis"]["effects"]
    named = sorted(" ".join([effect["name"], *map(str, effect["thrusters"])]) for effect in effects)
    return f"{verdict} ({', '.join(named)})" if named else verdict


def table(moved: Moved, names: Iterable[str], label: str) -> Table:
    """Each threshold with the first answer that it moves; those that move nothing come first."""
    rows = [(name, moved.get(name, "nothing")) for name in sorted(names, key=lambda name: name in moved)]
    return Table("Thresholds", ("threshold", f"{label} moves"), rows)


def main() -> None:
    """Change one threshold after the other and say which answers move."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind.ablation", description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, help="of sealed logs, flown by python -m benchmarks.blind")
    parser.add_argument("--factor", type=float, default=FACTOR, help=f"that thresholds are changed by ({FACTOR:g})")
    parser.add_argument("--off", action="store_true", help="switch parts off instead")
    parser.add_argument("--together", action="store_true", help="change all of them at once")
    parser.add_argument("--only", nargs="*", metavar="NAME", help="of thresholds; all, where none is given")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes of one thread each")
    asked = parser.parse_args()
    label = "off" if asked.off else f"{asked.factor:g}"
    changed = OFF if asked.off else {name: scaled(value, asked.factor) for name, value in thresholds().items()}
    if unknown := set(asked.only or ()) - set(changed):
        parser.error(f"no thresholds: {', '.join(sorted(unknown))}: there are {', '.join(changed)}")
    for folder in asked.folders:
        if not (folder / "manifest.json").exists():
            parser.error(f"no sealed logs in {folder}: fly them by python -m benchmarks.blind cases=40 seed=...")
    from benchmarks.blind.scores.report import markdown

    changed = {name: changed[name] for name in asked.only or changed}
    changes = {name: {name: value} for name, value in changed.items()}
    if asked.together:
        changes = {", ".join(changed): changed}
    moved = ablate(quickest_first(asked.folders, asked.workers), changes, label, asked.workers)
    print(markdown(table(moved, changes, "off" if asked.off else f"times {label}")))


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
