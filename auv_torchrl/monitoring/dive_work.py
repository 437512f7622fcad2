"""Following many dives: each by itself, in parallel; what is in the store already is not worked out again.

The store keeps what was worked out of a dive under a hash of everything that shaped it, so that a killed run goes on
where it was. Another version of the program, another vehicle or another reference has other hashes, and finds nothing
of these.
"""

import hashlib
import json
import logging
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from auv_torchrl import __version__
from auv_torchrl.diagnosis.axes import followable
from auv_torchrl.diagnosis.calibrate.parameters import Coefficient
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.plain import from_plain, plain
from auv_torchrl.diagnosis.unanswered.other_source import share_of_held
from auv_torchrl.diagnosis.unanswered.wording import tell_held
from auv_torchrl.files import say_not_kept, write_text, write_whole
from auv_torchrl.flightlog import Finding, FlightLog, FlightLogError, Severity, read_flightlog
from auv_torchrl.flightlog.streams.configuration import SET_IN_FLIGHT
from auv_torchrl.flightlog.streams.stream import ReadOptions
from auv_torchrl.monitoring.dive_history import DiveDiagnosis
from auv_torchrl.monitoring.dive_record import Baseline, Dive, Reference, follow_dive, learn_reference
from auv_torchrl.parallel import each
from auv_torchrl.paths import own_folder
from auv_torchrl.text import printable
from auv_torchrl.vehicle import Vehicle

log = logging.getLogger(__name__)
Record = TypeVar("Record", Dive, Baseline)

_DIGITS = 20  # of the hash, in names of files
_LONGEST = 100  # characters of the name of a log that its folder takes on


@cache
def program() -> str:
    """Version of the program, and a hash of its sources and of Python of one's own."""
    package, own = Path(__file__).resolve().parents[1], own_folder()
    summed = hashlib.sha256(__version__.encode())
    for folder in [package, *([own] if own else [])]:
        for path in sorted(folder.rglob("*.py")):
            summed.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return summed.hexdigest()


def store_key(settings: Mapping[str, Any], *files: Path) -> str:
    """The name under which the store has what follows from settings and files."""
    summed = hashlib.sha256(json.dumps([program(), plain(dict(settings))], sort_keys=True, default=str).encode())
    for file in files:
        for part in sorted(file.rglob("*")) if file.is_dir() else [file]:
            summed.update(_digest(part))
    return summed.hexdigest()[:_DIGITS]


def _digest(path: Path) -> bytes:
    """Of the content of a file; of its name where the content cannot be read, until it can."""
    try:
        if path.is_file():  # a pipe may never end
            with path.open("rb") as content:
                return hashlib.file_digest(content, "sha256").digest()
    except OSError as error:
        log.debug("%s: %s", path, error)
    return path.name.encode(errors="surrogateescape")


def write_record(folder: Path, key: str, record: Dive | Baseline) -> None:
    """Put a dive, or the healthy vehicle, into the store; a full disk costs time later and nothing else."""
    content = json.dumps(plain(record), allow_nan=False)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(_record_file(folder, key, type(record)), content)
    except OSError as error:
        say_not_kept(error.strerror or str(error))


def read_record(folder: Path, key: str, kind: type[Record]) -> Record | None:
    """What the store has; None where there is nothing that can be read."""
    path = _record_file(folder, key, kind)
    try:
        return from_plain(kind, json.loads(path.read_bytes()))
    except FileNotFoundError:
        return None
    except (KeyError, ValueError):
        log.warning("%s cannot be read: it is worked out again", path)
        return None


def _record_file(folder: Path, key: str, kind: type[Dive | Baseline]) -> Path:
    return folder / f"{'dive' if kind is Dive else 'reference'}_{key}.json"


@dataclass(frozen=True)
class DivePlan:
    """Dives in their order; the first ones are the reference."""

    paths: tuple[Path, ...]
    begun: tuple[str, ...]  # date and time as far as the name of the file has them; else empty
    reference: int  # how many
    findings: tuple[Finding, ...] = ()  # what their folder holds besides


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
    shaped_by: dict[str, Any]  # what the results depend on beside the logs, of plain types
    store: Path
    jobs: int  # processes; -1 for one on each core

    def read(self, path: Path) -> FlightLog:
        """A log of the vehicle.

        Raises:
            FlightLogError: if the log cannot be used.
        """
        flight = read_flightlog(path, self.vehicle, self.extra, self.options)
        errors = [str(finding) for finding in flight.findings if finding.severity is Severity.ERROR]
        if errors and not self.trust_log:
            raise FlightLogError(f"{flight.name}: {' '.join(errors)}")
        if flight.is_idle:
            raise FlightLogError(f"{flight.name} holds no dive: no thruster turns in it")
        followed = followable(flight)
        cut_windows(followed, self.settings.window_s, self.settings.lead_s, self.settings.bin_s)
        if (share := share_of_held(followed, self.vehicle, self.settings)) is not None:
            raise FlightLogError(f"{flight.name} holds no dive: {tell_held(share, followed.axes).sentence}")
        return flight

    def read_reference(self, plan: DivePlan, but: Path | None = None) -> tuple[list[FlightLog], list[str]]:
        """The logs of the reference that can be used, ``but`` one, and why the others cannot."""
        logs, refusals = [], []
        for path in plan.paths[: plan.reference]:
            try:
                log = self.read(path)
            except FlightLogError as error:
                refusals.append(str(error))
                continue
            if changed := [finding.sentence for finding in log.findings if finding.code == SET_IN_FLIGHT]:
                refusals.append(f"{log.name} is no reference: {'; '.join(changed)}")
            elif path != but:
                logs.append(log)
        return logs, refusals

    def key(self, plan: DivePlan, *files: Path) -> str:
        """Under which the store has what follows from the reference and from files."""
        return store_key(self.shaped_by, *plan.paths[: plan.reference], *files)


def follow_all(work: Work, plan: DivePlan, progress: Callable[[str, float], None]) -> tuple[Baseline, list[Dive]]:
    """What the reference shows, and what each dive tells.

    Raises:
        FlightLogError: if no dive of the reference can be used, or none behind it.
    """
    key = work.key(plan)
    keys = [work.key(plan, path) for path in plan.paths]
    baseline = read_record(work.store, key, Baseline)
    dives = {
        i: replace(dive, name=printable(plan.paths[i].name), begun=plan.begun[i])  # not those of a copy
        for i, own in enumerate(keys)
        if baseline and (dive := read_record(work.store, own, Dive)) is not None
    }
    if dives:
        log.info("%d of %d dives were worked out before", len(dives), len(keys))
    waiting = [i for i in range(len(keys)) if i not in dives]
    if waiting:
        progress("calibrating on the reference", 0.0)
        healthy, refusals = work.read_reference(plan)
        if not healthy:
            raise FlightLogError(f"no dive of the reference can be used: {'; '.join(refusals)}")
        reference = learn_reference(healthy, work.vehicle, work.settings, work.uncertainty)
        if baseline is None:
            baseline = reference.baseline
            write_record(work.store, key, baseline)
        tasks = [(work, reference, plan.paths[i], plan.begun[i], keys[i]) for i in waiting]
        for i, dive in zip(waiting, each(_follow_one, tasks, work.jobs), strict=True):
            dives[i] = dive
            progress(f"dive {i + 1}: {dive.name}", len(dives) / len(keys))
    assert baseline is not None  # from the store, or worked out for the first dive
    behind = [dives[i] for i in range(plan.reference, len(keys))]
    if all(dive.refused for dive in behind):
        raise FlightLogError(f"no dive behind the reference can be used: {behind[0].refused}")
    return baseline, [dives[i] for i in range(len(keys))]


def _follow_one(task: tuple[Work, Reference, Path, str, str]) -> Dive:
    work, reference, path, begun, key = task
    try:
        dive = follow_dive(work.read(path), reference, begun)
    except FlightLogError as error:
        k = len(reference.baseline.parameters)
        dive = Dive.unread(printable(path.name), printable(str(error), None), k, begun)
    write_record(work.store, key, dive)
    return dive


def diagnose_some(work: Work, plan: DivePlan, which: Sequence[int], folder: Path) -> dict[int, DiveDiagnosis]:
    """Dives diagnosed by themselves, each against the reference, and their reports in folders of their own."""
    tasks = [(work, plan, i) for i in which]
    found = {}
    for i, (where, verdict, summary) in zip(which, each(_diagnose_one, tasks, work.jobs), strict=True):
        if where is not None:
            own = f"dives/{i + 1:03d}_{_folder_name(plan.paths[i].stem)}"
            shutil.copytree(where, folder / own, dirs_exist_ok=True)
            found[i] = DiveDiagnosis(verdict, summary, own)
        log.info("dive %d by itself: %s", i + 1, summary)
    return found


def _folder_name(name: str) -> str:
    """A name of a folder that needs no quotes in a shell, a page or an address."""
    return re.sub(r"[^A-Za-z0-9._-]", "_", name)[:_LONGEST]


def _diagnose_one(task: tuple[Work, DivePlan, int]) -> tuple[Path | None, str, str]:
    """The folder in the store that has the files of the diagnosis of a dive, its verdict and its summary."""
    from auv_torchrl.diagnosis.pipeline import diagnose  # here, not above: following needs nothing of it
    from auv_torchrl.diagnosis.report.files import write_files

    work, plan, i = task
    path = plan.paths[i]
    where = work.store / f"diagnosis_{work.key(plan, path)}"
    if not (where / "complete").is_file():
        try:
            healthy, _ = work.read_reference(plan, but=path)
            found = diagnose(work.read(path), work.vehicle, healthy, vehicle_name=work.vehicle_name,
                             settings=work.settings, uncertainty=work.uncertainty)  # fmt: skip
        except FlightLogError as error:
            return None, "", str(error)
        write_files(found, work.vehicle, where, replace=True)
        write_whole(where / "complete", b"")
    content = json.loads((where / "diagnosis.json").read_bytes())
    return where, content["verdict"], content.get("headline") or content["summary"]
