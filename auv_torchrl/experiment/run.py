"""The stages of one run: source policy, nominal and changed vehicle, adaptation, flight again, all in one flight."""

import logging
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path

from torchrl.envs import TransformedEnv

from auv_torchrl.agents.policy import PolicyError, SourcePolicy
from auv_torchrl.agents.storage import CheckpointError, StorageError, storing
from auv_torchrl.agents.train_source import locked, train_source
from auv_torchrl.authority import Recovery, authority
from auv_torchrl.command import checking_input
from auv_torchrl.command.chosen import NOMINAL
from auv_torchrl.compensation.command_share import command_share
from auv_torchrl.ddr import Adaptation, DDRAdapter, adapt
from auv_torchrl.ddr.config import COMPOSITIONS
from auv_torchrl.ddr.store import ADAPTER, load_or_pretrain, save_adapter
from auv_torchrl.evaluation import Metrics, fly
from auv_torchrl.experiment.closing import Closing, close_gap, stages_of
from auv_torchrl.experiment.console import Stages
from auv_torchrl.experiment.figures import DPI, save_figures
from auv_torchrl.experiment.flight_figure import flight_figure
from auv_torchrl.experiment.in_flight import InFlight, fly_in_flight
from auv_torchrl.experiment.results import Results, with_task
from auv_torchrl.experiment.setup import Experiment
from auv_torchrl.flight import Flight
from auv_torchrl.quantities import counted, words
from auv_torchrl.recording import ControlMap, record_run
from auv_torchrl.tasks import cruise_speed
from auv_torchrl.vehicle import CONTROLLED

STORE = (CheckpointError, PolicyError, StorageError)  # files that a user can mend or move away

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Outcome:
    """Numbers, flights (``nominal``, ``u_s``, ``u_t`` as far as they were flown), map and one flight of a run."""

    results: Results
    flights: Mapping[str, Flight]
    adaptation: Adaptation | None
    in_flight: InFlight | None
    closing: Closing | None


def run(experiment: Experiment, folder: Path) -> Results:
    """Everything that ``train.py`` does after its config is checked.

    Files go into ``folder``, over those of a run that was broken off there. The table is said before they are written,
    so that a full disk does not keep it.
    """
    stages = Stages(7 + stages_of(experiment))
    outcome = perform(experiment, stages)
    results, flights = outcome.results, outcome.flights
    flown = words(with_task(experiment.task.name, experiment.scenario.name))
    with stages("Results, figures and recording"):
        log.info("\n%s\n", results.table())
        results.save(folder)
        if outcome.adaptation is not None and results.policy is not None:
            save_adapter(outcome.adaptation.adapter, results.policy, folder / ADAPTER)
        if outcome.closing is not None:
            outcome.closing.save(folder, experiment)
        vehicles = {"nominal": experiment.vehicle, "u_s": experiment.target, "u_t": experiment.target}
        save_figures(folder, flights, vehicles, flown, experiment.task.axes, cruise_speed(experiment.task))
        one_flight = None
        if outcome.in_flight is not None:
            one_flight = outcome.in_flight.one_flight(experiment.vehicle)
            title = f"{flown} in flight: start {outcome.in_flight.shown + 1} of {results.starts}"
            flight_figure(one_flight, title).savefig(folder / "flight.png", dpi=DPI)
        axes, adaptation = experiment.task.axes, outcome.adaptation
        control_map = linear_map(adaptation.adapter, axes) if adaptation is not None else None
        table = results.table()
        record_run(folder / "run.rrd", flights, vehicles, table, control_map, one_flight, replace=True, axes=axes)
    return results


def perform(experiment: Experiment, stages: Stages) -> Outcome:
    """Train or load, fly, adapt and fly again, without writing anything but the kept policy."""
    scenario, count = experiment.scenario, len(experiment.starts)
    flights: dict[str, Flight] = {}
    forms: dict[str, Flight] = {}
    with stages("Source policy u_s"), checking_input(STORE):
        policy = source_policy(experiment)
    with stages(f"Fly {counted(count, 'start')} with u_s on the nominal vehicle"):
        flights["nominal"] = fly(experiment.fleet(count), policy.module, experiment.starts, experiment.exam.steps)
    reason, adaptation, in_flight, closing = None, None, None, None
    if scenario.name == NOMINAL:
        stages.skip(4, "No scenario: the vehicle stays as it is")
    else:
        with stages(f"Fly them with u_s on the vehicle with {words(scenario.name)}"):
            target = experiment.fleet(count, scenario)
            flights["u_s"] = fly(target, policy.module, experiment.starts, experiment.exam.steps)
        reason = obstacle(experiment)
        if reason is not None:
            stages.skip(2, f"No adaptation: {reason}")
        else:
            with stages("Collect target data and fit the map"):
                adaptation = fit_map(experiment, policy)
            with stages(f"Fly them with u_t on the vehicle with {words(scenario.name)}"):
                forms = {form: fly_adapted(experiment, policy, adaptation, form) for form in COMPOSITIONS}
                flights["u_t"] = forms[experiment.adapter.composition]
        in_flight = change_in_flight(experiment, policy, stages)
        with checking_input(STORE):
            closing = close_gap(experiment, policy, flights, stages)
    results = summarize(experiment, policy, flights, forms, adaptation, reason, in_flight, closing)
    return Outcome(results, flights, adaptation, in_flight, closing)


def change_in_flight(experiment: Experiment, policy: SourcePolicy, stages: Stages) -> InFlight | None:
    """The flight in which the scenario sets in, if it is wanted."""
    if not experiment.flight.fly:
        stages.skip(1, "No flight in which the vehicle changes: flight.fly is false")
        return None
    with stages(f"Fly them once more: {words(experiment.scenario.name)} sets in during the flight"):
        return fly_in_flight(experiment, policy.module)


def obstacle(experiment: Experiment) -> str | None:
    """Why no map of this kind can recover the vehicle, with the rank; None if one can."""
    verdict = authority(
        experiment.target, experiment.vehicle, experiment.scenario.name,
        experiment.task.axes, cruise_speed(experiment.task),
    )  # fmt: skip
    if verdict.recovery is Recovery.NONE:
        return str(verdict)
    if verdict.recovery is Recovery.THRUSTERS and experiment.adapter.map != "thrusters":
        return f"{verdict}: give adapter=thrusters"
    return None


def source_policy(experiment: Experiment) -> SourcePolicy:
    """Trained now, or kept from a run with the same ingredients."""
    return train_source(
        experiment.vehicle, experiment.task, experiment.agent, experiment.randomization, experiment.seed,
        experiment.backend, experiment.policies, device=experiment.device, logger=experiment.logger,
    )  # fmt: skip


def fit_map(experiment: Experiment, policy: SourcePolicy) -> Adaptation:
    """F and R of the source vehicle, then seconds of flight of a target vehicle, or one for each map, then G and H."""
    lock = experiment.policies / "models.lock"  # jobs of a sweep wait instead of training too
    with checking_input(), storing(experiment.policies), locked(lock, "learns the models"):
        models = load_or_pretrain(experiment.vehicle, experiment.task, experiment.policies)
    to_thrusters = experiment.adapter.map == "thrusters"
    seen_s = experiment.adapter.target_data_s
    if later := [time for time in experiment.scenario.switching_times() if time >= seen_s]:
        log.warning(
            "   the vehicle changes at t = %g s, the map is fitted to the first %g s and kept: it cannot know",
            later[0], seen_s,
        )  # fmt: skip
    adaptation = adapt(
        lambda count: experiment.fleet(count, experiment.scenario, to_thrusters),
        policy.module, models, experiment.adapter, len(experiment.starts),
    )  # fmt: skip
    adaptation.adapter.to("cpu")  # where it is looked at; each flight takes a copy to its fleet's device
    return adaptation


def fly_adapted(experiment: Experiment, policy: SourcePolicy, adaptation: Adaptation, composition: str) -> Flight:
    """The starts again with the fitted map, in its short or its long form."""
    fitted = adaptation.adapter
    adapter = DDRAdapter(deepcopy(fitted.models), replace(fitted.config, composition=composition), fitted.count)
    adapter.load_state_dict(fitted.state_dict())
    to_thrusters = experiment.adapter.map == "thrusters"
    fleet = experiment.fleet(len(experiment.starts), experiment.scenario, to_thrusters)
    return fly(TransformedEnv(fleet, adapter), policy.module, experiment.starts, experiment.exam.steps)


def summarize(
    experiment: Experiment,
    policy: SourcePolicy,
    flights: Mapping[str, Flight],
    forms: Mapping[str, Flight],
    adaptation: Adaptation | None,
    reason: str | None,
    in_flight: InFlight | None,
    closing: Closing | None,
) -> Results:
    """The numbers of a run."""
    metrics = {name: Metrics.of(flight) for name, flight in flights.items()}
    return Results(
        scenario=experiment.scenario.name,
        vehicle=experiment.vehicle_name,
        seed=experiment.seed,
        box_m=experiment.box_m,
        starts=len(experiment.starts),
        nominal=metrics["nominal"],
        u_s=metrics.get("u_s"),
        u_t=metrics.get("u_t"),
        u_t_forms={form: Metrics.of(flight) for form, flight in forms.items()},
        target_data_s=adaptation.target_data_s if adaptation else None,
        fit_s=adaptation.fit_s if adaptation else None,
        train_s=policy.metadata["result"]["train_s"],
        feasible=reason is None,
        reason=reason,
        policy=policy.metadata["hash"],
        in_flight=in_flight.as_dict() if in_flight else None,
        command_share=command_share(
            flights["u_s"],
            experiment.vehicle,
            experiment.exam.control_dt,
            experiment.task.axes,
            cruise_speed(experiment.task),
        )
        if "u_s" in flights
        else None,
        closed=closing.after if closing else None,
        closing=closing.as_dict() if closing else None,
        task=experiment.task.name,
    )


def linear_map(adapter: DDRAdapter, axes: tuple[str, ...] = CONTROLLED) -> ControlMap:
    """H about rest, away from the limits; of a network map its affine part, of several maps the first vehicle's."""
    g = adapter.maps[0]
    matrix = g.unlimited.double()
    offset = -matrix @ g.bias.double()
    size = matrix.shape[0]
    to_channels = adapter.config.map != "thrusters"
    rows = axes if to_channels else tuple(f"thruster {i + 1}" for i in range(size))
    return ControlMap(matrix.numpy(), offset.numpy(), rows, axes)
