"""What ``diagnose.py`` does with many dives once its command line is read: choose, follow, compare, write."""

import logging
from os.path import realpath
from pathlib import Path

from omegaconf import DictConfig

from auv_torchrl.command import Run, checking_input
from auv_torchrl.diagnosis.calibrate.parameters import read_uncertainty
from auv_torchrl.diagnosis.command.logs import find_logs, names, no_logs
from auv_torchrl.diagnosis.command.request import plain_config, read_settings
from auv_torchrl.diagnosis.plain import plain, write_json
from auv_torchrl.files import write_text
from auv_torchrl.flightlog import FlightLogError
from auv_torchrl.flightlog.streams.options import read_options
from auv_torchrl.monitoring.changes import ChangeRecord, find_changes
from auv_torchrl.monitoring.dive_date import begun
from auv_torchrl.monitoring.dive_history import DiveHistory, console, make_history
from auv_torchrl.monitoring.dive_page import dives_page
from auv_torchrl.monitoring.dive_record import Dive
from auv_torchrl.monitoring.dive_work import DivePlan, Work, diagnose_some, follow_all
from auv_torchrl.progress import Progress
from auv_torchrl.quantities import counted
from auv_torchrl.vehicle import load_vehicle

log = logging.getLogger("diagnose")
VERSION = 1  # of dives.json
_SHAPING = (
    "vehicle",
    "diagnosis",
    "extra",
    "modes",
    "params",
    "system",
    "mapping",
    "trust_log",
)  # keys that shape a result


def answer_dives(config: DictConfig, run: Run) -> None:
    """Follow every dive, find what changed, print the report, write the page."""
    with checking_input():
        plan, work = plan_dives(config), _work(config)
    folder = run.folder
    with checking_input((FlightLogError,)), Progress() as progress:
        baseline, dives = follow_all(work, plan, progress)
    per_false_alarm = float(config.dives_per_false_alarm)
    record = find_changes(dives, baseline, plan.reference, per_false_alarm)
    which = to_diagnose(str(config.each), dives, record, work.settings.excess)
    diagnoses = diagnose_some(work, plan, which, folder)
    history = make_history(
        dives, baseline, record, work.vehicle, work.vehicle_name, per_false_alarm, work.settings.excess, diagnoses,
        plan.findings,
    )  # fmt: skip
    log.info("\n%s\n", console(history))
    write_history(history, work, folder)
    log.info("dives.html and dives.json are in %s", folder)


def write_history(history: DiveHistory, work: Work, folder: Path) -> None:
    """Write the page and the file for programs."""
    write_json(folder / "dives.json", {"version": VERSION, **plain(history)})
    write_text(folder / "dives.html", dives_page(history, work.vehicle))


def plan_dives(config: DictConfig) -> DivePlan:
    """The dives that a config names.

    Raises:
        ValueError: if there are too few, one that cannot be read, or keys that go with a single log alone.
    """
    if config.test:
        raise ValueError("test=... goes with one log: leave it out, or diagnose the dives one by one")
    found = find_logs(config)
    healthy = found["healthy"]
    own = {realpath(path) for path in healthy}
    dives = [path for path in found["log"] if realpath(path) not in own]  # of a link to itself, too
    if all(begun(path) for path in dives):
        dives.sort(key=begun)
    reference = len(healthy) or int(config.reference)
    if not healthy and reference < 1:
        raise ValueError(f"reference is {reference}: give 1 dive or more that is known to be sound, or healthy=[...]")
    paths = (*healthy, *dives)
    if len(paths) <= reference:
        raise ValueError(
            f"{counted(len(paths), 'dive')}, and the reference is {reference} of them: give more, or "
            "fewer as reference=1"
        )
    return DivePlan(paths, tuple(begun(path) for path in paths), reference, no_logs(config))


def to_diagnose(each: str, dives: list[Dive], record: ChangeRecord, excess: float) -> list[int]:
    """Dives, by number from 0, that are diagnosed by themselves.

    Following a dive takes seconds, diagnosing it a minute, and a dive without a change has nothing to explain. By
    default only those are diagnosed that raised an alarm or are not explained, and the last one after a change.
    """
    usable = [i for i, dive in enumerate(dives) if not dive.refused]
    if each == "none" or not usable:
        return []
    if each == "all":
        return usable
    noticed = {alarm.dive for alarm in record.alarms} | ({usable[-1]} if record.changes else set())
    odd = {i for i in usable if i >= record.reference and not dives[i].explained(excess)}
    return sorted((noticed | odd) & set(usable))


def _work(config: DictConfig) -> Work:
    vehicle = load_vehicle(plain_config(config.vehicle))
    if config.each not in ("all", "changed", "none"):
        raise ValueError(f"each is {config.each!r}: give changed, all or none")
    if not config.dives_per_false_alarm >= 1:
        raise ValueError(f"dives_per_false_alarm is {config.dives_per_false_alarm}: give 1 or more")
    options = read_options(names(config, "modes"), plain_config(config.params), config.system, config.mapping)
    return Work(
        vehicle=vehicle,
        vehicle_name=str(config.vehicle.get("name", "unnamed")),
        settings=read_settings(plain_config(config.diagnosis), vehicle),
        uncertainty=read_uncertainty(plain_config(config.vehicle).get("uncertainty"), vehicle),
        extra=names(config, "extra"),
        options=options,
        trust_log=config.trust_log,
        shaped_by={key: plain_config(config[key]) for key in _SHAPING} | {"parameters": dict(options.parameters)},
        store=Path(config.store).absolute(),
        jobs=int(config.jobs),
    )
