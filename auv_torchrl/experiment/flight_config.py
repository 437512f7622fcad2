"""Settings of the flights during which the vehicle changes."""

import math
from dataclasses import dataclass
from typing import Annotated

from auv_torchrl.adaptation.config import SETTLED_S
from auv_torchrl.settings import In, check_fields


@dataclass(frozen=True)
class FlightConfig:
    """``flight`` in ``conf/train.yaml``, which explains the values; there are no defaults elsewhere.

    Raises:
        ValueError: for times that do not fit into each other, saying which do.
    """

    fly: bool
    length_s: Annotated[float, In("(0, 3600]")]
    fault_s: Annotated[tuple[float, float], In("(0, 3600]")]

    def __post_init__(self) -> None:
        """Refuse faults before the start or so late that no recovery could be seen."""
        check_fields(self, "flight")
        earliest, latest = self.fault_s
        if not earliest <= latest:
            raise ValueError(f"flight.fault_s is {list(self.fault_s)}: give two times, 0 < earliest <= latest")
        self.check_end(latest, "flight.fault_s ends")

    def check_end(self, last_change_s: float, what: str) -> None:
        """Refuse a flight that ends less than 10 s after ``last_change_s``; ``what`` says what comes then."""
        if not last_change_s + SETTLED_S <= self.length_s < math.inf:
            raise ValueError(
                f"flight: {what} at {last_change_s:g} s and flight.length_s is {self.length_s:g}: "
                f"give {last_change_s + SETTLED_S:g} or more, or flight.fly=false"
            )
