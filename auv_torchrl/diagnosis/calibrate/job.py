"""What ``calibrate.py`` does once its command line is read."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from omegaconf import DictConfig
from threadpoolctl import threadpool_limits

from auv_torchrl import __version__
from auv_torchrl.command import BadInput, checking_input
from auv_torchrl.diagnosis.calibrate.contradicting import healthy_flight
from auv_torchrl.diagnosis.calibrate.crossvalidation import (
    Unseen,
    disagree,
    hold_against,
    why_not,
    without_odd_ones,
)
from auv_torchrl.diagnosis.calibrate.healthy import Calibration, calibrate_attitude
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient, read_uncertainty
from auv_torchrl.diagnosis.calibrate.vehicle_file import vehicle_yaml
from auv_torchrl.diagnosis.calibrate.wording import console_lines, head_lines, refusal
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.lengths import check_lengths, split
from auv_torchrl.diagnosis.logs import names
from auv_torchrl.diagnosis.request import plain_config, report_findings
from auv_torchrl.diagnosis.settings import read_settings
from auv_torchrl.files import write_whole
from auv_torchrl.flightlog import FlightLog, FlightLogError, join, read_flightlog
from auv_torchrl.flightlog.readiness import refuse_errors
from auv_torchrl.flightlog.streams.options import read_options
from auv_torchrl.progress import Progress
from auv_torchrl.vehicle import Vehicle, load_vehicle

log = logging.getLogger("calibrate")


class NotWorthKeeping(BadInput):
    """What was calibrated predicts unseen flight no better than the vehicle that was given."""

    code = 3


@dataclass(frozen=True)
class Asked:
    """What to calibrate."""

    name: str  # of the vehicle
    vehicle: Vehicle  # as its file says, no batch
    uncertainty: tuple[Coefficient, ...]
    settings: Settings
    healthy: tuple[FlightLog, ...]


def keep(config: DictConfig, paths: Sequence[Path], output: Path) -> None:
    """Read the logs, calibrate, hold each flight against the others, say what was found, write the file."""
    with checking_input():
        asked = read_asked(config, paths)
    with checking_input((FlightLogError,)), Progress() as progress:
        sound, flights, left_out = calibrate_and_judge(asked, progress)
    for line in console_lines(sound, flights, left_out, asked.settings):
        log.info("%s", line)
    if disagree(flights, asked.settings):
        both = " and ".join(flight.name for flight in flights)
        raise NotWorthKeeping(
            f"{both} show two different vehicles, and of two nobody can tell which one is sound: give a third healthy "
            "flight; nothing was written"
        )
    if reason := why_not(flights):
        raise NotWorthKeeping(refusal(reason, asked.name, flights))
    used = [flight for flight in asked.healthy if flight.name not in {odd.name for odd in left_out}]
    about = {
        "logs": [flight.name for flight in used],
        "seconds": round(sum(flight.duration for flight in used), 1),
        "vehicle": asked.name,
        "made": datetime.now(UTC).strftime("%Y-%m-%d %H:%M"),
        "version": __version__,
    }
    comments = head_lines(about, flights, left_out)
    with checking_input():
        text = vehicle_yaml(sound, asked.vehicle, output.stem, about, comments)
    if output.exists() and not config.replace:
        raise BadInput(f"{output} has come to exist meanwhile: give another output=FILE, or replace=true")
    write_whole(output, text.encode())
    log.info("%s is a vehicle now: train.py vehicle=%s, diagnose.py log=... vehicle=%s", output, output, output)


def read_asked(config: DictConfig, paths: Sequence[Path]) -> Asked:
    """Read every file that the config names.

    Raises:
        ValueError: for a vehicle, setting or log that cannot be used, naming it and what to do.
    """
    content = plain_config(config.vehicle)
    vehicle = load_vehicle(content)
    settings = read_settings(plain_config(config.diagnosis), vehicle)
    options = read_options(names(config, "modes"), plain_config(config.params), config.system)
    extra = names(config, "extra")
    healthy = tuple(healthy_flight(read_flightlog(path, vehicle, extra, options)) for path in paths)
    report_findings(healthy)
    if not config.trust_log:
        refuse_errors(healthy)
    for flight in healthy:
        check_lengths(flight, flight, [flight], False, settings)
    join(healthy)  # one vehicle, axes in common
    if len({flight.name for flight in healthy}) < len(healthy):
        raise ValueError("two logs have the same name: rename one of them, so that they can be told apart")
    uncertainty = read_uncertainty(content.get("uncertainty"), vehicle)
    return Asked(str(content.get("name", "unnamed")), vehicle, uncertainty, settings, healthy)


@threadpool_limits.wrap(limits=1)  # the arrays are small: a second thread only waits
def calibrate_and_judge(
    asked: Asked, progress: Callable[[str, float], None]
) -> tuple[Calibration, tuple[Unseen, ...], tuple[Unseen, ...]]:
    """The calibration on all flights that agree, these held against each other, and those that were left out.

    One flight is held against its own first part.
    """
    given = (asked.vehicle, asked.settings, asked.uncertainty)
    only, *more = asked.healthy
    if more:
        stage, count = "holding each flight against the others", 1 + len(asked.healthy)
        progress(stage, 0.0)
        return without_odd_ones(asked.healthy, *given, report=lambda done: progress(stage, min(done / count, 0.95)))
    progress("holding its end against the rest", 0.0)
    early, late, _ = split(only, ())
    with np.errstate(all="ignore"):
        flights = (hold_against(late, calibrate_attitude([early], *given), asked.vehicle, asked.settings),)
    progress("calibrating on all of it", 0.5)
    return calibrate_attitude(asked.healthy, *given), flights, ()
