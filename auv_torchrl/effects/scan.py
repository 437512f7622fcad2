"""Which values of an effect the diagnosis tries before it fits."""

from dataclasses import dataclass
from typing import Annotated

from auv_torchrl.settings import Entries


@dataclass(frozen=True)
class Scan:
    """Values of one parameter that are tried, for each thruster or degree of freedom that it has one for."""

    values: Annotated[tuple[float, ...], Entries(1, 1000)]
    linear: bool = False  # the mark grows in proportion to the value: one value tells all
    all: bool = False  # also for all thrusters or degrees of freedom at once
    relative: bool = False  # values are times the nominal one


TIMES = (0.4, 0.6, 0.8, 1.25, 1.6, 2.4)  # a scale of what a sensor reports ...
TURNED_TIMES = (-1.0, 0.5, 0.8, 1.25, 1.6, 2.4)  # ... or one that may report it with the other sign
DELAYS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7)  # s
