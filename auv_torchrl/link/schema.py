"""Types of everything in conf/sim.yaml: a misspelt key or a wrong type is an error."""

from dataclasses import dataclass, field
from typing import Annotated, Any

from omegaconf import MISSING

from auv_torchrl.command.scenario_schema import ScenarioSchema
from auv_torchrl.settings import In, Seed


@dataclass
class StartSchema:
    """Where the vehicle rests before it is flown."""

    north: Annotated[float, In("[-900, 900]", "m")] = MISSING  # a vehicle 1,000 m away counts as diverged
    east: Annotated[float, In("[-900, 900]", "m")] = MISSING
    down: Annotated[float, In("[-10, 900]", "m")] = MISSING
    yaw: Annotated[float, In("[-6.3, 6.3]", "rad")] = MISSING
    held: bool = MISSING


@dataclass
class SimSchema:
    """Types of ``conf/sim.yaml``; the comments are there."""

    vehicle: dict[str, Any] = MISSING
    scenario: ScenarioSchema = field(default_factory=ScenarioSchema)
    bind: str = MISSING
    elsewhere: bool = MISSING
    outputs: Any = MISSING
    start: StartSchema = MISSING
    seed: Seed = MISSING
    paced: bool = MISSING
    until_s: Annotated[float | None, In("(0, inf)", "s")] = MISSING
    rerun: Any = MISSING
    output: str | None = MISSING


SCHEMAS = {"sim_schema": SimSchema}  # by the name that conf/sim.yaml gives it
