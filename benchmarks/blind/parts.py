"""The parts of the benchmark: which cases are flown, and which tables are read.

The main part flies every family; a set of sensors and strangers are parts of their own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omegaconf import DictConfig

from benchmarks.blind.flights.cases import Case, draw_cases
from benchmarks.blind.flights.strangers import draw_stranger_cases, healthy_flights
from benchmarks.blind.scores.judge import Judgement
from benchmarks.blind.scores.score import tables
from benchmarks.blind.scores.score_sensors import set_tables
from benchmarks.blind.scores.score_strangers import stranger_tables
from benchmarks.blind.scores.table import Table


@dataclass(frozen=True)
class Part:
    """The main part, that of a set of sensors, or that of strangers with some healthy flights each."""

    shares: Mapping[str, float]  # of families
    sensors: str | None = None
    strangers: int | None = None

    @staticmethod
    def of(config: DictConfig) -> "Part":
        """The part that is asked for.

        Raises:
            ValueError: for two of them at once.
        """
        if config.sensors is not None and config.strangers is not None:
            raise ValueError("sensors and strangers are parts of their own: set one of them to null")
        families = config.families
        if config.sensors is not None:
            families = config.set_families
        if config.strangers is not None:
            families = config.stranger_families
        shares = {str(name): float(share) for name, share in families.items()}
        return Part(shares, config.sensors, config.strangers)

    @property
    def asked(self) -> dict[str, Any]:
        """The settings that ask for it; none for the main part."""
        given = {"sensors": self.sensors, "strangers": self.strangers}
        return {name: value for name, value in given.items() if value is not None}

    @property
    def name(self) -> str | None:
        """Of its folder and of its place in a document; None for the main part."""
        return self.sensors if self.strangers is None else f"strangers_{self.strangers}"

    def draw(self, cases: int, seed: int) -> list[Case]:
        """What is to be flown, the same for the same arguments."""
        if self.strangers is None:
            return draw_cases(cases, self.shares, seed, self.sensors)
        drawn = draw_stranger_cases(cases, self.shares, seed)
        return [*drawn, *healthy_flights(drawn, self.strangers)]

    def tables(self, judgements: Sequence[Judgement]) -> list[Table]:
        """All tables: first what the project asks for with what was measured, last the cases that fail."""
        if self.strangers is not None:
            return stranger_tables(judgements, self.strangers)
        return tables(judgements) if self.sensors is None else set_tables(judgements, self.sensors)
