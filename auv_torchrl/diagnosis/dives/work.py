"""The work over many dives: each is followed by itself, in parallel, and what is there already is not done again."""

import json
import logging
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient
from auv_torchrl.diagnosis.dives.answer import OwnDiagnosis
from auv_torchrl.diagnosis.dives.follow import Reference, refer, tell
from auv_torchrl.diagnosis.dives.plan import Planned
from auv_torchrl.diagnosis.dives.store import keep, kept, key_of
from auv_torchrl.diagnosis.dives.told import Dive, Normal
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.files import write_whole
from auv_torchrl.flightlog import FlightLog, FlightLogError, Severity, read_flightlog
from auv_torchrl.flightlog.streams.stream import ReadOptions
from auv_torchrl.importing import importing_without_compiler
from auv_torchrl.parallel import each
from auv_torchrl.text import printable
from auv_torchrl.vehicle import Vehicle

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Work:
    """What all dives share."""

    vehicle: Vehicle
    vehicle_name: str
    settings: Settings
    uncertainty: tuple[Coefficient, ...]
    extra: tuple[str, ...]
    options: ReadOptions
    trust_log: bool
    shaped_by: dict[str, Any]  # what the answers depend on beside the logs, of plain types
    store: Path
    jobs: int  # processes; -1 for one on each core

    def read(self, path: Path) -> FlightLog:
        """A log of the vehicle.

        Raises:
            FlightLogError: if it cannot be used.
        """
        flight = read_flightlog(path, self.vehicle, self.extra, self.options)
        errors = [str(finding) for finding in flight.findings if finding.severity is Severity.ERROR]
        if errors and not self.trust_log:
            raise FlightLogError(f"{flight.name}: {' '.join(errors)}")
        return flight

    def key(self, planned: Planned, *files: Path) -> str:
        """Under which what follows from the reference and from files is kept."""
        return key_of(self.shaped_by, *planned.paths[: planned.reference], *files)


def follow_all(work: Work, planned: Planned, progress: Callable[[str, float], None]) -> tuple[Normal, list[Dive]]:
    """What the reference shows, and what each dive tells.

    Raises:
        FlightLogError: if a dive of the reference cannot be used.
    """
    key = work.key(planned)
    keys = [work.key(planned, path) for path in planned.paths]
    normal = kept(work.store, key, Normal)
    dives = {i: dive for i, own in enumerate(keys) if normal and (dive := kept(work.store, own, Dive)) is not None}
    if dives:
        log.info("%d of %d dives were worked out before", len(dives), len(keys))
    waiting = [i for i in range(len(keys)) if i not in dives]
    if waiting:
        progress("calibrating on the reference", 0.0)
        healthy = [work.read(path) for path in planned.paths[: planned.reference]]
        reference = refer(healthy, work.vehicle, work.settings, work.uncertainty)
        if normal is None:
            normal = reference.normal
            keep(work.store, key, normal)
        tasks = [(work, reference, planned.paths[i], planned.begun[i], keys[i]) for i in waiting]
        for i, dive in zip(waiting, each(_follow_one, tasks, work.jobs), strict=True):
            dives[i] = dive
            progress(f"dive {i + 1}: {dive.name}", len(dives) / len(keys))
    assert normal is not None  # kept, or worked out for the first dive
    return normal, [dives[i] for i in range(len(keys))]


def _follow_one(task: tuple[Work, Reference, Path, str, str]) -> Dive:
    work, reference, path, begun, key = task
    try:
        dive = tell(work.read(path), reference, begun)
    except FlightLogError as error:
        dive = Dive.unread(printable(path.name), str(error), len(reference.normal.numbers), begun)
    keep(work.store, key, dive)
    return dive


def diagnose_some(work: Work, planned: Planned, which: Sequence[int], folder: Path) -> dict[int, OwnDiagnosis]:
    """Dives diagnosed by themselves, each against the reference, and their reports in folders of their own."""
    tasks = [(work, planned, i) for i in which]
    found = {}
    for i, (where, said) in zip(which, each(_diagnose_one, tasks, work.jobs), strict=True):
        if where is not None:
            own = f"dives/{i + 1:03d}_{planned.paths[i].stem}"
            shutil.copytree(where, folder / own, dirs_exist_ok=True)
            found[i] = OwnDiagnosis(*said, own)
        log.info("dive %d by itself: %s", i + 1, said[1])
    return found


def _diagnose_one(task: tuple[Work, Planned, int]) -> tuple[Path | None, tuple[str, str]]:
    """Where the files of its diagnosis are kept, and its verdict and summary."""
    with importing_without_compiler():  # here: it loads MuJoCo, which following does not need
        from auv_torchrl.diagnosis.pipeline import diagnose
        from auv_torchrl.diagnosis.report.files import write_files

    work, planned, i = task
    path, reference = planned.paths[i], [p for p in planned.paths[: planned.reference] if p != planned.paths[i]]
    where = work.store / f"diagnosis_{work.key(planned, path)}"
    if not (where / "complete").is_file():
        try:
            healthy = [work.read(p) for p in reference]
            found = diagnose(work.read(path), work.vehicle, healthy, vehicle_name=work.vehicle_name,
                             settings=work.settings, uncertainty=work.uncertainty)  # fmt: skip
        except FlightLogError as error:
            return None, ("", str(error))
        write_files(found, work.vehicle, where, replace=True)
        write_whole(where / "complete", b"")
    told = json.loads((where / "diagnosis.json").read_bytes())
    return where, (told["verdict"], told["summary"])
