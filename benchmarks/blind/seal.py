"""The folder of a benchmark: logs and tasks that the diagnosis may read, labels that only the scoring may.

The digest of the labels is written down before anything is diagnosed and compared when they are opened.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import auv_torchrl.diagnosis
from auv_torchrl.files import write_whole
from auv_torchrl.flightlog import FlightLog, raw_columns, write_columns
from benchmarks.blind.flights.cases import HEALTHY
from benchmarks.blind.flights.damages import DAMAGES, Columns, Damage, damaged, shows_fault

MANIFEST = "manifest.json"
LABELS = Path("sealed") / "labels.json"
LOGS = "logs"


class HandedOver(NamedTuple):
    """The files of a case."""

    log: Columns
    healthy: Columns | None
    named_by: dict[str, Any] | None  # for the label: how an answer names the damage; None without one


def hand_over(flown: FlightLog, label: dict[str, Any], damages: Mapping[str, Damage] = DAMAGES) -> HandedOver:
    """Columns of the log and of the healthy log of a case, the damage that the label says done to the log."""
    numbers = [episode.number for episode in flown.episodes]
    healthy = raw_columns(flown.only(numbers[-label["healthy"] :])) if label["healthy"] else None
    columns = raw_columns(flown.only(numbers[: len(numbers) - label["healthy"]]))
    if label["damage"] is None:
        return HandedOver(columns, healthy, None)
    damage = damages[label["damage"]]
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


def write_json(path: Path, content: Any) -> None:
    """Write JSON, all or nothing."""
    write_whole(path, (json.dumps(content, indent=1, allow_nan=False) + "\n").encode())


def examiner_version() -> str:
    """A digest of the diagnosis's source, so that answers of different versions are never mixed."""
    digest = hashlib.sha256()
    for path in sorted(Path(auv_torchrl.diagnosis.__path__[0]).glob("**/*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def seal(
    folder: Path,
    settings: dict[str, Any],
    flown: list[tuple[FlightLog, dict[str, Any]]],
    damages: Mapping[str, Damage] = DAMAGES,
) -> None:
    """Write logs, tasks and sealed labels; the manifest comes last and says that all is there.

    Healthy flights of strangers are no task of their own, and go with every case of their vehicle.
    """
    (folder / LOGS).mkdir(parents=True, exist_ok=True)
    (folder / LABELS).parent.mkdir(exist_ok=True)
    labels, tasks = {}, {}
    sound: dict[int | None, list[str]] = {}
    for flight_log, label in flown:
        if label["family"] == HEALTHY:
            _write_once(raw_columns(flight_log), log_path(folder, flight_log.name))
            sound.setdefault(label["stranger"], []).append(flight_log.name)
    for flight_log, label in flown:
        name = flight_log.name
        if label["family"] == HEALTHY:
            continue
        handed, healthy_name = hand_over(flight_log, label, damages), f"{name}_healthy"
        _write_once(handed.log, log_path(folder, name))
        if handed.healthy is not None:
            _write_once(handed.healthy, log_path(folder, healthy_name))
        labels[name] = {**label, "named_by": handed.named_by}
        healthy = sound.get(label["stranger"], []) if handed.healthy is None else [healthy_name]
        tasks[name] = {"left_out": label["left_out"], "healthy": healthy}
    write_json(folder / LABELS, labels)
    digest = _digest(folder / LABELS)
    write_json(folder / MANIFEST, {"settings": settings, "labels_sha256": digest, "tasks": tasks})


def _write_once(columns: Columns, path: Path) -> None:
    if not path.exists():
        write_columns(columns, path)


def is_sealed(folder: Path, settings: dict[str, Any]) -> bool:
    """Whether the folder holds a benchmark of exactly these settings.

    Raises:
        FileExistsError: if it holds one of other settings.
    """
    if not (folder / MANIFEST).exists():
        return False
    there = read_manifest(folder)["settings"]
    if there != settings:
        different = sorted(key for key in {*there, *settings} if there.get(key) != settings.get(key))
        raise FileExistsError(
            f"{folder} holds a benchmark with other {', '.join(different)}: choose another folder=, or remove it"
        )
    return True


def read_manifest(folder: Path) -> dict[str, Any]:
    """Settings and tasks; nothing of the labels."""
    return json.loads((folder / MANIFEST).read_text())


def open_labels(folder: Path) -> dict[str, dict[str, Any]]:
    """The truth of every case.

    Raises:
        ValueError: if the labels are not those that were sealed.
    """
    if _digest(folder / LABELS) != read_manifest(folder)["labels_sha256"]:
        raise ValueError(f"{folder / LABELS} was changed after it was sealed: fly the cases again in another folder")
    return json.loads((folder / LABELS).read_text())


def log_path(folder: Path, name: str) -> Path:
    """Where a log is."""
    return folder / LOGS / f"{name}.csv"


def answers_folder(folder: Path) -> Path:
    """Where the answers of this version of the diagnosis are, and what is made of them."""
    return folder / f"diagnosis_{examiner_version()}"


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
