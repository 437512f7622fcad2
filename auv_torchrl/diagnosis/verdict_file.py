"""``diagnosis.json`` (version 1): a diagnosis as plain types, and back.

By hand, because serializers ignore keys that are unknown (msgspec) or make a number of "0.5" (cattrs), and a file that
somebody changed is to be refused with what it says, where, and what is wanted.
"""

import math
from collections.abc import Mapping
from typing import Any

from auv_torchrl.diagnosis.plain import finding_from, plain
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
        "where": plain(diagnosis.where),
        "effects": plain(diagnosis.effects),
        "candidates": plain(diagnosis.candidates),
        "indistinguishable": plain(diagnosis.indistinguishable),
        "next_experiment": experiment and {"why": experiment.why, "commands": experiment.commands},
        "gap": plain(diagnosis.gap),
        "input_mappable": plain(diagnosis.input_mappable),
        "detectable": plain(diagnosis.detectable),
        "detectable_with": {str(flights): plain(sizes) for flights, sizes in diagnosis.detectable_with.items()},
        "cannot_tell": list(diagnosis.cannot_tell),
        "findings": plain(diagnosis.findings),
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
        detectable=_estimates(content["detectable"]),
        detectable_with={int(n): _estimates(sizes) for n, sizes in content.get("detectable_with", {}).items()},
        cannot_tell=tuple(content["cannot_tell"]),
        findings=tuple(finding_from(finding) for finding in content["findings"]),
    )


def _estimates(content: Mapping[str, Any]) -> dict[str, Estimate]:
    return {name: _estimate(size) for name, size in content.items()}


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
    parameters, thrusters = _estimates(content["parameters"]), tuple(content["thrusters"])
    advice = tuple(Advice(**entry) for entry in content.get("advice", ()))
    return FoundEffect(**{**content, "parameters": parameters, "thrusters": thrusters, "advice": advice})
