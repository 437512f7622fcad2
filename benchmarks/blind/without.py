"""``python -m benchmarks.blind.without FOLDER ...``: how many answers change without each part of the diagnosis.

One part is left out at a time, and the first sealed logs of the folders are diagnosed again. The labels stay sealed: an
answer is compared with that of the diagnosis as it is. A part that changes fewer than one answer in a hundred guards
against what these logs do not have, or is not needed. On a log where a part is not called, or gives what stands for it
anyway, the answer stays, and the log is not diagnosed again. A killed run goes on where it was.
"""

import argparse
import importlib
import json
import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any

from tqdm import tqdm

from benchmarks.blind.ablation import Case, difference
from benchmarks.blind.scores.table import Table
from benchmarks.published import RESULTS, commit_to_name, publish

DIAGNOSIS = "auv_torchrl.diagnosis"
PAGE = RESULTS / "ablation.md"
SECTION, SOME = "without", "without_some"  # of all parts, and of those that --only names
LOGS = 40  # of each folder: an answer is then a fortieth of them


def given(place: int) -> Callable[..., Any]:
    """A function that gives back one of its arguments, as if it had found nothing better."""
    return lambda *arguments, **_: arguments[place]


def always(value: Any) -> Callable[..., Any]:
    """A function that finds the same whatever it is given."""
    return lambda *_, **__: value


def _follow_windows(*arguments: Any) -> Any:
    return importlib.import_module(f"{DIAGNOSIS}.identify.following").follow_windows(*arguments)


def _as_fitted(problem: Any, fit: Any) -> Any:
    return fit.explanation, fit.covariance


@dataclass(frozen=True)
class Part:
    """A function of the diagnosis, and what stands for it where it is left out."""

    does: str
    places: tuple[str, ...]  # module and name, or module, class and name, below auv_torchrl.diagnosis
    instead: Callable[..., Any]
    is_slow: bool = False  # what stands for it works, and is not called to see whether it gives the same


PARTS = {
    "search_thresholds": Part("values that are tried near by", ("identify.fit:search_thresholds",), given(1)),
    "named_plainly": Part("plainer names", ("identify.search:_EffectSearch._named_plainly",), given(1)),
    "search_valley": Part("values that move together", ("identify.fit:_search_valley",), given(1)),
    "without_small": Part("small values left out at once", ("identify.search:_EffectSearch._without_small",), given(1)),
    "fitted_on": Part(
        "fits that are fitted on", ("identify.search:fitted_on", "calibrate.flights:fitted_on"), given(1)
    ),
    "hand_on": Part("windows that begin anew", ("identify.following:hand_on",), given(1)),
    "weigh_outliers": Part("outliers that count less", ("identify.following:_weigh_outliers",), lambda p, v, s: (p, s)),
    "follow_agreeing": Part(
        "another sensor where two contradict",
        ("identify.search:follow_agreeing", "log_search:follow_agreeing"),
        _follow_windows,
        is_slow=True,
    ),
    "hold_unseen": Part("nuisance that no window tells is held", ("identify.following:hold_unseen",), given(0)),
    "search_along": Part("the search again along what was found", ("log_search:search_along",), given(1)),
    "find_onset": Part("a change during the log", ("log_search:find_onset",), always(None)),
    "hints_of": Part("a level vehicle's explanations for one that tilts", ("log_search:hints_of",), always([])),
    "fitted_along": Part("values along the motion", ("identify.neighbours:Neighbourhood._fitted_along",), given(1)),
    "exchanged": Part("an effect in place of another", ("identify.neighbours:Neighbourhood.exchanged",), always([])),
    "plugged": Part("the routing of all plugs", ("identify.neighbours:Neighbourhood._plugged",), always([])),
    "is_small": Part("small effects never the best", ("identify.search:_EffectSearch.is_small",), always(False)),
    "measure_noise": Part(
        "noise measured again", ("identify.search:measure_noise", "calibrate.calibration:measure_noise"), given(0)
    ),
    "as_sure": Part("nuisance as wide as the log shows", ("conclude.decision:as_sure",), _as_fitted),
    "worse": Part("the veto of held-out flight", ("explain:worse",), always(())),
    "weigh_readings": Part(
        "channels that do not answer",
        ("pipeline:weigh_readings",),
        lambda log, given, once, unsearched: once(log, 0.0, 1.0)[0],
        is_slow=True,
    ),
    "calibrate_by_prediction": Part(
        "a prediction fit of healthy flights", ("calibrate.calibration:calibrate_by_prediction",), always(None)
    ),
    "measure_ambiguity": Part("scales no flight tells", ("calibrate.calibration:measure_ambiguity",), always(None)),
    "hold_scale": Part("scales held", ("calibrate.calibration:hold_scale", "calibrate.flights:hold_scale"), given(0)),
}

# They acted on few logs and changed no answer; the next run prints no rows for them.
DELETED = ("are_twins", "merged", "rescued")


def leave_out(part: Part) -> None:
    """Put what stands for a part in its place, in this process."""
    for owner, name in _places(part):
        setattr(owner, name, part.instead)


def _places(part: Part) -> Iterator[tuple[Any, str]]:
    """The modules and classes that have a part, with its name there."""
    for place in part.places:
        module, _, name = place.partition(":")
        owner: Any = importlib.import_module(f"{DIAGNOSIS}.{module}")
        *classes, function = name.split(".")
        for one in classes:
            owner = getattr(owner, one)
        if not callable(getattr(owner, function)):
            raise AttributeError(f"{place} is no function")
        yield owner, function


def watch(parts: Mapping[str, Part]) -> set[str]:
    """From now on, in this process, the names of parts that gave something else than what stands for them."""
    acting: set[str] = set()
    for name, part in parts.items():
        for owner, function in _places(part):
            setattr(owner, function, _watched(name, part, getattr(owner, function), acting))
    return acting


def _watched(name: str, part: Part, function: Callable[..., Any], acting: set[str]) -> Callable[..., Any]:
    @wraps(function)
    def watched(*arguments: Any, **named: Any) -> Any:
        found = function(*arguments, **named)
        if name not in acting and (part.is_slow or not _is_same(found, part.instead(*arguments, **named))):
            acting.add(name)
        return found

    return watched


def _is_same(one: Any, other: Any) -> bool:
    """Whether two results are equal for sure."""
    if one is other:
        return True
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_is_same, one, other))
    try:
        return bool(one == other)
    except ValueError:  # arrays somewhere inside
        return False


def parts_acting(case: Case) -> set[str]:
    """Which parts act on a log, which is diagnosed for it; they are watched in this process for good."""
    from benchmarks.blind.examine import examine_one
    from benchmarks.blind.seal import answers_folder, write_json

    folder, task = case
    answers = answers_folder(folder)
    mine = answers / "without"
    mine.mkdir(parents=True, exist_ok=True)
    noted = mine / f"{task}.json"
    if not noted.exists():
        acting = watch(PARTS)
        examine_one(folder, answers, task)
        write_json(noted, {"acting": sorted(acting)})
    return set(json.loads(noted.read_text())["acting"])


def changed_without(name: str, cases: Sequence[Case]) -> list[str]:
    """What the answers to some logs say otherwise without a part; it is left out of this process for good."""
    from benchmarks.blind.examine import examine_one
    from benchmarks.blind.seal import answers_folder

    leave_out(PARTS[name])
    found = []
    for folder, task in cases:
        answers = answers_folder(folder)
        mine = answers / "without" / name
        mine.mkdir(parents=True, exist_ok=True)
        if not (mine / f"{task}.json").exists():
            examine_one(folder, mine, task)
        before, after = (json.loads((where / f"{task}.json").read_text()) for where in (answers, mine))
        if moved := difference(before, after):
            found.append(f"{folder.name}/{task}: {moved}")
    return found


def cases_of(folders: Sequence[Path], logs: int) -> list[Case]:
    """The first logs of some folders."""
    from benchmarks.blind.seal import read_manifest

    return [(folder, task) for folder in folders for task in sorted(read_manifest(folder)["tasks"])[:logs]]


def table(changed: Mapping[str, Sequence[str]], acting: Mapping[str, Sequence[Case]], logs: int) -> Table:
    """Each part with how many answers change without it, the needless first."""
    ranked = sorted(changed, key=lambda name: (len(changed[name]), len(acting[name])))
    rows = [(name, PARTS[name].does, str(len(acting[name])), f"{len(changed[name])} of {logs}") for name in ranked]
    return Table("Without one part", ("part", "what it does", "logs it acts on", "answers that change"), rows)


def main() -> None:
    """Leave out one part after the other and count the answers that change."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind.without", description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, help="of sealed logs, flown by python -m benchmarks.blind")
    parser.add_argument("--logs", type=int, default=LOGS, help=f"of each folder ({LOGS})")
    parser.add_argument("--only", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--publish", action="store_true", help=f"write the table into {PAGE.name}")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes of one thread each")
    asked = parser.parse_args()
    if unknown := set(asked.only or ()) - set(PARTS):
        parser.error(f"no parts: {', '.join(sorted(unknown))}: there are {', '.join(PARTS)}")
    section = SOME if asked.only else SECTION
    commit = commit_to_name(parser, PAGE, section, asked.publish)
    from benchmarks.blind.scores.report import markdown

    cases, changed = cases_of(asked.folders, asked.logs), {}
    names = asked.only or list(PARTS)
    context = multiprocessing.get_context("forkserver")  # each process watches or leaves out for good
    with ProcessPoolExecutor(asked.workers, context, max_tasks_per_child=1) as pool:
        noted = pool.map(parts_acting, cases)
        each = list(zip(cases, tqdm(noted, total=len(cases), unit="log", disable=None), strict=True))
        acting = {name: [case for case, parts in each if name in parts] for name in names}
        done = pool.map(changed_without, names, [acting[name] for name in names])
        for name, moved in zip(names, tqdm(done, total=len(names), unit="part", disable=None), strict=True):
            changed[name] = moved
            tqdm.write("\n".join([f"{name}: {len(moved)} of {len(acting[name])}", *(f"  {one}" for one in moved)]))
    text = markdown(table(changed, acting, len(cases)))
    print(text)
    if asked.publish:
        given = " ".join(folder.name for folder in asked.folders) + f" --logs {asked.logs}"
        given += f" --only {' '.join(asked.only)}" if asked.only else ""
        publish(PAGE, section, text, f"python -m benchmarks.blind.without {given}", commit)


if __name__ == "__main__":
    main()
