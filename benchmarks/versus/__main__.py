"""``python -m benchmarks.versus --cases 20 --seed N``: sealed logs for the diagnosis and for mujoco.sysid.

A killed run goes on when its command is given again; answers of other versions of either are kept apart.
"""

import argparse
import hashlib
import json
import logging
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from auv_torchrl.flightlog import read_flightlog
from auv_torchrl.paths import PROJECT
from auv_torchrl.vehicle import load_vehicle
from benchmarks import published, show_progress
from benchmarks.blind.examine import examine, read_answers
from benchmarks.blind.scores.report import markdown
from benchmarks.blind.scores.table import Table
from benchmarks.blind.seal import answers_folder, log_path, open_labels, read_manifest, write_json

PAGE, SECTION = PROJECT / "docs" / "results" / "comparison.md", "versus"
CASES = 20
NEEDED = ("plotly", "tabulate")  # that mujoco.sysid imports, and nothing else here

log = logging.getLogger(__name__)


def fit_all(folder: Path, models: list[Any]) -> dict[str, dict[str, Any]]:
    """What the fits say of each log, by model; logs that were fitted before are not again."""
    from benchmarks.versus.cases import VEHICLE, held_path
    from benchmarks.versus.fit import fit
    from benchmarks.versus.windows import EVERY_S, FIT_S, HELD_S, cut

    vehicle, answers = load_vehicle(VEHICLE), folder / f"fits_{_version()}"
    answers.mkdir(exist_ok=True)
    said: dict[str, dict[str, Any]] = {model.name: {} for model in models}
    for name in read_manifest(folder)["tasks"]:
        windows = cut(read_flightlog(log_path(folder, name), vehicle), FIT_S, EVERY_S)
        held = cut(read_flightlog(held_path(folder, name), vehicle), HELD_S, HELD_S)
        for model in models:
            path = answers / f"{name}_{model.name}.json"
            if not path.exists():
                write_json(path, fit(model, windows, held))
                log.info("%s: fitted by %s", name, model.name)
            said[model.name][name] = json.loads(path.read_text())
    return said


def measured(cases: int, seed: int, folder: Path) -> list[Table]:
    """Fly what the folder lacks, let all programs answer, open the labels and score."""
    from benchmarks.versus.cases import VEHICLE, held_path, sealed
    from benchmarks.versus.fit import error_m
    from benchmarks.versus.judge import judge_fit, judge_ours, values_of
    from benchmarks.versus.mujoco_model import MujocoModel
    from benchmarks.versus.own_simulator import OwnSimulator, predict, with_values
    from benchmarks.versus.score import OURS, tables
    from benchmarks.versus.windows import HELD_S, cut

    sealed(folder, cases, seed)
    vehicle, answers = load_vehicle(VEHICLE), answers_folder(folder)
    examine(folder, answers, 1)
    given = read_answers(folder, answers)
    models = [MujocoModel(VEHICLE), OwnSimulator(vehicle)]
    fitted = fit_all(folder, models)
    outcomes: dict[str, list[Any]] = {OURS: [], **{model.name: [] for model in models}}
    for name, label in open_labels(folder).items():
        held = cut(read_flightlog(held_path(folder, name), vehicle), HELD_S, HELD_S)
        flown = [error_m(predict(one, held), held) for one in (vehicle, with_values(vehicle, values_of(given[name])))]
        outcomes[OURS].append(judge_ours(name, label, given[name], (flown[0], flown[1]), vehicle))
        for model in models:
            outcomes[model.name].append(judge_fit(name, label, fitted[model.name][name], vehicle))
    return tables(outcomes, *(model.free for model in models))


def main() -> None:
    """Measure and print, or write the page."""
    description = (__doc__ or "").split("\n", 1)[0]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.versus", description=description)
    parser.add_argument("--cases", type=int, default=CASES, help=f"logs to be explained ({CASES})")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=PROJECT / "outputs" / "versus")
    parser.add_argument("--publish", action="store_true", help=f"write the tables into {PAGE.relative_to(PROJECT)}")
    asked = parser.parse_args()
    if asked.cases < 1 or asked.seed < 0:
        parser.error("--cases is 1 or more, --seed is 0 or more")
    if missing := [name for name in NEEDED if find_spec(name) is None]:
        parser.error(f"mujoco.sysid imports {' and '.join(missing)}: pip install '.[bench]'")
    commit = published.commit_to_name(parser, PAGE, SECTION, asked.publish)
    show_progress()
    folder = asked.folder / f"{asked.cases}_cases_seed_{asked.seed}"
    folder.mkdir(parents=True, exist_ok=True)
    text = "\n\n".join(map(markdown, measured(asked.cases, asked.seed, folder)))
    print(text)
    if asked.publish:
        command = f"python -m benchmarks.versus --cases {asked.cases} --seed {asked.seed}"
        published.publish(PAGE, SECTION, text, command, commit)


def _version() -> str:
    """A digest of what fits, so that answers of different versions are never mixed."""
    digest = hashlib.sha256()
    for name in ("fit", "mujoco_model", "own_simulator", "parameters", "windows"):
        digest.update((Path(__file__).parent / f"{name}.py").read_bytes())
    return digest.hexdigest()[:16]


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit("stopped; the same command goes on with what is not answered yet")
