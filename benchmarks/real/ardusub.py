"""``python -m benchmarks.real.ardusub``: diagnose flights that ArduSub's firmware wrote of its own simulated vehicle.

What was wrong with each is known. Prints a Markdown table: what is named, its value, whether both are right, and the
processor time. ``--healthy`` gives each flight another one that was sound, of the same sensors. Logs that are absent
are named. They are looked for in the folder that ``AUV_TORCHRL_DATA`` names, else in ``../shared/data``.
"""

import argparse
import logging
import sys
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
from benchmarks.real import DATA

log = logging.getLogger(__name__)
VEHICLE = "ardusub_sitl"
FOLDER = "ardusub_sitl"
NEAR = 0.2  # of its departure from nominal, that a value may be off by


@dataclass(frozen=True)
class Case:
    """One flight and what is known of it."""

    name: str
    healthy: str | None  # another flight that was sound, where there is one
    effect: str = ""  # none: nothing was wrong
    truth: dict[str, float] = field(default_factory=dict)  # by parameter


CASES = (  # the README beside the logs tells what was wrong
    Case("healthy_a", "healthy_c"),
    Case("healthy_c", "healthy_a"),
    Case("dead_thruster3", "healthy_a", "thruster_gain", {"gain_3": 0.0}),
    Case("motdir1_minus", "healthy_a", "thruster_gain", {"gain_1": -1.0}),
    Case("buoyancy10N", "healthy_a", "buoyancy", {"force": -5.6}),
    Case("stock_healthy_a", None),
    Case("stock_dead_thruster4", "stock_healthy_a", "thruster_gain", {"gain_4": 0.0}),
)


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
        return len(named) == 1 and named[0].name == self.case.effect and self._is_near(named[0])

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
    flight = read_flightlog(folder / f"{case.name}.BIN", vehicle)
    healthy = [read_flightlog(folder / f"{case.healthy}.BIN", vehicle)] if with_healthy and case.healthy else []
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
        named = "; ".join(_values(e.name, {k: p.value for k, p in e.parameters.items()}) for e in found.effects)
        closed = "" if found.gap.closed is None else f"{found.gap.closed:.2f}"
        right = "yes" if result.is_right else "no"
        yield f"| {case.name} | {truth} | {found.verdict.key} | {named} | {closed} | {right} | {result.seconds:.0f} |"


def _values(effect: str, values: dict[str, float]) -> str:
    return f"{effect} " + ", ".join(f"{name} {value:.2f}" for name, value in values.items())


def find_cases(data: Path, names: Sequence[str], with_healthy: bool) -> list[Case]:
    """The flights that are there; those that are not are named."""
    here = []
    for case in CASES:
        needed = [case.name, case.healthy] if with_healthy else [case.name]
        absent = [name for name in needed if name is None or not (data / FOLDER / f"{name}.BIN").is_file()]
        if names and case.name not in names:
            continue
        if absent:
            lacks = ", ".join(f"{name}.BIN" if name else "a sound flight of the same sensors" for name in absent)
            log.info("%s is left out: %s lacks %s", case.name, data / FOLDER, lacks)
            continue
        here.append(case)
    return here


def main() -> None:
    """Diagnose what is there and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("names", nargs="*", help=f"of {', '.join(case.name for case in CASES)}; all if not given")
    parser.add_argument("--data", type=Path, default=DATA, help=f"folder with {FOLDER}/*.BIN")
    parser.add_argument("--healthy", action="store_true", help="give each flight another one that was sound")
    parser.add_argument("--vehicle", default=VEHICLE, help="bluerov2_heavy is wrong about these flights, as files are")
    options = parser.parse_args()
    if unknown := set(options.names) - {case.name for case in CASES}:
        parser.error(f"no log named {', '.join(sorted(unknown))}: give some of {', '.join(c.name for c in CASES)}")
    logging.basicConfig(format="%(message)s", stream=sys.stderr, force=True)
    log.setLevel(logging.INFO)  # progress; libraries stay silent
    torch.set_num_threads(1)
    cases = find_cases(options.data, options.names, options.healthy)
    for line in table(run(case, options.data / FOLDER, options.vehicle, options.healthy) for case in cases):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
