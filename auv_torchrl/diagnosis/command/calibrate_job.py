"""What ``auv-calibrate`` does once its command line is read: read, calibrate, check, tell, write."""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import DictConfig
from threadpoolctl import threadpool_limits

from auv_torchrl import __version__
from auv_torchrl.command import BadInput, checking_input
from auv_torchrl.command.errors import one_line
from auv_torchrl.diagnosis.calibrate.calibration import Calibration, calibrate_attitude
from auv_torchrl.diagnosis.calibrate.parameters import Coefficient, read_uncertainty
from auv_torchrl.diagnosis.calibrate.vehicle_file import vehicle_yaml
from auv_torchrl.diagnosis.command.logs import names
from auv_torchrl.diagnosis.command.request import plain_config, read_settings, report_findings
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.lengths import check_lengths, split
from auv_torchrl.diagnosis.validate.healthy_flights import (
    FlightCheck,
    calibrate_without_odd_flights,
    check_flight,
    check_healthy_flight,
    flights_disagree,
    pool_errors,
    reason_against,
)
from auv_torchrl.diagnosis.verdict import Errors
from auv_torchrl.files import write_whole
from auv_torchrl.flightlog import FlightLog, FlightLogError, join, read_flightlog
from auv_torchrl.flightlog.readiness import refuse_errors
from auv_torchrl.flightlog.streams.options import read_options
from auv_torchrl.progress import Progress
from auv_torchrl.quantities import percent, quantity, words
from auv_torchrl.vehicle import Vehicle, load_vehicle

log = logging.getLogger("calibrate")
SHOWN_S = (2.0, 5.0)  # horizons that are printed
QUANTITIES = (("position_m", "position", "m"), ("yaw_rad", "heading", "rad"), ("velocity", "velocity", "m/s"))


class CalibrationRefusal(BadInput):
    """The calibrated vehicle predicts unseen flight no better than the vehicle that was given."""

    code = 3


@dataclass(frozen=True)
class CalibrationRequest:
    """What to calibrate."""

    name: str  # of the vehicle
    vehicle: Vehicle  # as its file says, no batch
    uncertainty: tuple[Coefficient, ...]
    settings: Settings
    healthy: tuple[FlightLog, ...]


def calibrate_to_file(config: DictConfig, paths: Sequence[Path], output: Path) -> None:
    """Read the logs, calibrate, check each flight against the others, tell what was found, and write the file."""
    with checking_input():
        request = read_request(config, paths)
    with checking_input((FlightLogError,)), Progress() as progress:
        calibration, flights, left_out = calibrate_and_check(request, progress)
    for line in console_lines(calibration, flights, left_out, request.settings):
        log.info("%s", line)
    if flights_disagree(flights, request.settings):
        both = " and ".join(flight.name for flight in flights)
        raise CalibrationRefusal(
            f"{both} show two different vehicles, and of two nobody can tell which one is sound: give a third healthy "
            "flight; nothing was written"
        )
    if reason := reason_against(flights):
        raise CalibrationRefusal(refusal(reason, request.name, flights))
    used = [flight for flight in request.healthy if flight.name not in {odd.name for odd in left_out}]
    about = {
        "logs": [flight.name for flight in used],
        "seconds": round(sum(flight.duration for flight in used), 1),
        "vehicle": request.name,
        "made": datetime.now(UTC).strftime("%Y-%m-%d %H:%M"),
        "version": __version__,
    }
    comments = head_lines(about, flights, left_out)
    with checking_input():
        text = vehicle_yaml(calibration, request.vehicle, output.stem, about, comments)
    if output.exists() and not config.replace:
        raise BadInput(f"{output} has come to exist meanwhile: give another output=FILE, or replace=true")
    write_whole(output, text.encode())
    log.info("%s is a vehicle now: train.py vehicle=%s, diagnose.py log=... vehicle=%s", output, output, output)


def read_request(config: DictConfig, paths: Sequence[Path]) -> CalibrationRequest:
    """Read every file that the config names.

    Raises:
        ValueError: for a vehicle, setting or log that cannot be used, naming it and what to do.
    """
    content = plain_config(config.vehicle)
    vehicle = load_vehicle(content)
    settings = read_settings(plain_config(config.diagnosis), vehicle)
    options = read_options(names(config, "modes"), plain_config(config.params), config.system, config.mapping)
    extra = names(config, "extra")
    healthy = tuple(check_healthy_flight(read_flightlog(path, vehicle, extra, options)) for path in paths)
    report_findings(healthy)
    if not config.trust_log:
        refuse_errors(healthy)
    for flight in healthy:
        check_lengths(flight, flight, [flight], False, settings)
    join(healthy)  # one vehicle, axes in common
    if len({flight.name for flight in healthy}) < len(healthy):
        raise ValueError("two logs have the same name: rename one of them, so that they can be told apart")
    uncertainty = read_uncertainty(content.get("uncertainty"), vehicle)
    return CalibrationRequest(str(content.get("name", "unnamed")), vehicle, uncertainty, settings, healthy)


@threadpool_limits.wrap(limits=1)  # the arrays are small: a second thread only waits
def calibrate_and_check(
    request: CalibrationRequest, progress: Callable[[str, float], None]
) -> tuple[Calibration, tuple[FlightCheck, ...], tuple[FlightCheck, ...]]:
    """The calibration on all flights that agree, the check of each by the others, and those that were left out.

    The end of a single flight is checked against its first part.
    """
    given = (request.vehicle, request.settings, request.uncertainty)
    only, *more = request.healthy
    if more:
        stage, count = "holding each flight against the others", 1 + len(request.healthy)
        progress(stage, 0.0)
        return calibrate_without_odd_flights(
            request.healthy, *given, report=lambda done: progress(stage, min(done / count, 0.95))
        )
    progress("holding its end against the rest", 0.0)
    early, late, _ = split(only, ())
    with np.errstate(all="ignore"):
        flights = (check_flight(late, calibrate_attitude([early], *given), request.vehicle, request.settings),)
    progress("calibrating on all of it", 0.5)
    return calibrate_attitude(request.healthy, *given), flights, ()


def console_lines(
    calibration: Calibration, flights: Sequence[FlightCheck], left_out: Sequence[FlightCheck], settings: Settings
) -> list[str]:
    """What a person reads who called the command."""
    lines = [str(finding) for finding in calibration.findings]
    if 0 < len(calibration.wrong_effects) <= settings.most_effects:
        lines.append(
            f"the file is off in {', '.join(words(name) for name in calibration.wrong_effects)} alone: if that has not "
            "always been so, it is a fault, and no calibration; diagnose.py log=... tells"
        )
    lines += [*odd_flight_lines(left_out), *flight_lines(flights), *no_better_lines(flights)]
    lines += [
        f"{flight.name}: departs from what the others say (chi-square {flight.excess:.2f} per number)"
        for flight in flights
        if flight.excess > settings.excess
    ]
    return lines


def head_lines(about: Mapping[str, Any], flights: Sequence[FlightCheck], left_out: Sequence[FlightCheck]) -> list[str]:
    """The top of the file: from what it was made, and how well it predicts unseen flight."""
    before, after = pool_errors(flights)
    return [
        one_line(f"Calibrated on {', '.join(about['logs'])} ({about['seconds']:g} s) from vehicle={about['vehicle']}, "
                 f"{about['made']} UTC, auv_torchrl {about['version']}."),
        f"Unseen flight is predicted with {percent(after / before)} of the error of that vehicle:",
        *flight_lines(flights),
        *no_better_lines(flights),
        *odd_flight_lines(left_out),
    ]  # fmt: skip


def odd_flight_lines(left_out: Sequence[FlightCheck]) -> list[str]:
    """Flights that are not like the others."""
    return [
        one_line(
            f"{flight.name} is not like the other flights (chi-square {flight.excess:.3g} per number under what they "
            "say, 1 is noise): left out. Diagnose it with the calibrated vehicle"
        )
        for flight in left_out
    ]


def no_better_lines(flights: Sequence[FlightCheck]) -> list[str]:
    """Flights that gain nothing where the others gain enough for all; none where the calibration is refused."""
    if reason_against(flights):
        return []
    return [
        one_line(
            f"{flight.name} is predicted no better than by the file ({flight.after:.2f} floors of error, "
            f"{flight.before:.2f} before): others do not show what it does. Give more flights like it"
        )
        for flight in flights
        if not flight.gains
    ]


def refusal(reason: str, vehicle: str, flights: Sequence[FlightCheck]) -> str:
    """That nothing is written, and what to do: go on with the given vehicle, and fly what the other flights lack."""
    behind = ", ".join(flight.name for flight in flights if not flight.gains)
    some = any(flight.gains for flight in flights) and behind
    until = f" until there are more flights like {behind}: the others do not show what it does" if some else ""
    return f"{reason}; nothing was written: go on with vehicle={vehicle}{until}"


def flight_lines(flights: Sequence[FlightCheck]) -> list[str]:
    """Errors of each flight as the others predict it, before and after."""
    found = []
    for flight in flights:
        parts = []
        for kind, name, unit in QUANTITIES:
            errors: Errors | None = getattr(flight, kind)
            if errors is None:
                continue
            shown = [
                f"{quantity(errors.before[place], unit)} → {quantity(errors.after[place], unit)} at {horizon:g} s"
                for place, horizon in enumerate(flight.horizons_s)
                if horizon in SHOWN_S
            ]
            parts += [f"{name} {', '.join(shown)}"] if shown else []
        found.append(one_line(f"{flight.name}: {'; '.join(parts) or 'too short for 2 s'}"))
    return found
