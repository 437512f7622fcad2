"""Diagnose the target and close the gap: the last stages of a run that asks for it."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.command import checking_input
from auv_torchrl.compensation.close import Closed, close
from auv_torchrl.compensation.diagnosed import Diagnosed
from auv_torchrl.compensation.target_log import fly_target_log
from auv_torchrl.diagnosis import diagnose
from auv_torchrl.diagnosis.report import write_files
from auv_torchrl.evaluation import FLOOR_M, Metrics, fly
from auv_torchrl.experiment.console import Stages
from auv_torchrl.experiment.setup import Experiment
from auv_torchrl.flight import Flight
from auv_torchrl.flightlog import FlightLog, write_flightlog
from auv_torchrl.progress import Progress
from auv_torchrl.quantities import percent, quantity, words

LOG, FILES = "target_log.parquet", "diagnosis"  # in the folder of the run

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Closing:
    """What was diagnosed, and how the target flew before and after it was put into simulator and controller."""

    diagnosed: Diagnosed
    log: FlightLog | None  # of the target, if it was flown for it
    nominal: Metrics
    before: Metrics  # u_s on the target
    closed: Closed | None  # None where nothing was found
    after: Metrics | None

    @property
    def share(self) -> float | None:
        """Share of the controller's gap, u_s on the target against u_s on the nominal vehicle; None without one."""
        gap = self.before.miss_m - self.nominal.miss_m
        if self.after is None or not gap >= FLOOR_M:
            return None
        return (self.before.miss_m - self.after.miss_m) / gap

    @property
    def prediction_share(self) -> float | None:
        """Share of the simulator's gap that the diagnosis closed on held-out stretches; None without one."""
        return self.diagnosed.diagnosis.gap.closed if self.diagnosed.diagnosis else None

    @property
    def summary(self) -> str:
        """Sentences for the console."""
        concluded = self.diagnosed.diagnosis
        sentences = [f"Diagnosed: {concluded.summary}" if concluded else "Diagnosed: what was given."]
        if concluded is not None and concluded.input_mappable is not None:
            sentences.append(
                f"A map of the commands alone could close {percent(concluded.input_mappable)} of the simulator's gap."
            )
        if self.closed is None or self.after is None:
            return " ".join([*sentences, "Nothing was found to put into the simulator: the controller stays u_s."])
        gaps = (self.before.miss_m - self.nominal.miss_m, self.after.miss_m - self.nominal.miss_m)
        before, after, floor = (quantity(length, "m") for length in (*gaps, FLOOR_M))
        sentences.append(
            f"Simulator's gap closed: {_percent(self.prediction_share)}. Controller's gap closed: "
            f"{_percent(self.share)} (controller's gap {before} before, {after} after; below {floor} it is none)."
        )
        sentences.append(
            "The policy was trained on around what was found."
            if self.closed.tuned
            else "The map of the diagnosed vehicle was enough, the policy is u_s."
        )
        return " ".join(sentences)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        concluded, closed = self.diagnosed.diagnosis, self.closed
        rehearsed = closed and {
            "nominal_m": closed.nominal_m, "before_m": closed.before_m, "mapped_m": closed.mapped_m,
            "tuned_m": closed.tuned_m,
        }  # fmt: skip
        return {
            "verdict": concluded and concluded.verdict.key,
            "found": concluded and concluded.summary,
            "input_mappable": concluded and concluded.input_mappable,
            "log_s": self.log and self.log.duration,
            "rehearsed": rehearsed,
            "closed": self.after and self.after.as_dict(),
            "controller_gap_closed": self.share,
            "prediction_gap_closed": self.prediction_share,
            "tuned": closed.tuned if closed else False,
            "policy": closed.policy.metadata["hash"] if closed else None,
            "summary": self.summary,
        }

    def save(self, folder: Path, experiment: Experiment) -> None:
        """Write the log and the diagnosis, where this run made them, over those of a run that was broken off."""
        if self.log is not None and self.diagnosed.diagnosis is not None:
            write_flightlog(self.log, folder / LOG, replace=True)
            write_files(self.diagnosed.diagnosis, experiment.vehicle, folder / FILES, replace=True)


def stages_of(experiment: Experiment) -> int:
    """How many stages closing takes."""
    return 3 * experiment.diagnose + 2 * (experiment.diagnosed is not None)


def close_gap(
    experiment: Experiment, policy: SourcePolicy, flights: Mapping[str, Flight], stages: Stages
) -> Closing | None:
    """Diagnose the target where that is asked for, close the gap, fly the starts again; None if it is not wanted."""
    diagnosed, flown = experiment.diagnosed, None
    if experiment.diagnose:
        with stages(f"Fly the target for {experiment.excitation.seconds:.0f} s and diagnose the log"), checking_input():
            flown, diagnosed = look(experiment)
    if diagnosed is None:
        return None
    nominal, before = Metrics.of(flights["nominal"]), Metrics.of(flights["u_s"])
    if not diagnosed.found:
        stages.skip(2, "Nothing to close: the diagnosis found no effect")
        return Closing(diagnosed, flown, nominal, before, None, None)
    with stages("Put the effects found into simulator and controller"):
        closed = close(
            diagnosed, policy, experiment.task, experiment.box_m, experiment.agent, experiment.tuning,
            experiment.seed, experiment.backend, experiment.policies, experiment.device,
        )  # fmt: skip
    with stages(f"Fly the starts with it on the vehicle with {words(experiment.scenario.name)}"):
        fleet = closed.fleet(experiment.fleet(len(experiment.starts), experiment.scenario, thruster_commands=True))
        flight = fly(fleet, closed.policy.module, experiment.starts, experiment.exam.steps)
    return Closing(diagnosed, flown, nominal, before, closed, Metrics.of(flight))


def look(experiment: Experiment) -> tuple[FlightLog, Diagnosed]:
    """Log the target as a team would, and diagnose the log."""
    flown = fly_target_log(
        lambda task, count: replace(experiment, exam=task).fleet(count, experiment.scenario),
        experiment.vehicle,
        experiment.exam,
        experiment.excitation,
        LOG,
    )
    with Progress() as progress:
        diagnosis = diagnose(flown, experiment.vehicle, progress=progress, vehicle_name=experiment.vehicle_name)
    log.info("   %s", diagnosis.summary)
    return flown, Diagnosed.of(diagnosis, experiment.vehicle)


def _percent(share: float | None) -> str:
    return "there was none" if share is None else percent(share)
