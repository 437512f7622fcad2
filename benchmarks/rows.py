"""The rows that the commands of published tables can print, by their first cells, from the code that prints them."""

import re
from collections.abc import Callable, Iterable, Iterator
from itertools import product
from typing import Any

Labels = set[tuple[str, ...]]  # the first cell of a row, or the first few
Rows = Callable[[str], Labels]  # given the command that made a table


def of_bench(name: str, command: str) -> Labels:
    """Of a part of ``benchmarks.control``."""
    return set(_BENCH[name]())


def of_sealed(part: str | None, command: str) -> Labels:
    """Of a part of the sealed benchmark; its command says how many cases there are."""
    from auv_torchrl.effects import EFFECTS
    from benchmarks.blind.flights import cases, damages, outside, sensor_sets, strangers
    from benchmarks.blind.scores import score, score_sensors, score_strangers

    found = re.search(r"cases=(\d+)", command)
    count = int(found[1]) if found else 0
    labels: list[str] = [f"case_{number:04d}" for number in range(1, count + 1)]
    labels += [*EFFECTS, *outside.OUTSIDE, *cases.FAMILIES, "all"]
    if part is None:
        targets = score.numbers([])
        labels += [name.replace("_", " ") for name in damages.DAMAGES]
        labels += [*score.NO_GAP.values(), *score.spans(), *_conditions()]
    elif part.startswith("strangers"):
        targets = score_strangers.stranger_numbers([], 0)
        labels += [str(number) for number in range(1, max(1, round(count / strangers.CASES_PER_STRANGER)) + 1)]
    else:
        targets = score_sensors.set_numbers([], part)
        labels += [*sensor_sets.FAULTS, score_sensors.NOTHING]
    return _one([*labels, *(row[0] for row in targets.rows)])


def of_real(name: str, command: str) -> Labels:
    """Of a part of ``benchmarks.real``."""
    from benchmarks.real.page import SECTIONS

    return set(next(section for section in SECTIONS if section.name == name).rows)


def of_owners(command: str) -> Labels:
    """Of sealed cases of owners' vehicles; the command says how many there are, and with which sensors."""
    from benchmarks.owners import acts, cases, score, still

    found, sensors = re.search(r"--cases (\d+)", command), command.split()[3]
    labels = [f"case_{number:04d}" for number in range(1, int(found[1]) + 1)] if found else []
    kinds = (*acts.ACTS, *still.kinds(sensors))
    labels += [*cases.FAMILIES, *(kind.replace("_", " ") for kind in kinds)]
    return _one([*labels, *(row[0] for row in score.owner_numbers([], sensors).rows)])


def of_without(command: str) -> Labels:
    """Of the diagnosis without one of its parts."""
    from benchmarks.blind.without import DELETED, PARTS

    return _one([*PARTS, *DELETED])


def of_paired(command: str) -> Labels:
    """Of two versions of the diagnosis; the command says how many logs there are."""
    from benchmarks.blind.flights.cases import FAMILIES, SET_FAMILIES
    from benchmarks.blind.paired import ALL, COUNTED, TIMES

    found = re.search(r"paired (\d+)_cases", command)
    cases = [f"case_{number:04d}" for number in range(1, int(found[1]) + 1)] if found else []
    return _one([*FAMILIES, *SET_FAMILIES, ALL, *COUNTED, TIMES, *cases])


def of_size(command: str) -> Labels:
    """Of what there is to read of the diagnosis."""
    from benchmarks import size

    return _one([*size.COUNTED, size.MUST])


def of_dives(command: str) -> Labels:
    """Of the benchmark over many dives."""
    from auv_torchrl.vehicle import load_vehicle
    from benchmarks.dives.__main__ import VEHICLE

    return _one(f"thruster {number}" for number in range(1, load_vehicle(VEHICLE).thrusters + 1))


def of_underway(part: str, command: str) -> Labels:
    """Of a part of the benchmark of vehicles at speed; a part may name a vehicle that has a table of its own."""
    from benchmarks.underway import control, dives, paths

    kind, _, vehicle = part.partition(" ")
    vehicles = (vehicle,) if vehicle else control.TOGETHER
    return {"control": control.cases(vehicles), "paths": paths.ROWS, "dives": _one(dives.ROWS)}[kind]


def of_versus(command: str) -> Labels:
    """Of the sealed logs that mujoco.sysid got, too; the command says how many there are."""
    from benchmarks.blind.flights.sizes import CLEAR
    from benchmarks.versus import labels

    found = re.search(r"--cases (\d+)", command)
    cases = [f"case_{number:04d}" for number in range(1, int(found[1]) + 1)] if found else []
    return _one([*cases, *CLEAR, *labels.FAMILIES, *labels.FIGURES, labels.ALL, labels.NOT_ASKED])


def of_trial(command: str) -> Labels:
    """Of the trial through the firmware; its command says how many cases were drawn, and from which seed."""
    from benchmarks.trial.cases import draw_cases

    found = {name: re.search(rf"--{name} (\d+)", command) for name in ("cases", "seed")}
    count, seed = (int(own[1]) if own else 0 for own in found.values())
    return _one(case.name for case in draw_cases(count, seed))


def _one(labels: Iterable[str]) -> Labels:
    return {(label,) for label in labels}


def _conditions() -> Iterator[str]:
    from benchmarks.blind.flights import cases
    from benchmarks.blind.scores import score

    yield from (score.LENGTH.format(length) for length in (*cases.SHORT_S, 30.0 * cases.EPISODES))
    yield from (score.NOISE.format(2 * noise, 0.004 * noise) for noise in (1.0, *cases.NOISES))
    yield from (*score.PLANTS.values(), *score.ONSET)


def _env_steps() -> Labels:
    from benchmarks.control.env_steps import SIZES

    return _one(map(str, SIZES))


def _simulated_seconds() -> Labels:
    from benchmarks.control.engines import ENGINES

    return _one(ENGINES)


def _sac_updates() -> Labels:
    from benchmarks.control.sac_updates import OURS, THEIRS

    return _one((*OURS, THEIRS))


def _time_to_error() -> Labels:
    from benchmarks.control.time_to_error import METHODS, SEEDS

    return {(method, str(seed)) for method, seed in product(METHODS, range(SEEDS))}


def _agents() -> Labels:
    from auv_torchrl.agents.config import AGENTS
    from benchmarks.control.agents import SEEDS

    return {(agent, str(seed)) for agent, seed in product(AGENTS, range(SEEDS))}


def _table2() -> Labels:
    from benchmarks.control.table2 import CASES

    return {(scenario, vehicle, f"±{box_m:g} m") for vehicle, box_m, scenario in CASES}


def _fault_recovery() -> Labels:
    from benchmarks.control.fault_recovery import CONDITIONS, FAULTS

    return set(product(FAULTS, CONDITIONS))


def _tank_run() -> Labels:
    from benchmarks.control.tank_run import RUNS

    return {(run.name, run.controller) for run in RUNS}


def _tracking() -> Labels:
    from benchmarks.control.tracking import CURVES

    return _one(CURVES)


def _tasks() -> Labels:
    from auv_torchrl.agents.config import AGENTS
    from auv_torchrl.scenario import scenarios_of
    from auv_torchrl.vehicle import load_vehicle
    from benchmarks.control.tasks import KINDS

    return _one(scenarios_of(load_vehicle("paper"))) | set(product(KINDS, AGENTS))


def _comparison() -> Labels:
    from auv_torchrl.scenario import scenarios_of
    from auv_torchrl.vehicle import load_vehicle
    from benchmarks.control.methods import METHODS

    return _one((*scenarios_of(load_vehicle("paper")), *METHODS))


_BENCH: dict[str, Callable[[], Any]] = {
    "env_steps": _env_steps, "simulated_seconds": _simulated_seconds, "sac_updates": _sac_updates,
    "time_to_error": _time_to_error, "agents": _agents, "table2": _table2, "fault_recovery": _fault_recovery,
    "tank_run": _tank_run, "tracking": _tracking, "tasks": _tasks, "comparison": _comparison,
}  # fmt: skip
