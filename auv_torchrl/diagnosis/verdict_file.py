"""``diagnosis.json`` (version 1): a diagnosis as plain types, and back."""

from collections.abc import Mapping
from typing import Any

from auv_torchrl.diagnosis.plain import from_plain, plain
from auv_torchrl.diagnosis.verdict import Diagnosis

VERSION = 1


def to_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of ``diagnosis.json``, of plain types alone."""
    return {"version": VERSION, **plain(diagnosis)}


def from_json(content: Mapping[str, Any]) -> Diagnosis:
    """The diagnosis that :func:`to_json` wrote, without its trajectories.

    Raises:
        KeyError: for an entry that is missing or unknown.
        ValueError: for another version, or an entry that holds something else, naming it and what is wanted.
    """
    if content.get("version") != VERSION:
        raise ValueError(f"diagnosis of version {content.get('version')!r}: this program reads version {VERSION}")
    return from_plain(Diagnosis, {name: entry for name, entry in content.items() if name != "version"})
