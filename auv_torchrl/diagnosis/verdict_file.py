"""``diagnosis.json`` (version 1): a diagnosis as plain types, and back.

By hand, because serializers ignore keys that are unknown (msgspec) or make a number of "0.5" (cattrs), and a file that
somebody changed is to be refused with what it says, where, and what is wanted.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from auv_torchrl.diagnosis.verdict import (
    Candidate,
    Confirmation,
    Diagnosis,
    Errors,
    Estimate,
    FoundEffect,
    Gap,
    NextExperiment,
    Regime,
    Verdict,
    Where,
)
from auv_torchrl.effects.advice import Advice
from auv_torchrl.flightlog import Finding, Severity

VERSION = 1


def to_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of ``diagnosis.json``, of plain types alone."""
    experiment = diagnosis.next_experiment
    return {
        "version": VERSION,
        "log": diagnosis.log,
        "vehicle": diagnosis.vehicle,
        "verdict": diagnosis.verdict.key,
        "summary": diagnosis.summary,
        "where": _plain(diagnosis.where),
        "effects": _plain(diagnosis.effects),
        "candidates": _plain(diagnosis.candidates),
        "indistinguishable": _plain(diagnosis.indistinguishable),
        "next_experiment": experiment and {"why": experiment.why, "commands": experiment.commands},
        "gap": _plain(diagnosis.gap),
        "input_mappable": _plain(diagnosis.input_mappable),
        "detectable": _plain(diagnosis.detectable),
        "cannot_tell": list(diagnosis.cannot_tell),
        "findings": _plain(diagnosis.findings),
    }


def from_json(content: Mapping[str, Any]) -> Diagnosis:
    """The diagnosis that :func:`to_json` wrote, without its trajectories.

    Raises:
        ValueError: for another version.
    """
    if content.get("version") != VERSION:
        raise ValueError(f"diagnosis of version {content.get('version')!r}: this program reads version {VERSION}")
    where, gap, experiment = content["where"], content["gap"], content["next_experiment"]
    confirmed = gap["confirmed"]
    return Diagnosis(
        log=content["log"],
        vehicle=content["vehicle"],
        verdict=Verdict[content["verdict"].upper()],
        summary=content["summary"],
        where=Where(**{**where, "regime": tuple(Regime(**regime) for regime in where["regime"])}),
        effects=tuple(_found_effect(effect) for effect in content["effects"]),
        candidates=tuple(Candidate(**candidate) for candidate in content["candidates"]),
        indistinguishable=tuple(tuple(names) for names in content["indistinguishable"]),
        next_experiment=experiment and NextExperiment(**experiment),
        gap=Gap(
            horizon_s=tuple(gap["horizon_s"]),
            **_errors_by_kind(gap),
            held_out_episodes=tuple(gap["held_out_episodes"]),
            confirmed=confirmed and Confirmation(**_errors_by_kind(confirmed)),
        ),
        input_mappable=content["input_mappable"],
        detectable={name: _estimate(size) for name, size in content["detectable"].items()},
        cannot_tell=tuple(content["cannot_tell"]),
        findings=tuple(_finding(finding) for finding in content["findings"]),
    )


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if hasattr(value, "__dataclass_fields__"):
        return _plain(asdict(value))
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None  # JSON has no infinity
    return int(value) if isinstance(value, np.integer) else value


def _estimate(content: Mapping[str, Any]) -> Estimate:
    low = -math.inf if content["low"] is None else content["low"]
    high = math.inf if content["high"] is None else content["high"]
    return Estimate(**{**content, "low": low, "high": high})


def _errors_by_kind(content: Mapping[str, Any]) -> dict[str, Any]:
    kinds = {name: _errors(content[name]) for name in ("position_m", "yaw_rad", "velocity")}
    return {**kinds, "dof": {n: _errors(errors) for n, errors in content["dof"].items()}, "closed": content["closed"]}


def _errors(content: Mapping[str, Any] | None) -> Errors | None:
    return None if content is None else Errors(**{name: tuple(values) for name, values in content.items()})


def _found_effect(content: Mapping[str, Any]) -> FoundEffect:
    parameters = {name: _estimate(estimate) for name, estimate in content["parameters"].items()}
    advice = tuple(Advice(**entry) for entry in content.get("advice", ()))
    return FoundEffect(
        **{**content, "parameters": parameters, "thrusters": tuple(content["thrusters"]), "advice": advice}
    )


def _finding(content: Mapping[str, Any]) -> Finding:
    rows = content["rows"] and tuple(content["rows"])
    return Finding(
        **{**content, "severity": Severity(content["severity"]), "columns": tuple(content["columns"]), "rows": rows}
    )
