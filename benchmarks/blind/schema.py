"""Types and ranges of what conf/blind.yaml holds."""

from dataclasses import dataclass
from typing import Annotated

from hydra.core.config_store import ConfigStore
from omegaconf import MISSING, OmegaConf

from auv_torchrl.settings import In, OneOf, Seed
from benchmarks.blind.flights.sensor_sets import SENSOR_SETS


@dataclass
class BlindSchema:
    """The comments are in ``conf/blind.yaml``."""

    cases: Annotated[int, In("[1, 100000]")] = MISSING
    seed: Seed = MISSING
    workers: Annotated[int, In("[1, 1024]")] | None = MISSING
    folder: str = MISSING
    publish: str | None = MISSING
    sensors: Annotated[str, OneOf(tuple(SENSOR_SETS))] | None = MISSING
    strangers: Annotated[int, In("[1, 100]")] | None = MISSING
    families: dict[str, float] = MISSING
    set_families: dict[str, float] = MISSING
    stranger_families: dict[str, float] = MISSING


CASES, CASES_OF_A_PART = 430, 40  # where the command line says no number


def register() -> None:
    """Make the schema known to Hydra as ``blind_schema``, and how many cases its parts have."""
    ConfigStore.instance().store("blind_schema", BlindSchema)
    OmegaConf.register_new_resolver("cases_of", lambda *parts: CASES_OF_A_PART if any(parts) else CASES, replace=True)
