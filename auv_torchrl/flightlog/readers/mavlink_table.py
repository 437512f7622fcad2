"""Collects decoded MAVLink messages as columns, with the time of the vehicle where they bear one."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from auv_torchrl.flightlog.readers.mavlink import TEXTS, WANTED
from auv_torchrl.flightlog.readers.messages import AT, Messages, in_order

_RESTART_S = 1.0  # a boot time that steps back further is that of another start
_WRAP_S = 2**32 * 1e-6  # s, after which the 32 bits of SERVO_OUTPUT_RAW.time_usec begin anew


class MavlinkTable:
    """Messages of one vehicle in the order in which they were received."""

    def __init__(self) -> None:
        self._rows: dict[str, list[tuple]] = {}
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, name: str, received: float, fields: Mapping[str, Any]) -> None:
        """Take a message; one that lacks a field is not taken."""
        wanted = WANTED[name]
        if all(field in fields for field in wanted):
            self._rows.setdefault(name, []).append((self._count, received, *(fields[field] for field in wanted)))
            self._count += 1

    def messages(self) -> Messages:
        """All messages as columns, times ``t`` in s by the clock of the vehicle."""
        types: dict[str, dict[str, np.ndarray]] = {}
        for name, rows in self._rows.items():
            columns = list(zip(*rows, strict=True))
            types[name] = {AT: np.array(columns[0]), "received": np.array(columns[1], np.float64)}
            for field, values in zip(WANTED[name], columns[2:], strict=True):
                types[name][field] = np.array(values, dtype=str if field in TEXTS else np.float64)
        _set_times(types)
        return in_order(types)


def _set_times(types: dict[str, dict[str, np.ndarray]]) -> None:
    """``t`` of each message: its time since boot, put where it was received, without the delays of the link."""
    booted = [c for c in types.values() if "time_boot_ms" in c]
    if not booted:
        for columns in types.values():
            columns["t"] = columns["received"]
        return
    at = np.concatenate([c[AT] for c in booted])
    order = np.argsort(at)
    boot = np.concatenate([c["time_boot_ms"] for c in booted])[order] * 1e-3
    late = np.concatenate([c["received"] for c in booted])[order] - boot
    starts = np.concatenate(([0], np.flatnonzero(np.diff(boot) < -_RESTART_S) + 1))
    offsets = np.array([np.percentile(part, 5) for part in np.split(late, starts[1:])])
    begins = at[order][starts]
    for columns in types.values():
        offset = offsets[np.maximum(np.searchsorted(begins, columns[AT], side="right") - 1, 0)]
        if "time_boot_ms" in columns:
            columns["t"] = columns["time_boot_ms"] * 1e-3 + offset
        elif "time_usec" in columns:
            since = columns["time_usec"] * 1e-6
            turns = np.round((columns["received"] - offset - since) / _WRAP_S)
            columns["t"] = since + turns * _WRAP_S + offset
        else:
            columns["t"] = columns["received"]
