"""``python -m benchmarks.trial``: fly sealed cases through ArduSub's firmware, diagnose its logs, do what is advised.

ARDUSUB names the firmware's program. Prints the table as Markdown; ``--publish`` writes it into docs/results/trial.md.
Each dive and each answer is kept under ``outputs/trial`` as soon as it is there, by a digest of the code: a killed run
goes on where its command is given again, and one with ``--minutes`` ends after the case in which these are over.

``benchmarks.trial.once`` flies one dive, and needs no firmware where that is recorded.
"""

import argparse
import logging
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from auv_torchrl.paths import PROJECT
from benchmarks import provenance, show_progress
from benchmarks import published as tables
from benchmarks.trial import firmware, page, work
from benchmarks.trial.cases import Case, draw_cases
from benchmarks.trial.dive import Refused

log = logging.getLogger(__name__)
PAGE, SECTION = PROJECT / "docs" / "results" / "trial.md", "trial"
KEPT = PROJECT / "outputs" / "trial"


def run(cases: Sequence[Case], folder: Path, seed: int, minutes: float | None, niceness: int) -> list:
    """The cases with their results, as many as there is time for."""
    begun, results = time.monotonic(), []
    # Firmware and physics take turns: a low priority would have each turn wait. A diagnosis may.
    with ProcessPoolExecutor(1, get_context("spawn"), initializer=os.nice, initargs=(niceness,)) as aside:
        for case in cases:
            if minutes is not None and time.monotonic() - begun > 60 * minutes and not work.is_done(case, folder):
                break
            try:
                results.append((case, work.run(case, folder, seed, aside)))
            except Refused as error:
                log.warning("%s is left out: %s", case.name, error)
                continue
            log.info("| %s |", " | ".join(page.row(*results[-1])))
    return results


def main() -> None:
    """Fly, print, publish."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--cases", type=int, default=48)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, help="no further case is begun after these")
    parser.add_argument("--nice", type=int, default=0, help="of the diagnoses, where others use the machine")
    parser.add_argument("--publish", action="store_true", help=f"write the table into {PAGE.name}")
    options = parser.parse_args()
    show_progress()
    command = f"python -m benchmarks.trial --cases {options.cases} --seed {options.seed}"
    try:
        firmware.program()
    except ValueError as error:
        parser.error(str(error))
    commit = tables.commit_to_name(parser, PAGE, SECTION, options.publish)
    folder = KEPT / f"{options.seed}-{provenance.digest()}"
    folder.mkdir(parents=True, exist_ok=True)
    results = run(draw_cases(options.cases, options.seed), folder, options.seed, options.minutes, options.nice)
    text = "\n".join(page.lines(results, options.cases))
    sys.stdout.write(text + "\n")
    if options.publish:
        tables.publish(PAGE, SECTION, text, command, commit)


if __name__ == "__main__":
    main()
