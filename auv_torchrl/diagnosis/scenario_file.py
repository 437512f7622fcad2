"""What was found, as files that training reads: a scenario like any other, and ranges to randomize around it."""

from typing import Any

import numpy as np
import yaml

from auv_torchrl.diagnosis.verdict import Diagnosis, FoundEffect
from auv_torchrl.effects import Parameter, get_effect
from auv_torchrl.vehicle import Vehicle

_DIGITS = 6


def scenario_yaml(diagnosis: Diagnosis, vehicle: Vehicle) -> str:
    """The effects with their values, for :func:`auv_torchrl.scenario.read_scenario`; intervals in comments.

    Args:
        diagnosis: what was found.
        vehicle: the nominal vehicle, no batch.
    """
    lines = [
        f"# {_one_line(diagnosis.summary)}",
        f"# Found in {_one_line(diagnosis.log)}, vehicle {diagnosis.vehicle}.",
        "# Train with it: +scenario=path/to/this/file.yaml.",
    ]
    if diagnosis.where.onset_s is not None:
        lines.append(f"# The vehicle changed {diagnosis.where.onset_s:.1f} s into the log; start_s is in its episode.")
    if not diagnosis.effects:
        return "\n".join([*lines, "effects: {}", ""])
    lines.append("effects:")
    calibrated = {found.name for found in diagnosis.effects if found.calibrates}
    for found in diagnosis.effects:
        if found.name in calibrated and not found.calibrates:  # a fault on top of what its own file gets wrong
            lines += [f"  {found.name}_fault:", f"    effect: {found.name}"]
        else:
            lines.append(f"  {found.name}:")
        for name, value in _values(found, vehicle).items():
            e = found.parameters[name]
            unit = "" if e.unit == "1" else f"{e.unit}, "
            lines.append(f"    {name}: {value!r}  # {unit}95 % in [{e.low:.4g}, {e.high:.4g}], nominal {e.nominal:.4g}")
        if diagnosis.where.onset_in_episode_s is not None and not found.calibrates:
            lines.append(f"    start_s: {round(diagnosis.where.onset_in_episode_s, 3)!r}")
    return "\n".join([*lines, ""])


def randomization_yaml(diagnosis: Diagnosis, vehicle: Vehicle) -> str:
    """The 95 % intervals, for :func:`auv_torchrl.envs.randomize.read_ranges`; swapped commands have none.

    A randomization has each effect once: a fault in what was calibrated as well is left to the scenario.
    """
    ranges: dict[str, Any] = {}
    for found in diagnosis.effects:
        if found.name in ranges:
            continue
        declared = get_effect(found.name).member_parameters(vehicle)
        members = {
            name: [_within(declared[name], end) for end in (estimate.low, estimate.high)]
            for name, estimate in found.parameters.items()
            if not declared[name].discrete
        }
        if members:
            ranges[found.name] = members
    head = f"# 95 % intervals of what was found in {_one_line(diagnosis.log)}, vehicle {diagnosis.vehicle}.\n"
    return head + yaml.safe_dump(ranges, sort_keys=False, default_flow_style=None)


def _values(found: FoundEffect, vehicle: Vehicle) -> dict[str, float]:
    """Values within the bounds of the effect; counts as whole numbers."""
    declared = get_effect(found.name).member_parameters(vehicle)
    values = {}
    for name, estimate in found.parameters.items():
        value = _within(declared[name], estimate.value)
        values[name] = float(round(value)) if declared[name].discrete else value
    return values


def _within(bounds: Parameter, value: float) -> float:
    """A rounded value that the effect accepts."""
    return float(np.clip(np.round(value, _DIGITS), bounds.low, bounds.high))


def _one_line(text: str) -> str:
    return " ".join(text.split())
