"""Hold runs of one manoeuvre against sound ones: from logs to answers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.alike.answer import Answer, answers
from auv_torchrl.diagnosis.alike.evidence import Told, weigh
from auv_torchrl.diagnosis.alike.marks import mark_effects, predicted
from auv_torchrl.diagnosis.alike.normal import Normal, learn_normal
from auv_torchrl.diagnosis.alike.runs import BIN_S, Runs, cut_runs
from auv_torchrl.diagnosis.alike.shakes import Quiet, find_lines, learn_quiet
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.flightlog import FlightLog
from auv_torchrl.vehicle import Vehicle


@dataclass(frozen=True)
class Alike:
    """All that is said of runs that were flown alike."""

    vehicle: str
    healthy: int  # runs that the others are held against
    channels: tuple[str, ...]
    seconds: float  # of each run
    session: float  # variance between logs, times that between runs of one
    runs: tuple[Answer, ...]
    together: Answer  # of all runs, taken to have the same fault
    cannot_tell: tuple[str, ...]  # effects that would leave no mark in these runs
    left_out: tuple[str, ...]  # too short, or with a second without samples


@dataclass(frozen=True)
class Sound:
    """The sound runs."""

    runs: Runs
    normal: Normal
    quiet: Quiet | None  # how they shake; None where no rate is measured


def learn_sound(healthy: Sequence[FlightLog], vehicle: Vehicle) -> Sound:
    """What sound runs look like; each log is a session, each episode a run.

    Raises:
        FlightLogError: for runs that are too few, too short, or measure nothing that is compared.
    """
    runs = cut_runs(healthy)
    return Sound(runs, learn_normal(runs, predicted(vehicle, runs, [{}])[0]), learn_quiet(runs))


def judge_runs(
    logs: Sequence[FlightLog], sound: Sound, vehicle: Vehicle, settings: Settings, vehicle_name: str = ""
) -> Alike:
    """What differs in runs from sound ones, in each by itself and in all together.

    Args:
        logs: whose episodes are the runs.
        sound: of the same manoeuvre.
        vehicle: as its file says, empty batch; it gives the marks of the effects, while what it has wrong about the
            sound runs is in their mean.
        settings: ``prior_none``, and what is tried.
        vehicle_name: for the answer.

    Raises:
        FlightLogError: for runs of another kind than the sound ones.
    """
    runs = cut_runs(logs, sound.runs)
    nominal, marks = mark_effects(vehicle, runs, settings)
    groups = [np.array([row]) for row in range(len(runs))] + [np.arange(len(runs))]
    told = Told(nominal, runs, find_lines(runs, sound.quiet, groups))
    weighed = weigh(told, marks, sound.normal, vehicle, settings, groups)
    *single, together = answers(weighed, marks, vehicle, groups, runs.names)
    return Alike(
        vehicle_name,
        sound.normal.count,
        runs.channels,
        runs.seen.shape[-1] * BIN_S,
        sound.normal.session,
        tuple(single),
        together,
        weighed.hidden,
        sound.runs.left_out + runs.left_out,
    )
