"""``dives.json`` (version 1): what is said about many dives as plain types, and back."""

from collections.abc import Mapping
from typing import Any

from auv_torchrl.diagnosis.dives.answer import (
    AlarmTold,
    ChangeTold,
    DiveTold,
    Followed,
    ManyDives,
    OwnDiagnosis,
    ShiftTold,
    Value,
)
from auv_torchrl.diagnosis.plain import finding_from, plain

VERSION = 1


def to_json(answer: ManyDives) -> dict[str, Any]:
    """The content of ``dives.json``, of plain types alone."""
    return {"version": VERSION, **plain(answer)}


def from_json(content: Mapping[str, Any]) -> ManyDives:
    """The answer that :func:`to_json` wrote.

    Raises:
        ValueError: for another version.
    """
    if content.get("version") != VERSION:
        raise ValueError(f"dives of version {content.get('version')!r}: this program reads version {VERSION}")
    fields = {name: value for name, value in content.items() if name != "version"}
    return ManyDives(
        **{
            **fields,
            "dives": tuple(_dive(entry) for entry in content["dives"]),
            "numbers": tuple(Followed(**entry) for entry in content["numbers"]),
            "alarms": tuple(AlarmTold(**{**entry, "rivals": tuple(entry["rivals"])}) for entry in content["alarms"]),
            "changes": tuple(_change(entry) for entry in content["changes"]),
            "cannot_tell": tuple(content["cannot_tell"]),
            "findings": tuple(finding_from(entry) for entry in content["findings"]),
        }
    )


def _dive(entry: Mapping[str, Any]) -> DiveTold:
    return DiveTold(
        **{
            **entry,
            "values": {key: Value(**value) for key, value in entry["values"].items()},
            "findings": tuple(finding_from(finding) for finding in entry["findings"]),
            "diagnosis": entry["diagnosis"] and OwnDiagnosis(**entry["diagnosis"]),
        }
    )


def _change(entry: Mapping[str, Any]) -> ChangeTold:
    moments = tuple(ShiftTold(**{**shift, "size": Value(**shift["size"])}) for shift in entry["shifts"])
    tuples = {name: tuple(entry[name]) for name in ("line", "rivals", "advice")}
    return ChangeTold(**{**entry, **tuples, "shifts": moments})
