"""Whether a diagnosis begins with a log: what it asks of axes, lengths and findings, before anything is computed."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.log import ACCELERATION, FlightLog
from auv_torchrl.flightlog.reader import find_usable, read_flightlog, without
from auv_torchrl.flightlog.understand import Understood
from auv_torchrl.paths import CONF
from auv_torchrl.vehicle import Vehicle
from auv_torchrl.yaml_file import read_yaml

LEARNT = 0.8  # of each episode, where no test log is given and there are too few episodes to hold one out
HELD_OUT = 3  # episodes from which the last one is held out instead
START_S = 1.0  # s of samples from which the state at the start of a prediction is estimated
ROUNDING_S = 0.1  # s: cuts fall on samples and on grid steps
TOGETHER = ("x", "y", "yaw")  # a horizontal position says nothing of the body without the other one and the heading


def followed_axes(name: str, axes: tuple[str, ...]) -> tuple[tuple[str, ...], list[Finding]]:
    """The axes without horizontal positions whose partner or heading is missing, and accelerations without an attitude.

    Findings say so. A degree of tilt is 0.17 m/s^2 of what is felt.

    Raises:
        FlightLogError: if no axis is left.
    """
    left, findings = axes, []
    for lost, sentence, remedy in _not_followed(axes):
        left = tuple(axis for axis in left if axis not in lost)
        if not left:
            raise FlightLogError(f"{name}: {sentence}, and nothing else is measured. {remedy}")
        findings.append(Finding(Severity.WARNING, "axes_not_followed", f"{sentence}; left out", remedy, lost))
    return left, findings


def _not_followed(axes: tuple[str, ...]) -> Iterable[tuple[tuple[str, ...], str, str]]:
    felt = tuple(axis for axis in ACCELERATION if axis in axes)
    if felt and not {"roll", "pitch"} <= set(axes):
        why = "without roll and pitch: nothing tells along which of them the weight is"
        yield felt, f"{', '.join(felt)} cannot be used {why}", "Log roll and pitch too"
    placed = tuple(axis for axis in ("x", "y") if axis in axes)
    if placed and (missing := ", ".join(axis for axis in TOGETHER if axis not in axes)):
        why = f"without {missing}: forces act along the body, wherever it points"
        yield placed, f"{' and '.join(placed)} cannot be used {why}", f"Log {missing} too, or body velocities u, v, r"


def refuse_errors(logs: Sequence[FlightLog]) -> None:
    """Refuse logs of which the check says that they cannot be what they should.

    Raises:
        FlightLogError: naming log and error.
    """
    errors = [f"{flight.name}: {f}" for flight in logs for f in flight.findings if f.severity is Severity.ERROR]
    if errors:
        raise FlightLogError(f"{'; '.join(errors)} Or give trust_log=true to diagnose it as it is")


def begins(understood: Understood, path: Path, vehicle: Vehicle | None = None) -> tuple[tuple[str, ...], list[Finding]]:
    """The axes of which a diagnosis begins with a table and the default settings, without the columns it refuses,
    and what it says of axes that it leaves out.

    Without a ``vehicle``, what depends on it is not checked: the number of thrusters, frames and units.

    Raises:
        FlightLogError: if none begins, as the diagnosis says it.
    """
    extra = understood.refused
    if vehicle is None:
        usable = find_usable(replace(understood, table=without(understood.table, extra)))
        axes, durations = usable.axes, [float(stretch.t[-1] - stretch.t[0]) for stretch in usable.stretches]
    else:
        log = read_flightlog(path, vehicle, extra)
        refuse_errors([log])
        axes, durations = log.axes, [episode.duration for episode in log.episodes]
    axes, findings = followed_axes(understood.table.name, axes)
    settings = read_yaml(CONF / "diagnosis" / "default.yaml", "diagnosis")
    check_durations(understood.table.name, durations, settings["lead_s"], settings["window_s"])
    return axes, findings


class Shortest(NamedTuple):
    """Seconds that an episode must last at least."""

    learn: float  # to learn from it
    predict: float  # to predict it
    both: float  # to learn from its first part and predict the last


def shortest(lead_s: float, window_s: float) -> Shortest:
    """What a diagnosis with these settings needs."""
    learn, predict = lead_s + window_s, lead_s + START_S
    return Shortest(learn, predict, max(learn / LEARNT, predict / (1 - LEARNT)) + ROUNDING_S)


def check_durations(name: str, durations: Sequence[float], lead_s: float, window_s: float) -> None:
    """Refuse stretches without a pause that are too short to learn from and to predict, whatever their samples.

    Raises:
        FlightLogError: naming which one is too short, and how long it must be.
    """
    least = shortest(lead_s, window_s)
    if len(durations) < HELD_OUT:
        lasts, needed, which = max(durations), least.both, "its longest stretch without a pause"
    elif durations[-1] < least.predict:
        lasts, needed, which = durations[-1], least.predict, "the last stretch without a pause, which is held out,"
    else:
        lasts, needed, which = max(durations[:-1]), least.learn, "the longest stretch without a pause before the last"
    if lasts < needed - ROUNDING_S:
        raise FlightLogError(f"{name} is too short: {which} lasts {lasts:.1f} s: give {needed:.1f} s or more")
