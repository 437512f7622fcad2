"""What ``diagnose.py`` does with many dives once its command line is read."""

import logging
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from auv_torchrl.command import checking_input
from auv_torchrl.diagnosis.calibrate.uncertainty import read_uncertainty
from auv_torchrl.diagnosis.dives.answer import ManyDives, OwnDiagnosis
from auv_torchrl.diagnosis.dives.changes import Judged, judge
from auv_torchrl.diagnosis.dives.compose import compose
from auv_torchrl.diagnosis.dives.page import dives_page
from auv_torchrl.diagnosis.dives.plan import plan
from auv_torchrl.diagnosis.dives.said import console
from auv_torchrl.diagnosis.dives.told import Dive
from auv_torchrl.diagnosis.dives.work import Work, diagnose_some, follow_all
from auv_torchrl.diagnosis.logs import names
from auv_torchrl.diagnosis.plain import plain, write_json
from auv_torchrl.diagnosis.request import plain_config
from auv_torchrl.diagnosis.settings import read_settings
from auv_torchrl.files import write_text
from auv_torchrl.flightlog import FlightLogError
from auv_torchrl.flightlog.streams.options import read_options
from auv_torchrl.progress import Progress
from auv_torchrl.vehicle import load_vehicle

log = logging.getLogger("diagnose")
VERSION = 1  # of dives.json
_SHAPING = ("vehicle", "diagnosis", "extra", "modes", "params", "system", "trust_log")  # keys that shape an answer


def answer_dives(config: DictConfig) -> None:
    """Follow every dive, tell what changed, print it, write the page."""
    with checking_input():
        planned, work = plan(config), _work(config)
    folder = Path(HydraConfig.get().runtime.output_dir)
    with checking_input((FlightLogError,)), Progress() as progress:
        normal, dives = follow_all(work, planned, progress)
    judged = judge(dives, normal, planned.reference, float(config.dives_per_false_alarm))
    which = to_diagnose(str(config.each), dives, judged, work.settings.excess)
    own: dict[int, OwnDiagnosis] = diagnose_some(work, planned, which, folder)
    told = compose(
        dives, normal, judged, work.vehicle, work.vehicle_name, float(config.dives_per_false_alarm),
        work.settings.excess, own, planned.findings,
    )  # fmt: skip
    log.info("\n%s\n", console(told))
    write_answer(told, work, folder)
    log.info("dives.html and dives.json are in %s", folder)


def write_answer(told: ManyDives, work: Work, folder: Path) -> None:
    """Write the page and the file for programs."""
    write_json(folder / "dives.json", {"version": VERSION, **plain(told)})
    write_text(folder / "dives.html", dives_page(told, work.vehicle))


def to_diagnose(each: str, dives: list[Dive], judged: Judged, excess: float) -> list[int]:
    """Dives, by number from 0, that are diagnosed by themselves.

    Following a dive takes seconds and diagnosing it a minute, and one that is as it was has nothing to say: by default
    only those are diagnosed in which something was noticed, and the last one where something has changed.
    """
    usable = [i for i, dive in enumerate(dives) if not dive.refused]
    if each == "none" or not usable:
        return []
    if each == "all":
        return usable
    noticed = {alarm.dive for alarm in judged.alarms} | ({usable[-1]} if judged.changes else set())
    odd = {i for i in usable if i >= judged.reference and not dives[i].explained(excess)}
    return sorted((noticed | odd) & set(usable))


def _work(config: DictConfig) -> Work:
    vehicle = load_vehicle(plain_config(config.vehicle))
    if config.each not in ("all", "changed", "none"):
        raise ValueError(f"each is {config.each!r}: give changed, all or none")
    if not config.dives_per_false_alarm >= 1:
        raise ValueError(f"dives_per_false_alarm is {config.dives_per_false_alarm}: give 1 or more")
    options = read_options(names(config, "modes"), plain_config(config.params), config.system)
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
