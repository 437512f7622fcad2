"""What the examiner of a case gets: its log, damaged where the case says so, and a healthy log where there is one."""

from typing import Any, NamedTuple

import numpy as np

from auv_torchrl.flightlog import FlightLog, raw_columns
from benchmarks.blind.damage_acts import Columns
from benchmarks.blind.damages import DAMAGES, damaged, shows_fault


class HandedOver(NamedTuple):
    """The files of a case."""

    log: Columns
    healthy: Columns | None
    named_by: dict[str, Any] | None  # for the label: how an answer names the damage; None without one


def hand_over(flown: FlightLog, label: dict[str, Any]) -> HandedOver:
    """Columns of the log and of the healthy log of a case, the damage that the label says done to the log."""
    numbers = [episode.number for episode in flown.episodes]
    healthy = raw_columns(flown.only(numbers[-label["healthy"] :])) if label["healthy"] else None
    columns = raw_columns(flown.only(numbers[: len(numbers) - label["healthy"]]))
    if label["damage"] is None:
        return HandedOver(columns, healthy, None)
    damage = DAMAGES[label["damage"]]
    columns, which = damaged(columns, damage, np.random.default_rng(label["damage_seed"]))
    faults = label["values"]
    named_by = {
        "codes": damage.codes,
        "columns": which if damage.mentions else (),
        "effects": damage.effects,
        "partly": damage.partly,
        "shows_fault": bool(faults) and all(shows_fault(damage, fault, values) for fault, values in faults.items()),
    }
    return HandedOver(columns, healthy, named_by)
