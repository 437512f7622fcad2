"""What was found, as files that training reads: a scenario like any other, and ranges to randomize around it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml

from auv_torchrl.diagnosis.verdict import Diagnosis, Estimate, FoundEffect
from auv_torchrl.effects import Parameter, get_effect
from auv_torchrl.quantities import percent
from auv_torchrl.text import printable
from auv_torchrl.vehicle import Vehicle

_DIGITS = 6


def scenario_yaml(diagnosis: Diagnosis, vehicle: Vehicle) -> str:
    """What :func:`scenario_of` says as a file; units and intervals in comments."""
    lines = [
        f"# {_one_line(diagnosis.summary)}",
        f"# Found in {_one_line(diagnosis.log)}, vehicle {_one_line(diagnosis.vehicle)}.",
        "# Train with it: +scenario=path/to/this/file.yaml.",
    ]
    if diagnosis.where.onset_s is not None:
        lines.append(f"# The vehicle changed {diagnosis.where.onset_s:.1f} s into the log; start_s is in its episode.")
    if not diagnosis.effects:
        return "\n".join([*lines, "effects: {}", ""])
    lines.append("effects:")
    for found in diagnosis.effects:
        label, settings = _entry(found, diagnosis, vehicle)
        lines.append(f"  {label}:")
        for name, value in settings.items():
            lines.append(f"    {name}: {value}{_comment(found.parameters.get(name))}")
    return "\n".join([*lines, ""])


def alternatives_yaml(diagnosis: Diagnosis, vehicle: Vehicle) -> list[str]:
    """A file for each other explanation of a log, the likeliest first; corrections of the file are in all of them."""
    corrections = [found for found in diagnosis.effects if found.calibrates]
    own = {found.name for found in diagnosis.effects if not found.calibrates}
    files: list[str] = []
    for other in diagnosis.alternatives:
        known = [one for one in diagnosis.decision.trace if one.simulated and set(one.effects) == set(other.effects)]
        if not other.effects or set(other.effects) == own or not known:
            continue
        best = max(known, key=lambda one: one.log_posterior)
        effects = dict(_entry(found, diagnosis, vehicle) for found in corrections)
        for name in other.effects:
            settings: dict[str, Any] = _declared_values(name, best.values_of(name), vehicle)
            if diagnosis.where.onset_in_episode_s is not None:
                settings["start_s"] = round(diagnosis.where.onset_in_episode_s, 3)
            if name in effects:
                effects[f"{name}_fault"] = {"effect": name, **settings}
            else:
                effects[name] = settings
        head = f"# {percent(other.probability)}: {other.called}, in place of what scenario.yaml has.\n"
        found_in = f"# Found in {_one_line(diagnosis.log)}, vehicle {_one_line(diagnosis.vehicle)}.\n"
        files.append(head + found_in + yaml.safe_dump({"effects": effects}, sort_keys=False))
    return files


def scenario_of(diagnosis: Diagnosis, vehicle: Vehicle) -> dict[str, Any]:
    """The effects with their values, for :func:`auv_torchrl.scenario.read_scenario`.

    Args:
        diagnosis: what was found.
        vehicle: the nominal vehicle, no batch.
    """
    return {"effects": dict(_entry(found, diagnosis, vehicle) for found in diagnosis.effects)}


def _entry(found: FoundEffect, diagnosis: Diagnosis, vehicle: Vehicle) -> tuple[str, dict[str, Any]]:
    """The label of an effect in a scenario, and what stands below it."""
    settings: dict[str, Any] = dict(_values(found, vehicle))
    if diagnosis.where.onset_in_episode_s is not None and not found.calibrates:
        settings["start_s"] = round(diagnosis.where.onset_in_episode_s, 3)
    calibrated = {other.name for other in diagnosis.effects if other.calibrates}
    if found.name in calibrated and not found.calibrates:  # a fault on top of what its own file gets wrong
        return f"{found.name}_fault", {"effect": found.name, **settings}
    return found.name, settings


def _comment(e: Estimate | None) -> str:
    if e is None:
        return ""
    unit = "" if e.unit == "1" else f"{e.unit}, "
    return f"  # {unit}95 % in [{e.low:.4g}, {e.high:.4g}], nominal {e.nominal:.4g}"


def randomization_yaml(diagnosis: Diagnosis, vehicle: Vehicle) -> str:
    """What :func:`ranges_of` says as a file."""
    head = (
        f"# 95 % intervals of what was found in {_one_line(diagnosis.log)}, vehicle {_one_line(diagnosis.vehicle)}.\n"
    )
    return head + yaml.safe_dump(ranges_of(diagnosis, vehicle), sort_keys=False, default_flow_style=None)


def ranges_of(diagnosis: Diagnosis, vehicle: Vehicle) -> dict[str, dict[str, list[float]]]:
    """The 95 % intervals, for :func:`auv_torchrl.envs.randomize.read_ranges`; swapped commands have none.

    A randomization has each effect once: a fault in what was calibrated as well is left to the scenario.
    """
    ranges: dict[str, dict[str, list[float]]] = {}
    for found in diagnosis.effects:
        declared = get_effect(found.name).member_parameters(vehicle)
        members = {
            name: [_within(declared[name], end) for end in (estimate.low, estimate.high)]
            for name, estimate in found.parameters.items()
            if not declared[name].discrete
        }
        if members:
            ranges.setdefault(found.name, members)
    return ranges


def _values(found: FoundEffect, vehicle: Vehicle) -> dict[str, float]:
    """Values within the bounds of the effect; counts as whole numbers."""
    return _declared_values(found.name, {name: one.value for name, one in found.parameters.items()}, vehicle)


def _declared_values(effect: str, given: Mapping[str, float], vehicle: Vehicle) -> dict[str, float]:
    declared = get_effect(effect).member_parameters(vehicle)
    values = {name: _within(declared[name], value) for name, value in given.items()}
    return {name: float(round(value)) if declared[name].discrete else value for name, value in values.items()}


def _within(bounds: Parameter, value: float) -> float:
    """A rounded value that the effect accepts."""
    return float(np.clip(np.round(value, _DIGITS), bounds.low, bounds.high))


def _one_line(text: str) -> str:
    return printable(" ".join(text.split()), None)  # YAML takes no control characters, not even in a comment
