"""The work over many dives: each is followed by itself, in parallel, and what is there already is not done again."""

import json
import logging
import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from auv_torchrl.diagnosis.axes import followable
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient
from auv_torchrl.diagnosis.dives.answer import OwnDiagnosis
from auv_torchrl.diagnosis.dives.follow import Reference, refer, tell
from auv_torchrl.diagnosis.dives.plan import Planned
from auv_torchrl.diagnosis.dives.store import keep, kept, key_of
from auv_torchrl.diagnosis.dives.told import Dive, Normal
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.files import write_whole
from auv_torchrl.flightlog import FlightLog, FlightLogError, Severity, read_flightlog
from auv_torchrl.flightlog.streams.stream import ReadOptions
from auv_torchrl.importing import importing_without_compiler
from auv_torchrl.parallel import each
from auv_torchrl.text import printable
from auv_torchrl.vehicle import Vehicle

log = logging.getLogger(__name__)
_LONGEST = 100  # characters of the name of a log that its folder takes on


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
        cut_windows(followable(flight), self.settings.window_s, self.settings.lead_s, self.settings.bin_s)
        return flight

    def read_reference(self, planned: Planned, but: Path | None = None) -> tuple[list[FlightLog], list[str]]:
        """The logs of the reference that can be used, ``but`` one, and why the others cannot."""
        logs, refusals = [], []
        for path in planned.paths[: planned.reference]:
            try:
                logs += [] if path == but else [self.read(path)]
            except FlightLogError as error:
                refusals.append(str(error))
        return logs, refusals

    def key(self, planned: Planned, *files: Path) -> str:
        """Under which what follows from the reference and from files is kept."""
        return key_of(self.shaped_by, *planned.paths[: planned.reference], *files)


def follow_all(work: Work, planned: Planned, progress: Callable[[str, float], None]) -> tuple[Normal, list[Dive]]:
    """What the reference shows, and what each dive tells.

    Raises:
        FlightLogError: if no dive of the reference can be used, or none behind it.
    """
    key = work.key(planned)
    keys = [work.key(planned, path) for path in planned.paths]
    normal = kept(work.store, key, Normal)
    dives = {
        i: replace(dive, name=printable(planned.paths[i].name), begun=planned.begun[i])  # not those of a copy
        for i, own in enumerate(keys)
        if normal and (dive := kept(work.store, own, Dive)) is not None
    }
    if dives:
        log.info("%d of %d dives were worked out before", len(dives), len(keys))
    waiting = [i for i in range(len(keys)) if i not in dives]
    if waiting:
        progress("calibrating on the reference", 0.0)
        healthy, refusals = work.read_reference(planned)
        if not healthy:
            raise FlightLogError(f"no dive of the reference can be used: {'; '.join(refusals)}")
        reference = refer(healthy, work.vehicle, work.settings, work.uncertainty)
        if normal is None:
            normal = reference.normal
            keep(work.store, key, normal)
        tasks = [(work, reference, planned.paths[i], planned.begun[i], keys[i]) for i in waiting]
        for i, dive in zip(waiting, each(_follow_one, tasks, work.jobs), strict=True):
            dives[i] = dive
            progress(f"dive {i + 1}: {dive.name}", len(dives) / len(keys))
    assert normal is not None  # kept, or worked out for the first dive
    behind = [dives[i] for i in range(planned.reference, len(keys))]
    if all(dive.refused for dive in behind):
        raise FlightLogError(f"no dive behind the reference can be used: {behind[0].refused}")
    return normal, [dives[i] for i in range(len(keys))]


def _follow_one(task: tuple[Work, Reference, Path, str, str]) -> Dive:
    work, reference, path, begun, key = task
    try:
        dive = tell(work.read(path), reference, begun)
    except FlightLogError as error:
        dive = Dive.unread(printable(path.name), printable(str(error), None), len(reference.normal.numbers), begun)
    keep(work.store, key, dive)
    return dive


def diagnose_some(work: Work, planned: Planned, which: Sequence[int], folder: Path) -> dict[int, OwnDiagnosis]:
    """Dives diagnosed by themselves, each against the reference, and their reports in folders of their own."""
    tasks = [(work, planned, i) for i in which]
    found = {}
    for i, (where, said) in zip(which, each(_diagnose_one, tasks, work.jobs), strict=True):
        if where is not None:
            own = f"dives/{i + 1:03d}_{_harmless(planned.paths[i].stem)}"
            shutil.copytree(where, folder / own, dirs_exist_ok=True)
            found[i] = OwnDiagnosis(*said, own)
        log.info("dive %d by itself: %s", i + 1, said[1])
    return found


def _harmless(name: str) -> str:
    """A name of a folder that needs no quotes in a shell, a page or an address."""
    return re.sub(r"[^A-Za-z0-9._-]", "_", name)[:_LONGEST]


def _diagnose_one(task: tuple[Work, Planned, int]) -> tuple[Path | None, tuple[str, str]]:
    """Where the files of its diagnosis are kept, and its verdict and summary."""
    with importing_without_compiler():  # here: it loads MuJoCo, which following does not need
        from auv_torchrl.diagnosis.pipeline import diagnose
        from auv_torchrl.diagnosis.report.files import write_files

    work, planned, i = task
    path = planned.paths[i]
    where = work.store / f"diagnosis_{work.key(planned, path)}"
    if not (where / "complete").is_file():
        try:
            healthy, _ = work.read_reference(planned, but=path)
            found = diagnose(work.read(path), work.vehicle, healthy, vehicle_name=work.vehicle_name,
                             settings=work.settings, uncertainty=work.uncertainty)  # fmt: skip
        except FlightLogError as error:
            return None, ("", str(error))
        write_files(found, work.vehicle, where, replace=True)
        write_whole(where / "complete", b"")
    told = json.loads((where / "diagnosis.json").read_bytes())
    return where, (told["verdict"], told["summary"])
