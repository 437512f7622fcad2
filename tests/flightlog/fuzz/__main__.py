"""Reads many logs that hypothesis makes, and says by format how many were read, how many refused, and what failed.

``python -m tests.flightlog.fuzz --draws 5000 --seed 1 --formats ulog,mcap --keep FOLDER``; the exit code is 1 after a
failure. Of each kind of failure the smallest log is written to the folder.
"""

import argparse
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings

from tests import everybody  # noqa: F401  # loads the profile of property tests
from tests.flightlog.fuzz.contract import TooSlow, peak_bytes, read_or_refuse, written
from tests.flightlog.fuzz.damage import Log
from tests.flightlog.fuzz.formats import FORMATS


@dataclass
class Failure:
    """One kind of failure: how often, what it says, and the smallest log that shows it."""

    count: int
    sentence: str
    log: Log


@dataclass
class Score:
    """What came of the logs of one format."""

    outcomes: Counter[str] = field(default_factory=Counter)
    failures: dict[str, Failure] = field(default_factory=dict)
    peak: int = 0  # bytes
    slowest: float = 0.0  # s of CPU time

    def read(self, log: Log) -> None:
        """Read a log and note what came of it."""
        with tempfile.TemporaryDirectory() as folder:
            path, begin = written(log, Path(folder)), time.process_time()
            try:
                outcome = read_or_refuse(path)
            except (Exception, TooSlow) as error:  # what reading may not end with
                outcome = "failed"
                self._note(error, log)
            self.slowest = max(self.slowest, time.process_time() - begin)
            self.peak = max(self.peak, peak_bytes())
        self.outcomes[outcome] += 1

    def _note(self, error: BaseException, log: Log) -> None:
        frames = traceback.extract_tb(error.__traceback__)
        ours = [frame for frame in frames if "auv_torchrl" in frame.filename] or frames
        kind = f"{type(error).__name__} at {Path(ours[-1].filename).name}:{ours[-1].lineno}"
        kind += f" {str(error)[:14]}" if isinstance(error, AssertionError) else ""
        known = self.failures.get(kind)
        if known is None or _size(log) < _size(known.log):
            count = known.count if known else 0
            known = self.failures[kind] = Failure(count, " ".join(f"{error}".split())[:300], log)
        known.count += 1


def _size(log: Log) -> int:
    return len(log.content) if isinstance(log.content, bytes) else sum(map(len, log.content.values()))


def main() -> None:
    """Share the draws out over the formats, and print a table of them."""
    given_ = argparse.ArgumentParser(description=__doc__)
    given_.add_argument("--draws", type=int, default=5000, help="logs over all formats")
    given_.add_argument("--seed", type=int, default=0)
    given_.add_argument("--formats", default=",".join(FORMATS))
    given_.add_argument("--keep", type=Path, help="folder for the smallest log of each kind of failure")
    options = given_.parse_args()
    warnings.filterwarnings("error", module="auv_torchrl")  # as in the tests: it would stand on people's terminals
    names = options.formats.split(",")
    scores = {}
    print(f"{'format':<16}{'logs':>6}{'rows':>6}{'info':>6}{'refused':>9}{'failed':>8}{'peak':>10}{'slowest':>10}")
    for name in names:
        scores[name] = score = _score(name, -(-options.draws // len(names)), options.seed)
        print(_line(name, score), flush=True)
    total = Score(sum((s.outcomes for s in scores.values()), Counter()), {}, max(s.peak for s in scores.values()))
    total.slowest = max(score.slowest for score in scores.values())
    print(_line("all", total))
    _report(scores, options.keep)
    sys.exit(total.outcomes["failed"] > 0)


def _score(name: str, draws: int, number: int) -> Score:
    score = Score()

    @seed(number)
    @settings(
        max_examples=draws,
        derandomize=False,
        phases=[Phase.generate],
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
    @given(FORMATS[name]())
    def draw(log: Log) -> None:
        score.read(log)

    draw()
    return score


def _line(name: str, score: Score) -> str:
    told = score.outcomes
    rows = sum(count for outcome, count in told.items() if outcome.endswith("rows") and "no rows" not in outcome)
    info = told["read, no rows"]
    return (
        f"{name:<16}{told.total():>6}{rows:>6}{info:>6}{told['refused, no rows']:>9}{told['failed']:>8}"
        f"{score.peak / 1e6:>7.0f} MB{score.slowest:>8.2f} s"
    )


def _report(scores: dict[str, Score], folder: Path | None) -> None:
    for name, score in scores.items():
        for number, (kind, failure) in enumerate(score.failures.items()):
            print(f"{name}: {failure.count} x {kind}: {failure.sentence}")
            if folder is not None:
                place = folder / f"{name}_{number}"
                place.mkdir(parents=True, exist_ok=True)
                print(f"  {written(failure.log, place)!r}")


if __name__ == "__main__":
    main()
