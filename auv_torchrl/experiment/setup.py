"""From a composed config to checked objects, before anything is computed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from omegaconf import DictConfig, OmegaConf
from tensordict import TensorDict

from auv_torchrl.adaptation import AdaptationConfig
from auv_torchrl.agents.config import AgentConfig, FineTuning, read_agent
from auv_torchrl.agents.loggers import LoggerConfig
from auv_torchrl.authority import check_control
from auv_torchrl.compensation.diagnosed import Diagnosed, read_diagnosed
from auv_torchrl.compensation.excitation import Excitation
from auv_torchrl.ddr.config import AdapterConfig
from auv_torchrl.diagnosis.calibrate.parameters import read_uncertainty
from auv_torchrl.diagnosis.calibrate.vehicle_file import read_calibration
from auv_torchrl.envs import FleetEnv, make_fleet
from auv_torchrl.envs.randomize import TOGETHER, read_ranges
from auv_torchrl.evaluation import STEADY_FROM_S, draw_starts
from auv_torchrl.experiment.flight_config import FlightConfig
from auv_torchrl.experiment.schedule import schedule
from auv_torchrl.experiment.schema import TrainSchema
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.settings import check, settings_of
from auv_torchrl.tasks import Task, cruise_speed, fitted, read_task
from auv_torchrl.vehicle import Vehicle, load_vehicle

UNCERTAINTY = "uncertainty"  # of a randomization: standard deviations to each side


@dataclass(frozen=True)
class Experiment:
    """Everything that a run needs, checked."""

    vehicle_name: str
    vehicle: Vehicle  # nominal, no batch
    scenario: Scenario
    task: Task  # of the training
    exam: Task  # of the evaluation: the same with starts in the box
    starts: TensorDict
    randomization: Mapping[str, Any]
    agent: AgentConfig
    adapter: AdapterConfig
    adaptation: AdaptationConfig
    flight: FlightConfig
    diagnosed: Diagnosed | None  # what the controller is to be closed with
    diagnose: bool  # or whether to find out
    excitation: Excitation
    tuning: FineTuning
    logger: LoggerConfig
    backend: str
    device: str
    seed: int
    starts_seed: int
    box_m: float
    policies: Path

    @property
    def target(self) -> Vehicle:
        """The vehicle when the last effect of the scenario has begun, no batch."""
        begun = max((change.start_s for change in self.scenario.changes), default=0.0)
        return self.scenario.vehicle_at(self.vehicle, begun)

    def fleet(
        self,
        count: int,
        scenario: Scenario | None = None,
        thruster_commands: bool = False,
        episode_s: float | None = None,
    ) -> FleetEnv:
        """Vehicles with the changes of a scenario, None for none; actions are as in the task, or thruster commands.

        Episodes are as long as in training unless ``episode_s`` says otherwise.
        """
        to_thrusters = thruster_commands or self.exam.thruster_commands
        exam = replace(self.exam, thruster_commands=to_thrusters, episode_s=episode_s or self.exam.episode_s)
        return make_fleet(
            self.backend, self.vehicle, exam, count, scenario=scenario, seed=self.seed, device=self.device
        )


def _check_channels(task: Task, scenario: Scenario) -> None:
    if task.thruster_commands and scenario.changes:
        raise ValueError(
            "task.thruster_commands is true, and what adapts to a changed vehicle maps channels: "
            "give task.thruster_commands=false, or fly the nominal vehicle, without +scenario"
        )


def read_experiment(config: DictConfig, scenario_name: str) -> Experiment:
    """Check a composed config.

    Raises:
        ValueError: for a value that cannot work, naming it and what to give.
    """
    check(TrainSchema, {name: config[name] for name in ("seed", "starts", "starts_seed", "box_m")})
    vehicle = load_vehicle(_plain(config.vehicle))
    task = fitted(read_task(_plain(config.task)), vehicle)
    if task.episode_s <= STEADY_FROM_S:
        raise ValueError(
            f"task.episode_s is {task.episode_s:g}: errors are averaged from {STEADY_FROM_S:g} s: give more"
        )
    vehicle_name = str(config.vehicle.get("name", "unnamed"))
    exam = task.for_evaluation(config.box_m)
    _check_device(config.device)
    randomization = spelt_out(_plain(config.randomization), _plain(config.vehicle), vehicle)
    read_ranges(vehicle, randomization)
    if Path(config.policies).is_file():
        raise ValueError(f"policies is {config.policies!r}: it is a file: give a folder")
    scenario = read_scenario(scenario_name, _plain(config.scenario), vehicle)
    diagnosed = None
    if config.diagnosis_file is not None:
        diagnosed = read_diagnosed(Path(config.diagnosis_file), vehicle, vehicle_name)
        scenario = scenario if scenario.changes else diagnosed.scenario
    _check_closing(diagnosed, config.diagnose, scenario)
    _check_channels(task, scenario)
    check_control(vehicle, task.name, task.needs, not task.thruster_commands, vehicle_name, cruise_speed(task))
    flight = settings_of(FlightConfig, _plain(config.flight), "flight")
    if flight.fly and scenario.changes:
        schedule(scenario, vehicle, flight, config.starts, config.starts_seed, task.control_dt)
    return Experiment(
        vehicle_name=vehicle_name,
        vehicle=vehicle,
        scenario=scenario,
        task=task,
        exam=exam,
        starts=draw_starts(exam, config.starts, config.starts_seed),
        randomization=randomization,
        agent=read_agent(_plain(config.agent)),
        adapter=AdapterConfig(**_plain(config.adapter)),
        adaptation=AdaptationConfig(**_plain(config.adaptation)),
        flight=flight,
        diagnosed=diagnosed,
        diagnose=config.diagnose,
        excitation=Excitation(**_plain(config.excitation)),
        tuning=FineTuning(**_plain(config.tuning)),
        logger=LoggerConfig(**_plain(config.logger)),
        backend=config.backend.name,
        device=config.device,
        seed=config.seed,
        starts_seed=config.starts_seed,
        box_m=config.box_m,
        policies=Path(config.policies),
    )


def _plain(node: Any) -> Any:
    return OmegaConf.to_container(node, resolve=True, throw_on_missing=True)


def _check_closing(diagnosed: Diagnosed | None, diagnose: bool, scenario: Scenario) -> None:
    if diagnosed is not None and diagnose:
        raise ValueError("diagnosis is given and diagnose=true would make another: give one of them")
    if diagnosed is not None and not diagnosed.found:
        raise ValueError("the diagnosis found no effect: there is nothing to put into the simulator")
    if diagnose and not scenario.changes:
        raise ValueError("diagnose=true flies a simulated target: give +scenario=..., or diagnosis=... of a real one")


def _check_device(device: str) -> None:
    available, other = ["cpu"], torch.accelerator.current_accelerator(check_available=True)
    if other is not None:
        available += [other.type, *(f"{other.type}:{i}" for i in range(torch.accelerator.device_count()))]
    if device not in available:
        raise ValueError(f"device is {device!r}: there are {', '.join(available)}")


def spelt_out(ranges: Mapping[str, Any], content: Mapping[str, Any], vehicle: Vehicle) -> dict[str, Any]:
    """A randomization in which ``uncertainty: 2.0`` is replaced by the ranges that it stands for.

    Args:
        ranges: as in ``conf/randomization``; the effects in it stand beside those of the vehicle's file.
        content: the vehicle's file.
        vehicle: that it describes, empty batch.

    Raises:
        ValueError: for a file that says nothing is uncertain, or no positive number.
    """
    given = dict(ranges)
    if UNCERTAINTY not in given:
        return given
    widths = given.pop(UNCERTAINTY)
    if isinstance(widths, bool) or not isinstance(widths, int | float) or not 0 < widths < float("inf"):
        raise ValueError(f"randomization.{UNCERTAINTY} is {widths!r}: give a number of standard deviations above 0")
    coefficients = read_uncertainty(content.get("uncertainty"), vehicle)
    if not coefficients:
        raise ValueError(
            f"randomization.{UNCERTAINTY}: the file of vehicle={content.get('name', 'unnamed')} says nothing is "
            "uncertain: give randomization=default, or a vehicle with a section uncertainty"
        )
    kept = read_calibration(content.get("calibration"), coefficients)
    taken = [place for place, c in enumerate(coefficients) if c.effect not in given]
    found: dict[str, Any] = {}
    for c in (coefficients[place] for place in taken):
        low, high = c.nominal - widths * c.width, c.nominal + widths * c.width
        found.setdefault(c.effect, {})[c.member] = [max(low, c.low), min(high, c.high)]
    found |= given
    return found if kept is None or not taken else {**found, TOGETHER: _triangle(kept.together, taken)}


def _triangle(root: np.ndarray, taken: Sequence[int]) -> list[list[float]]:
    """Of some of the numbers, the lower triangle (rows of 1, 2, ...) that makes their correlation."""
    some = root[list(taken)]
    lower = np.transpose(np.linalg.qr(some.T, mode="r"))
    lower = lower * np.where(np.diag(lower) < 0, -1.0, 1.0)
    return [row[: i + 1] for i, row in enumerate(lower.tolist())]
