"""Types of everything that conf/train.yaml holds, so that a misspelt key or a wrong type is an error."""

from dataclasses import MISSING as NO_DEFAULT
from dataclasses import dataclass, field, fields, make_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from omegaconf import MISSING, DictConfig, OmegaConf

from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.agents.config import AGENTS, FineTuning
from auv_torchrl.agents.loggers import LoggerConfig
from auv_torchrl.command.scenario_schema import ScenarioSchema
from auv_torchrl.compensation.excitation import Excitation
from auv_torchrl.ddr.config import AdapterConfig
from auv_torchrl.envs.make import BACKENDS
from auv_torchrl.experiment.flight_config import FlightConfig
from auv_torchrl.hydra_command.config_source import check_config_files, store_once, store_schema
from auv_torchrl.paths import ENDINGS, config_names, config_path
from auv_torchrl.scenario import scenarios_of
from auv_torchrl.settings import In, Seed
from auv_torchrl.tasks import TASKS
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.yaml_file import read_yaml

DEFAULT_RANDOMIZATION = "default"
OWN_RANDOMIZATION = "uncertainty"  # what the vehicle's file says is uncertain in it
Backend = Enum("Backend", {name: name for name in BACKENDS})


def schema_of(settings: type) -> type:
    """A writable dataclass with the fields of a frozen one, which OmegaConf would not let anyone override."""
    hints = get_type_hints(settings)
    columns = []
    for entry in fields(settings):
        default = MISSING if entry.default is NO_DEFAULT else entry.default
        columns.append((entry.name, hints[entry.name], field(default=default)))
    return make_dataclass(f"{settings.__name__}Schema", columns)


@dataclass
class TrainSchema:
    """The comments are in ``conf/train.yaml``."""

    vehicle: dict[str, Any] = MISSING
    scenario: ScenarioSchema = field(default_factory=ScenarioSchema)
    task: Any = MISSING
    randomization: dict[str, Any] = field(default_factory=dict)
    agent: Any = MISSING
    adapter: Any = field(default_factory=schema_of(AdapterConfig))
    adaptation: Any = field(default_factory=schema_of(AdaptationConfig))
    flight: Any = field(default_factory=schema_of(FlightConfig))
    diagnosis_file: str | None = None
    diagnose: bool = False
    excitation: Any = field(default_factory=schema_of(Excitation))
    tuning: Any = field(default_factory=schema_of(FineTuning))
    logger: Any = field(default_factory=schema_of(LoggerConfig))
    backend: Backend = MISSING  # type: ignore[valid-type]
    device: str = MISSING
    seed: Seed = MISSING
    starts: Annotated[int, In("[1, 10000]")] = MISSING
    starts_seed: Seed = MISSING
    box_m: Annotated[float, In("(0, 1000]")] = MISSING
    policies: str = MISSING
    output: str = MISSING


def randomization_of(vehicle: str) -> str:
    """The randomization of a vehicle: the one of its name, its own uncertainty where it was calibrated, or the default.

    A file whose uncertainty is a guess, as those of published coefficients, is no good advice to a policy.
    """
    if vehicle in config_names("randomization"):
        return vehicle
    return OWN_RANDOMIZATION if is_calibrated(vehicle) else DEFAULT_RANDOMIZATION


def swept_scenarios(vehicle: DictConfig) -> str:
    """The scenarios of a vehicle, as composed, in the form in which Hydra sweeps over them."""
    content: Any = OmegaConf.to_container(vehicle, resolve=True)
    return ",".join(scenarios_of(load_vehicle(content)))


def is_calibrated(vehicle: str) -> bool:
    """Whether the file of a vehicle, by name or path, is one that ``auv-calibrate`` wrote."""
    try:
        named = Path(vehicle).expanduser() if vehicle.endswith(ENDINGS) else config_path("vehicle", vehicle)
        return "calibration" in read_yaml(named, "vehicle")
    except (ValueError, OSError):
        return False  # Hydra says what is wrong with it


def register() -> None:
    """Make known to Hydra ``train_schema``, ``<name>_schema`` of each task and agent, and resolvers of files."""
    check_config_files()
    store_once("train_schema", TrainSchema)
    OmegaConf.register_new_resolver("randomization_of", randomization_of, replace=True)
    OmegaConf.register_new_resolver("scenarios_of", swept_scenarios, replace=True)
    for group, registry in (("task", TASKS), ("agent", AGENTS)):
        for name, kind in registry.items():
            store_schema(_named(kind, name), group, name)


@cache
def _named(kind: type, name: str) -> type:
    """The schema of a task or an agent, with the name by which it is chosen."""
    given: list[Any] = [("name", str, field(default=name))]
    return make_dataclass(f"{kind.__name__}Named", given, bases=(schema_of(kind),))
