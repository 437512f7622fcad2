"""``python -m benchmarks.blind cases=300``: fly sealed cases, diagnose them, open the labels, score."""

import logging
import os
from pathlib import Path

import torch
from omegaconf import DictConfig
from tqdm import tqdm

from auv_torchrl.command import checking_input, command
from auv_torchrl.settings import check
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.cases import draw_cases
from benchmarks.blind.examine import examine, read_answers
from benchmarks.blind.fly import fly
from benchmarks.blind.judge import judge
from benchmarks.blind.report import markdown, publish, write_report
from benchmarks.blind.schema import BlindSchema, register
from benchmarks.blind.score import failures, numbers
from benchmarks.blind.score_sensors import set_numbers
from benchmarks.blind.seal import answers_folder, is_sealed, open_labels, seal
from benchmarks.blind.sensor_sets import sensor_set

BATCH = 24  # cases flown at once: 0.1 GB

log = logging.getLogger(__name__)
register()


@command("blind", files=("folder", "publish"))
def main(config: DictConfig) -> None:
    """Each step finds what the one before left in the folder, so that a killed run goes on where it was."""
    torch.set_num_threads(1)
    sensors = config.sensors
    folder = Path(config.folder, sensors or "")
    with checking_input():
        check(BlindSchema, {name: config[name] for name in ("cases", "seed", "workers", "sensors")})
        fly_and_seal(config, folder)
    answers = answers_folder(folder)
    examine(folder, answers, config.workers or os.cpu_count() or 1)
    vehicle, given = load_vehicle(sensor_set(sensors).vehicle), read_answers(folder, answers)
    judgements = [judge(name, label, given[name], vehicle) for name, label in open_labels(folder).items()]
    command = f"python -m benchmarks.blind cases={config.cases} seed={config.seed}"
    text = write_report(judgements, answers, command if sensors is None else f"{command} sensors={sensors}", sensors)
    if config.publish:
        with checking_input():
            publish(text, answers, Path(config.publish), sensors)
    targets = numbers(judgements) if sensors is None else set_numbers(judgements, sensors)
    log.info("%s\n\n%s\n\nresults: %s", markdown(targets), markdown(failures(judgements)), answers)


def fly_and_seal(config: DictConfig, folder: Path) -> None:
    """Fly all cases unless the folder holds them."""
    sensors, families = config.sensors, config.families if config.sensors is None else config.set_families
    shares = {str(name): float(share) for name, share in families.items()}
    settings = {"cases": config.cases, "seed": config.seed, "families": shares}
    if sensors is not None:
        settings["sensors"] = sensors
    if is_sealed(folder, settings):
        return
    cases = draw_cases(config.cases, shares, config.seed, sensors)
    vehicle = load_vehicle(sensor_set(sensors).vehicle)
    flown = []
    for first in tqdm(range(0, len(cases), BATCH), desc="flown", unit="batch", disable=None):
        flown += fly(cases[first : first + BATCH], vehicle, config.seed)
    seal(folder, settings, flown)


if __name__ == "__main__":
    main()
