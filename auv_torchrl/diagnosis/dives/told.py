"""What is followed from dive to dive, and what one dive tells of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import Finding
from auv_torchrl.vehicle import Vehicle

NOISE = "noise"  # stands for an effect where a number is how noisy a channel is
# Of its bounds, that a number which is the day's and not the vehicle's may be away by: a current of 0.4 m/s, not one of
# the 2 cm/s that it differs by in one tank.
OF_THE_DAY = 0.1
NOISE_WIDTH = 1.0  # e-fold, by which a sensor may become noisier


@dataclass(frozen=True)
class Number:
    """One number of a vehicle, counted from what it is in the reference dives."""

    effect: str
    member: str
    nominal: float  # what its deviations are counted from: 1 for a factor
    unit: str
    width: float  # standard deviation by which it may change
    is_daily: bool = False  # whether it is the day's rather than the vehicle's, as a current is
    is_rough: bool = False  # whether slopes do not tell what it does

    @property
    def key(self) -> str:
        """Its name in files."""
        return f"{self.effect}.{self.member}"

    @property
    def watched(self) -> bool:
        """Whether a change of it is one of the vehicle, and can be seen."""
        return not self.is_daily and not self.is_rough


def number_of(
    effect: str, member: str, nominal: float, vehicle: Vehicle, file_width: float = 0.0, rough: bool = False
) -> Number:
    """A number of a vehicle's effect.

    Args:
        effect: in the registry.
        member: of its parameters.
        nominal: at which it does nothing.
        vehicle: calibrated, empty batch.
        file_width: standard deviation by which the vehicle's own file says that it may be off.
        rough: slopes do not tell what it does.
    """
    p = EFFECTS[effect].member_parameters(vehicle)[member]
    width = max(p.guessed_within(vehicle, member), file_width)
    daily = not width  # what no file can have wrong
    return Number(effect, member, nominal, p.unit, width or OF_THE_DAY * (p.high - p.low), daily, rough)


def number_of_noise(channel: str) -> Number:
    """How noisy a channel is, as the logarithm of a factor."""
    return Number(NOISE, channel, 1.0, "1", NOISE_WIDTH)


@dataclass(frozen=True)
class Dive:
    """What one log tells of the numbers (k,) of a vehicle: chi-square is ``a A a - 2 h a`` and a constant."""

    name: str
    A: Floats  # (k, k)
    h: Floats  # (k,)
    noise: Mapping[str, float]  # standard deviation by channel
    excess: float | None  # chi-square per measured number, left with all numbers free; None where nothing was read
    seconds: float = 0.0
    begun: str = ""  # date and time, where the name of its file has one
    findings: tuple[Finding, ...] = ()
    refused: str = ""  # why nothing was read from it; then the rest says nothing

    def explained(self, most: float) -> bool:
        """Whether no more than ``most`` is left; of a log that was not read nothing is."""
        return self.excess is None or not self.excess > most

    @staticmethod
    def unread(name: str, why: str, k: int, begun: str = "") -> "Dive":
        """A log that tells nothing of k numbers."""
        return Dive(name, np.zeros((k, k)), np.zeros(k), {}, None, begun=begun, refused=why)


@dataclass(frozen=True)
class Normal:
    """How a sound vehicle is, as its reference dives show."""

    numbers: tuple[Number, ...]  # (k,)
    covariance: Floats  # (k, k) of what another dive of a sound vehicle may show
    noise: Mapping[str, float]  # standard deviation by channel
    findings: tuple[Finding, ...] = ()

    @cached_property
    def width(self) -> Floats:
        """(k,) by how much each number may change."""
        return np.array([number.width for number in self.numbers])

    def all_numbers(self, dives: Sequence[Dive]) -> tuple[Number, ...]:
        """Those of the vehicle, then the noise of every channel that reference and dives have."""
        seen = {channel for dive in dives for channel in dive.noise}
        return (*self.numbers, *(number_of_noise(channel) for channel in self.noise if channel in seen))
