"""Types of everything in conf/fly.yaml: a misspelt key or a wrong type is an error."""

from dataclasses import dataclass
from typing import Annotated, Any

from omegaconf import MISSING

from auv_torchrl.settings import In, OneOf


@dataclass
class LimitsSchema:
    """Within which the vehicle is flown."""

    shallowest_m: Annotated[float, In("[-10, 11000]", "m")] = MISSING
    deepest_m: Annotated[float, In("[-10, 11000]", "m")] = MISSING
    radius_m: Annotated[float, In("(0, 1000]", "m")] = MISSING
    fastest_m_s: Annotated[float, In("(0, 20]", "m/s")] = MISSING
    fastest_rad_s: Annotated[float, In("(0, 20]", "rad/s")] = MISSING
    authority: Annotated[float, In("(0, 1]")] = MISSING


@dataclass
class FlySchema:
    """Types of ``conf/fly.yaml``; the comments are there."""

    connection: str = MISSING
    policy: str = MISSING
    task: Any = MISSING
    adapted: bool = MISSING
    arm: bool = MISSING
    dry_run: bool = MISSING
    elsewhere: bool = MISSING
    interface: Annotated[str, OneOf(("rc", "manual"))] = MISSING
    source: Annotated[str, OneOf(("local", "odometry", "vision"))] = MISSING
    limits: LimitsSchema = MISSING
    system: Annotated[int, In("[1, 255]")] = MISSING
    firmware: str | None = MISSING
    until_s: Annotated[float | None, In("(0, inf)", "s")] = MISSING
    output: str | None = MISSING


SCHEMAS = {"fly_schema": FlySchema}  # by the name that conf/fly.yaml gives it
