"""Which logs both programs get: families of the sealed benchmark, each with one episode more that neither sees."""

from dataclasses import replace
from pathlib import Path

from auv_torchrl.flightlog import FlightLog, raw_columns, write_columns
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.flights.cases import EPISODES, draw_cases
from benchmarks.blind.flights.fly import fly
from benchmarks.blind.flights.sensor_sets import sensor_set
from benchmarks.blind.seal import is_sealed, seal
from benchmarks.versus.labels import SHARES

VEHICLE = sensor_set(None).vehicle
HELD = 1  # episodes that are kept back, to be predicted


def sealed(folder: Path, cases: int, seed: int) -> None:
    """Fly and seal what the folder lacks; the flights that are kept back lie beside the logs."""
    settings = {"cases": cases, "seed": seed}
    if is_sealed(folder, settings):
        return
    drawn = [replace(case, episodes=EPISODES + HELD) for case in draw_cases(cases, SHARES, seed)]
    given = []
    for log, label in fly(drawn, load_vehicle(VEHICLE), seed):
        logged, kept = parted(log)
        held_path(folder, log.name).parent.mkdir(parents=True, exist_ok=True)
        write_columns(raw_columns(kept), held_path(folder, log.name))
        given.append((logged, label | {"episodes": EPISODES}))
    seal(folder, settings, given)


def parted(log: FlightLog) -> tuple[FlightLog, FlightLog]:
    """The log that is given, and the flight that is kept back."""
    numbers = [episode.number for episode in log.episodes]
    return log.only(numbers[:-HELD]), log.only(numbers[-HELD:])


def held_path(folder: Path, name: str) -> Path:
    """Where the flight is that nobody is given."""
    return folder / "held" / f"{name}.csv"
