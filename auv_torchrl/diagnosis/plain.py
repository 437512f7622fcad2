"""Answers as plain types, which JSON can hold, and findings back from them."""

import json
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from auv_torchrl.files import write_whole
from auv_torchrl.flightlog import Finding, Severity


def plain(value: Any) -> Any:
    """Lists, dicts and Python's own numbers; what is not finite is null, because JSON has no infinity."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, tuple | list):
        return [plain(entry) for entry in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value


def write_json(path: Path, content: Any) -> None:
    """Write plain types, whole or not at all; names of files that are no UTF-8 keep their bytes."""
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    write_whole(path, text.encode("utf-8", "surrogateescape"))


def finding_from(entry: Mapping[str, Any]) -> Finding:
    """A finding from plain types."""
    rows = entry["rows"] and tuple(entry["rows"])
    param = tuple((name, value) for name, value in entry.get("param", ()))
    severity, columns = Severity(entry["severity"]), tuple(entry["columns"])
    return Finding(**{**entry, "severity": severity, "columns": columns, "rows": rows, "param": param})
