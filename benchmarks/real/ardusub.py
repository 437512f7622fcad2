"""``python -m benchmarks.real.ardusub``: diagnose flights that ArduSub's firmware wrote of its own simulated vehicle.

What was wrong with each is known. Prints a Markdown table: what is named, its value, whether both are right, and the
processor time. ``--healthy`` gives each flight another one that was sound, of the same sensors; ``--altered`` takes
sound flights as faulty vehicles would have logged them. Logs that are absent are named. They are looked for in the
folder that ``AUV_TORCHRL_DATA`` names, else in ``../shared/data``.
"""

import argparse
import logging
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch

from auv_torchrl.diagnosis import Diagnosis, diagnose
from auv_torchrl.diagnosis.calibrate.uncertainty import load_uncertainty
from auv_torchrl.diagnosis.verdict import FoundEffect, Verdict
from auv_torchrl.flightlog import read_flightlog
from auv_torchrl.vehicle import load_vehicle
from benchmarks import show_progress
from benchmarks.real import DATA
from benchmarks.real.altered import Change, carried, exchanged, multiplied, without_position

log = logging.getLogger(__name__)
VEHICLE = "ardusub_sitl"
FOLDER = "ardusub_sitl"
NEAR = 0.2  # of its departure from nominal, that a value may be off by
ONSET_S = 2.0  # that the moment may be off by: a window of the diagnosis


@dataclass(frozen=True)
class Case:
    """One flight and what is known of it."""

    name: str
    healthy: str | None  # another flight that was sound, where there is one
    effect: str = ""  # none: nothing was wrong
    truth: dict[str, float] = field(default_factory=dict)  # by parameter
    flight: str = ""  # file; empty: as the case is called
    alter: Change | None = None  # what the log of a sound flight is changed by
    sensors: Change | None = None  # what both logs lack
    onset_s: float | None = None  # from when on it acts; None: always

    @property
    def file(self) -> str:
        """Name of the log."""
        return self.flight or self.name


CASES = (  # the README beside the logs tells what was wrong
    Case("healthy_a", "healthy_c"),
    Case("healthy_c", "healthy_a"),
    Case("dead_thruster3", "healthy_a", "thruster_gain", {"gain_3": 0.0}),
    Case("motdir1_minus", "healthy_a", "thruster_gain", {"gain_1": -1.0}),
    Case("buoyancy10N", "healthy_a", "buoyancy", {"force": -5.6}),
    Case("stock_healthy_a", None),
    Case("stock_dead_thruster4", "stock_healthy_a", "thruster_gain", {"gain_4": 0.0}),
)

A, C = "healthy_a", "healthy_c"
GAIN, SWAP = "thruster_gain", "thruster_swap"
ALTERED = (
    Case("leads_2_3", A, SWAP, {"command_2": 3.0, "command_3": 2.0}, C, exchanged(2, 3)),
    Case("leads_6_8", A, SWAP, {"command_6": 8.0, "command_8": 6.0}, C, exchanged(6, 8)),
    Case("reversed_5", A, GAIN, {"gain_5": -1.0}, C, multiplied(5, -1.0)),
    Case("weak_1", A, GAIN, {"gain_1": 0.7}, C, multiplied(1, 0.7)),
    Case("weak_7", A, GAIN, {"gain_7": 0.5}, C, multiplied(7, 0.5)),
    Case("current", A, "current", {"north": 0.15, "east": -0.1}, C, carried(0.15, -0.1)),
    Case("reversed_2_late", A, GAIN, {"gain_2": -1.0}, C, multiplied(2, -1.0, 100.0), onset_s=100.0),
    Case("leads_1_4_late", A, SWAP, {"command_1": 4.0, "command_4": 1.0}, C, exchanged(1, 4, 90.0), onset_s=90.0),
    Case("stock_sound", A, flight=C, sensors=without_position),
    Case("stock_leads_1_2", A, SWAP, {"command_1": 2.0, "command_2": 1.0}, C, exchanged(1, 2), without_position),
    Case("stock_reversed_3", A, GAIN, {"gain_3": -1.0}, C, multiplied(3, -1.0), without_position),
    Case("stock_weak_7", A, GAIN, {"gain_7": 0.5}, C, multiplied(7, 0.5), without_position),
)  # fmt: skip


@dataclass(frozen=True)
class Result:
    """A diagnosis of a case."""

    case: Case
    diagnosis: Diagnosis
    seconds: float  # of the processor

    @property
    def is_right(self) -> bool:
        """Whether nothing was named of a sound vehicle; else its fault, its place, its value, and nothing else."""
        named = [effect for effect in self.diagnosis.effects if not effect.calibrates]
        if not self.case.effect:
            return self.diagnosis.verdict is Verdict.NO_GAP
        return len(named) == 1 and named[0].name == self.case.effect and self._is_near(named[0]) and self._is_timely

    @property
    def _is_timely(self) -> bool:
        found, true = self.diagnosis.where.onset_s, self.case.onset_s
        return found is None if true is None else found is not None and abs(found - true) <= ONSET_S

    def _is_near(self, effect: FoundEffect) -> bool:
        shown = {name: p for name, p in effect.parameters.items() if p.value != p.nominal}
        if set(shown) != set(self.case.truth):
            return False
        return all(
            abs(shown[name].value - value) <= NEAR * abs(value - shown[name].nominal)
            for name, value in self.case.truth.items()
        )


def run(case: Case, folder: Path, vehicle_name: str, with_healthy: bool) -> Result:
    """Read and diagnose one flight, alone or with the healthy one."""
    begin, vehicle = time.process_time(), load_vehicle(vehicle_name)
    flight = read_flightlog(folder / f"{case.file}.BIN", vehicle)
    healthy = [read_flightlog(folder / f"{case.healthy}.BIN", vehicle)] if with_healthy and case.healthy else []
    if case.alter:
        flight = case.alter(flight)
    if case.sensors:
        flight, healthy = case.sensors(flight), [case.sensors(log) for log in healthy]
    found = diagnose(
        flight,
        vehicle,
        healthy,
        vehicle_name=vehicle_name,
        uncertainty=load_uncertainty(vehicle_name, vehicle),
        progress=lambda step, share: log.info("%s: %s", case.name, step),
    )
    return Result(case, found, time.process_time() - begin)


def table(results: Iterable[Result]) -> Iterator[str]:
    """Lines of Markdown, each as soon as its result is there."""
    yield "| log | what was wrong | verdict | named | closed | right | CPU s |"
    yield "|---|---|---|---|---|---|---|"
    for result in results:
        found, case = result.diagnosis, result.case
        truth = _values(case.effect, case.truth) if case.effect else "nothing"
        truth += f" from {case.onset_s:.0f} s on" if case.onset_s is not None else ""
        named = "; ".join(_values(e.name, {k: p.value for k, p in e.parameters.items()}) for e in found.effects)
        closed = "" if found.gap.closed is None else f"{found.gap.closed:.2f}"
        right = "yes" if result.is_right else "no"
        yield f"| {case.name} | {truth} | {found.verdict.key} | {named} | {closed} | {right} | {result.seconds:.0f} |"


def _values(effect: str, values: dict[str, float]) -> str:
    return f"{effect} " + ", ".join(f"{name} {value:.2f}" for name, value in values.items())


def find_cases(data: Path, names: Sequence[str], with_healthy: bool, cases: Iterable[Case]) -> list[Case]:
    """Those whose flights are there; those whose are not are named."""
    here = []
    for case in cases:
        if names and case.name not in names:
            continue
        needed = [case.file, case.healthy] if with_healthy else [case.file]
        if absent := [name for name in needed if name is None or not (data / FOLDER / f"{name}.BIN").is_file()]:
            lacks = ", ".join(f"{name}.BIN" if name else "a sound flight of the same sensors" for name in absent)
            log.info("%s is left out: %s lacks %s", case.name, data / FOLDER, lacks)
            continue
        here.append(case)
    return here


def main() -> None:
    """Diagnose what is there and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    known = [case.name for case in (*CASES, *ALTERED)]
    parser.add_argument("names", nargs="*", help=f"of {', '.join(known)}; all if not given")
    parser.add_argument("--data", type=Path, default=DATA, help=f"folder with {FOLDER}/*.BIN")
    parser.add_argument("--healthy", action="store_true", help="give each flight another one that was sound")
    parser.add_argument(
        "--altered", action="store_true", help="sound flights as faulty vehicles would have logged them"
    )
    parser.add_argument("--vehicle", default=VEHICLE, help="bluerov2_heavy is wrong about these flights, as files are")
    options = parser.parse_args()
    cases = ALTERED if options.altered else CASES
    if unknown := set(options.names) - {case.name for case in cases}:
        parser.error(f"no log named {', '.join(sorted(unknown))}: give some of {', '.join(c.name for c in cases)}")
    show_progress()
    torch.set_num_threads(1)
    here = find_cases(options.data, options.names, options.healthy, cases)
    for line in table(run(case, options.data / FOLDER, options.vehicle, options.healthy) for case in here):
        print(line, flush=True)


if __name__ == "__main__":
    main()
