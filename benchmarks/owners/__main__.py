"""``python -m benchmarks.owners stock --cases 30``: seal what owners' vehicles do, diagnose it, open the seal, score.

A killed run goes on when its command is given again; answers of another version of the diagnosis are kept apart.
"""

import argparse
import sys
from pathlib import Path

from auv_torchrl.paths import PROJECT
from auv_torchrl.vehicle import load_vehicle
from benchmarks import published, show_progress
from benchmarks.blind.examine import examine, read_answers
from benchmarks.blind.flights.fly import fly
from benchmarks.blind.flights.sensor_sets import SENSOR_SETS, sensor_set
from benchmarks.blind.scores.report import markdown
from benchmarks.blind.seal import answers_folder, is_sealed, open_labels, seal
from benchmarks.owners.acts import ACTS
from benchmarks.owners.cases import draw_owner_cases
from benchmarks.owners.score import Outcome, owner_tables, score_owner
from benchmarks.owners.still import kinds

PAGE = PROJECT / "docs" / "results" / "owners.md"
CASES = 36  # two of each family and file


def measured(sensors: str, cases: int, seed: int, folder: Path, workers: int) -> list[Outcome]:
    """Fly what the folder lacks, diagnose it, open the labels and score."""
    settings = {"cases": cases, "seed": seed, "sensors": sensors, "is_guess": True}
    vehicle = load_vehicle(sensor_set(sensors).vehicle)
    if not is_sealed(folder, settings):
        drawn = draw_owner_cases(sensors, cases, seed)
        seal(folder, settings, fly(drawn, vehicle, seed, ACTS), kinds(sensors))
    answers = answers_folder(folder)
    examine(folder, answers, workers)
    given = read_answers(folder, answers)
    return [score_owner(name, label, given[name], vehicle) for name, label in open_labels(folder).items()]


def main() -> None:
    """Measure and print, or write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.owners", description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("sensors", choices=SENSOR_SETS)
    parser.add_argument("--cases", type=int, default=CASES, help=f"to be diagnosed ({CASES})")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1, help="processes of one thread each")
    parser.add_argument("--folder", type=Path, default=PROJECT / "outputs" / "owners")
    parser.add_argument("--publish", action="store_true", help=f"write the tables into {PAGE.relative_to(PROJECT)}")
    asked = parser.parse_args()
    if asked.cases < 1 or asked.seed < 0 or asked.workers < 1:
        parser.error("--cases and --workers are 1 or more, --seed is 0 or more")
    section = f"owners {asked.sensors}"
    commit = published.commit_to_name(parser, PAGE, section, asked.publish)
    show_progress()
    folder = asked.folder / f"{asked.sensors}_{asked.cases}_cases_seed_{asked.seed}"
    folder.mkdir(parents=True, exist_ok=True)
    outcomes = measured(asked.sensors, asked.cases, asked.seed, folder, asked.workers)
    text = "\n\n".join(map(markdown, owner_tables(outcomes, asked.sensors)))
    print(text)
    if asked.publish:
        command = f"python -m benchmarks.owners {asked.sensors} --cases {asked.cases} --seed {asked.seed}"
        published.publish(PAGE, section, text, command, commit)


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit("stopped; the same command goes on with what is not diagnosed yet")
