"""``python -m benchmarks.blind cases=300``: fly sealed cases, diagnose them, open the labels, score."""

import logging
import os
from pathlib import Path

import torch
from omegaconf import DictConfig
from tqdm import tqdm

from auv_torchrl.command import checking_input
from auv_torchrl.hydra_command import hydra_command
from auv_torchrl.settings import check
from auv_torchrl.vehicle import load_vehicle
from benchmarks import provenance
from benchmarks.blind.examine import examine, read_answers
from benchmarks.blind.flights.fly import fly
from benchmarks.blind.flights.sensor_sets import sensor_set
from benchmarks.blind.parts import Part
from benchmarks.blind.schema import BlindSchema, register
from benchmarks.blind.scores.figures import draw_figures
from benchmarks.blind.scores.judge import judge
from benchmarks.blind.scores.report import markdown, publish, section, write_report
from benchmarks.blind.seal import answers_folder, is_sealed, open_labels, seal
from benchmarks.published import SECTIONS

BATCH = 24  # cases flown at once: 0.1 GB

log = logging.getLogger(__name__)
register()


@hydra_command("blind", files=("folder", "publish"))
def main(config: DictConfig) -> None:
    """Each step finds what the one before left in the folder, so that a killed run goes on where it was."""
    torch.set_num_threads(1)
    with checking_input():
        check(BlindSchema, {name: config[name] for name in ("cases", "seed", "workers", "sensors", "strangers")})
        part = Part.of(config)
        folder = Path(config.folder, part.name or "")
        commit = provenance.committed(measures(part)) if config.publish else ""
        fly_and_seal(config, part, folder)
    answers = answers_folder(folder)
    examine(folder, answers, config.workers or os.cpu_count() or 1)
    vehicle, given = load_vehicle(sensor_set(part.sensors).vehicle), read_answers(folder, answers)
    judgements = [judge(name, label, given[name], vehicle) for name, label in open_labels(folder).items()]
    asked = {"cases": config.cases, "seed": config.seed, **part.asked}
    command = " ".join(["python -m benchmarks.blind", *(f"{name}={value}" for name, value in asked.items())])
    tables = part.tables(judgements)
    pictures = draw_figures(judgements, answers) if part.name is None else []
    text = write_report(judgements, answers, command, tables, pictures)
    if config.publish:
        with checking_input():
            publish(text, answers, Path(config.publish), part.name, command, commit)
    log.info("%s\n\n%s\n\nresults: %s", markdown(tables[0]), markdown(tables[-1]), answers)


def measures(part: Part) -> tuple[str, ...]:
    """The code that a part measures."""
    return SECTIONS["diagnosis.md", section(part.name)].measures


def fly_and_seal(config: DictConfig, part: Part, folder: Path) -> None:
    """Fly all cases unless the folder holds them."""
    settings = {"cases": config.cases, "seed": config.seed, "families": dict(part.shares), **part.asked}
    if is_sealed(folder, settings):
        return
    cases = part.draw(config.cases, config.seed)
    vehicle = load_vehicle(sensor_set(part.sensors).vehicle)
    flown = []
    for first in tqdm(range(0, len(cases), BATCH), desc="flown", unit="batch", disable=None):
        flown += fly(cases[first : first + BATCH], vehicle, config.seed)
    seal(folder, settings, flown)


if __name__ == "__main__":
    main()
