"""How the diagnosis tries an effect: what shows it, which values are tried, and how rare it is."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Annotated

from auv_torchrl.settings import Entries
from auv_torchrl.vehicle import Vehicle

Same = tuple[str, str, float]  # effect, parameter, value


@dataclass(frozen=True)
class Scan:
    """Values of one parameter that are tried, for each thruster or degree of freedom that it has one for."""

    values: Annotated[tuple[float, ...], Entries(1, 1000)]
    linear: bool = False  # the response grows in proportion to the value: one value tells all
    all: bool = False  # also for all thrusters or degrees of freedom at once
    relative: bool = False  # values are times the nominal one


TIMES = (0.4, 0.6, 0.8, 1.25, 1.6, 2.4)  # a scale of what a sensor reports ...
TURNED_TIMES = (-1.0, 0.5, 0.8, 1.25, 1.6, 2.4)  # ... or one that may report it with the other sign
DELAYS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7)  # s


@dataclass(frozen=True)
class Valley:
    """Numbers that a log hardly tells apart where they move together: a fit of one at a time does not get along."""

    leading: str  # parameter of the effect that declares it
    beside: tuple[str, str]  # effect and parameter without which there is no valley
    moves: Callable[[Vehicle, float], dict[tuple[str, str], float]]  # of all, for a step of the leading one; batch (1,)


@dataclass(frozen=True)
class Trial:
    """How the diagnosis tries an effect; an effect that declares nothing is tried at values within its bounds."""

    scans: Mapping[str, Scan] = field(default_factory=dict)  # by parameter, values that are tried
    together: tuple[Mapping[str, float], ...] = ()  # values that are tried, of several parameters at once
    nuisance: Mapping[str, float] = field(default_factory=dict)  # by parameter, relative: what sound ones are off by
    odds: float = 1.0  # prior probability against that of other effects: how rare it is where a log cannot tell
    wears: Mapping[str, int] = field(default_factory=dict)  # by parameter, +1 or -1: which way alone it goes by itself
    same_as: Callable[[Vehicle, str, float], Same | None] | None = None  # what a value of a parameter is better called
    valley: Valley | None = None
    covers: tuple[str, ...] = ()  # effects that change what it sets, and are not looked for where it was fitted
    shows: str = ""  # what a pilot sees of it where it is fitted: "axes", "idle" or "turning", answers to commands
    shown_by: tuple[str, ...] = ()  # channels without all of which nothing shows it, and it is not looked for
    unfiltered: tuple[str, ...] = ()  # channels that show it if a sensor measured them, and not as a filter has them
    is_rough: bool = False  # its values switch single samples, so that near by ones are tried instead of slopes
    is_searched: bool = True  # whether the diagnosis looks for it; not for what other effects say in fewer numbers
    smooths: bool = False  # commands; fitted to snapshots of them it would make up for what these lack
    is_noise: bool = False  # white noise of sensors: the floor of predictions, measured, and not looked for either

    def is_asked(self, channels: Collection[str]) -> bool:
        """Whether a log with these channels is asked for the effect at all."""
        return not self.shown_by or any(channel in channels for channel in self.shown_by)

    def shows_in(self, filtered: Mapping[str, float]) -> bool:
        """Whether a log shows it of which a filter estimated some channels, by name how fast those go astray."""
        return not any(filtered.get(channel, 0.0) > 0 for channel in self.unfiltered)
