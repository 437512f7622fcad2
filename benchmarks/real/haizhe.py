"""``python -m benchmarks.real.haizhe``: runs of a small real AUV with labelled faults ("Haizhe"), ten seconds each.

Every run is one step of four equal commands. Labels are used to choose the normal runs and to score, nowhere else: of
each class a fifth is set aside by ``--seed``, the normal runs that are left are the sound ones, and what is aside is
diagnosed, each run by itself and in groups of eight. ``docs/how-to/run-the-benchmarks.md`` says where to get the file.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import torch

from auv_torchrl.diagnosis.identify.hypotheses import Settings, apply_values, load_settings
from auv_torchrl.diagnosis.verdict import Verdict
from auv_torchrl.flightlog import Episode, FlightLog
from auv_torchrl.monitoring.repeated_runs import RunReport, compare_runs, learn_healthy_runs
from auv_torchrl.vehicle import Vehicle, load_vehicle
from benchmarks.real import DATA
from benchmarks.scoring import Named, Score
from benchmarks.scoring import score as score_names

FILE = Path("haizhe") / "train.parquet"
RATE = 20.0  # Hz
AXES = ("z", "roll", "pitch", "r")
STOPPED, REACH = 1100.0, 200.0  # us: no thrust, and what is called a full command
PAUSE_S = 300.0  # between sessions
TETHER = {"tether": {"stiffness": 15.0}}  # N/m: sound runs stop at half a metre as if on a spring
NORMAL, LOAD, DEPTH = "Normal", "AddWeight", "PressureGain_constant"
DAMAGED = ("PropellerDamage_bad", "PropellerDamage_slight")
DAMAGE = "damage"  # what is neither a load nor the depth sensor
CLASSES = (NORMAL, LOAD, DEPTH, *DAMAGED)
SEEDS = range(5)  # of the page
MEANS = {"payload": LOAD, "buoyancy": LOAD, "depth_bias": DEPTH, "depth_scale": DEPTH}
SET_ASIDE = 5  # every fifth run of each class
TOGETHER = 8  # runs of a group


@dataclass(frozen=True)
class Scored:
    """What runs of one class were said to be."""

    truth: str
    single: tuple[str, ...]
    groups: tuple[str, ...]
    scores: tuple[Score, ...]  # of single runs

    def as_dict(self) -> dict[str, Any]:
        """Of plain types."""
        return {**asdict(self), "scores": [score.name for score in self.scores]}

    @classmethod
    def of(cls, kept: Mapping[str, Any]) -> "Scored":
        """What :meth:`as_dict` gave, written as JSON or not."""
        scores = tuple(Score[name] for name in kept["scores"])
        return cls(kept["truth"], tuple(kept["single"]), tuple(kept["groups"]), scores)


def own_vehicle() -> Vehicle:
    """The vehicle as its sound runs show it."""
    return apply_values(load_vehicle(Path(__file__).with_name("haizhe.yaml")), TETHER)


def read_classes(path: Path) -> dict[str, list[FlightLog]]:
    """Sessions of each class, each a log whose episodes are its runs."""
    table = pq.read_table(path)
    columns = {name: table[name].to_numpy(zero_copy_only=False) for name in table.column_names}
    runs, first = np.unique(columns["run"], return_index=True)
    by_class: dict[str, list[tuple[float, str]]] = {}
    for run, row in zip(runs.tolist(), first.tolist(), strict=True):
        by_class.setdefault(str(columns["class"][row]), []).append((_seconds(int(columns["time"][row])), run))
    return {name: _sessions(name, sorted(begun), columns) for name, begun in sorted(by_class.items())}


def score(classes: Mapping[str, Sequence[FlightLog]], settings: Settings, seed: int) -> list[Scored]:
    """Diagnose a fifth of each class with the rest of the normal runs as sound ones."""
    vehicle, rng = own_vehicle(), np.random.default_rng(seed)
    numbers = {name: _numbers(logs) for name, logs in classes.items()}
    aside = {name: rng.permutation(own)[: len(own) // SET_ASIDE] for name, own in numbers.items()}
    rest = set(numbers[NORMAL]) - set(aside[NORMAL].tolist())
    sound = learn_healthy_runs(_only(classes[NORMAL], rest), vehicle)
    found = []
    for name, chosen in aside.items():
        single = compare_runs(_only(classes[name], set(chosen.tolist())), sound, vehicle, settings).runs
        whole = chosen[: len(chosen) // TOGETHER * TOGETHER].reshape(-1, TOGETHER).tolist()
        groups = [compare_runs(_only(classes[name], set(own)), sound, vehicle, settings).together for own in whole]
        scores = tuple(score_of(name, run) for run in single)
        found.append(Scored(name, tuple(map(_said, single)), tuple(map(_said, groups)), scores))
    return found


def table(scored: Sequence[Scored]) -> Iterator[str]:
    """Lines of Markdown: what runs of each class were said to be, and the shares that are right."""
    said = "sound | load | depth sensor | something else"
    yield f"| flown with | runs | {said} | right | half right | groups of 8: right |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for own in scored:
        counts = " | ".join(str(own.single.count(said)) for said in (NORMAL, LOAD, DEPTH, DAMAGE))
        right = sum(said == _merged(own.truth) for said in own.groups)
        scores = " | ".join(str(own.scores.count(score)) for score in (Score.RIGHT, Score.HALF))
        yield f"| {own.truth} | {len(own.single)} | {counts} | {scores} | {right}/{len(own.groups)} |"
    yield ""
    for label, share in shares(scored).items():
        yield f"- {label}: {share:.1%}"


def tables(by_seed: Mapping[int, Sequence[Mapping[str, Any]]]) -> Iterator[str]:
    """Lines of Markdown: the table and shares of the first seed, and a table with the shares of all."""
    scored = {seed: [Scored.of(kept) for kept in found] for seed, found in by_seed.items()}
    yield from table(next(iter(scored.values())))
    yield ""
    yield f"| seed | {' | '.join(shares(next(iter(scored.values()))))} |"
    yield "|---|" + "---|" * len(shares(next(iter(scored.values()))))
    for seed, found in scored.items():
        yield f"| {seed} | {' | '.join(f'{share:.1%}' for share in shares(found).values())} |"


def shares(scored: Sequence[Scored]) -> dict[str, float]:
    """The figures, each with what it counts."""

    def right(kind: str, same: Callable[[str, str], bool]) -> float:
        pairs = [(own.truth, said) for own in scored for said in getattr(own, kind)]
        return sum(same(truth, said) for truth, said in pairs) / len(pairs)

    def apart(said: str) -> str:
        return said if said in (LOAD, DEPTH) else "rest"

    (normal,) = [own for own in scored if own.truth == NORMAL]
    scores = [score for own in scored for score in own.scores]
    return {
        "single runs: verdict and likely names right": scores.count(Score.RIGHT) / len(scores),
        "load, depth sensor or the rest": right("single", lambda truth, said: apart(truth) == apart(said)),
        "five classes (a damage is called bad)": right(
            "single", lambda truth, said: truth == (DAMAGED[0] if said == DAMAGE else said)
        ),
        "groups of 8, damages merged": right("groups", lambda truth, said: _merged(truth) == said),
        "normal runs called faulty": sum(said != NORMAL for said in normal.single) / len(normal.single),
    }


def score_of(truth: str, answer: RunReport) -> Score:
    """The score of an answer about one run; no effect of the library is a cut blade, and none knows its size."""
    wanted = {NORMAL: (Verdict.NO_GAP,), LOAD: (Verdict.EXPLAINED,), DEPTH: (Verdict.EXPLAINED,)}
    fits = answer.verdict in wanted[truth] if truth in wanted else answer.verdict is not Verdict.NO_GAP
    causes = (truth,) if truth in (LOAD, DEPTH) else ()
    named = []
    for cause in answer.causes:
        meant = MEANS.get(cause.name, DAMAGE)
        stands_for = frozenset((meant,)) & set(causes)
        named.append(Named(cause.probability, stands_for, is_exact=meant == _merged(truth)))
    return score_names(fits, causes, named)


def _merged(truth: str) -> str:
    return DAMAGE if truth in DAMAGED else truth


def _said(answer: RunReport) -> str:
    if answer.verdict is Verdict.NO_GAP:
        return NORMAL
    return MEANS.get(answer.causes[0].name, DAMAGE) if answer.causes else DAMAGE


def _numbers(logs: Sequence[FlightLog]) -> list[int]:
    return [episode.number for log in logs for episode in log.episodes]


def _only(logs: Sequence[FlightLog], numbers: set[int]) -> list[FlightLog]:
    kept = (log.only(numbers) for log in logs)
    return [log for log in kept if log.episodes]


def _sessions(name: str, begun: Sequence[tuple[float, str]], columns: Mapping[str, np.ndarray]) -> list[FlightLog]:
    sessions: list[list[Episode]] = []
    last = -np.inf
    for number, (seconds, run) in enumerate(begun):
        if seconds - last > PAUSE_S:
            sessions.append([])
        last = seconds
        rows = np.flatnonzero(columns["run"] == run)
        sessions[-1].append(_episode(number, run, {key: column[rows] for key, column in columns.items()}))
    return [FlightLog(f"{name}, session {i + 1}", tuple(own), AXES) for i, own in enumerate(sessions)]


def _seconds(clock: int) -> float:
    return clock // 10000 * 3600 + clock // 100 % 100 * 60 + clock % 100


def _episode(number: int, run: str, own: Mapping[str, np.ndarray]) -> Episode:
    count = len(own["depth"])
    pose, velocity = np.full((2, count, 6), np.nan)
    pose[:, 2] = own["depth"]
    pose[:, 3], pose[:, 4] = np.radians(own["roll"]), -np.radians(own["pitch"])  # its y points to port,
    velocity[:, 5] = -np.radians(own["w_yaw"])  # its z up
    pulses = np.stack([own[f"pwm{i}"] for i in range(1, 5)], axis=1).astype(float)
    volts = own["voltage"].astype(float)
    return Episode(number, np.arange(count) / RATE, pose, velocity, (pulses - STOPPED) / REACH, volts, source=run)


def main() -> None:
    """Score a fifth of the runs and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--data", type=Path, default=DATA, help=f"folder with {FILE}")
    parser.add_argument("--seed", type=int, default=0, help="which fifth is set aside")
    parser.add_argument("--none", type=float, help="prior probability that a run is sound, in place of the settings'")
    options = parser.parse_args()
    if not (options.data / FILE).is_file():
        parser.error(f"{options.data} lacks {FILE}: docs/how-to/run-the-benchmarks.md says where to get it")
    torch.set_num_threads(1)
    settings = load_settings()
    settings = replace(settings, prior_none=options.none) if options.none else settings
    scored = score(read_classes(options.data / FILE), settings, options.seed)
    print("\n".join(table(scored)))


if __name__ == "__main__":
    main()
