"""A command of the policy as what a pilot sends: RC_CHANNELS_OVERRIDE or MANUAL_CONTROL, in ArduSub's mode MANUAL.

In that mode the six inputs go to the mixer as shares of full travel, without dead zone: RCn_DZ acts where the firmware
stabilises. ACRO_YAW_P scales yaw. ``MANUAL_CONTROL`` passes the pilot's gain and JS_THR_GAIN first.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

PITCH, ROLL, THROTTLE, YAW, FORWARD, LATERAL = range(1, 7)  # numbers of the inputs
CENTRE_US, SWING_US, LEAVE = 1500, 400, 65535
YAW_GAIN = 3.375  # ACRO_YAW_P at which yaw is passed on as it is: its default, since 2018
ALONG = {FORWARD: (0, 1.0), LATERAL: (1, 1.0), THROTTLE: (2, -1.0), YAW: (3, 1.0)}  # channel and sign; throttle is up


class Interface(StrEnum):
    """By which message the command is sent."""

    RC = "rc"
    MANUAL = "manual"


class Travel(NamedTuple):
    """What pulses of an input mean: RCn_MIN, RCn_TRIM, RCn_MAX, RCn_REVERSED."""

    low: float = CENTRE_US - SWING_US
    trim: float = CENTRE_US
    high: float = CENTRE_US + SWING_US
    reversed: bool = False

    def pulse(self, share: float) -> int:
        """The pulse in us of a share of full travel in [-1, 1]; 0 is the trim, wherever that lies."""
        share = -share if self.reversed else share
        return round(self.trim + share * ((self.high - self.trim) if share > 0 else (self.trim - self.low)))

    def share(self, pulse: float) -> float:
        """What the firmware makes of a pulse."""
        span = (self.high - self.trim) if pulse > self.trim else (self.trim - self.low)
        share = max(-1.0, min(1.0, (pulse - self.trim) / span))
        return -share if self.reversed else share


class Sent(NamedTuple):
    """A message, and the command that it stands for once it is rounded and limited."""

    name: str
    fields: Mapping[str, int]
    command: tuple[float, ...]  # (4,) surge, sway, heave, yaw


@dataclass(frozen=True)
class Channels:
    """Puts commands into messages.

    Args:
        interface: which message.
        scale: (4,) what a command of 1 is of the full travel of its input: the mixer of the policy's vehicle over that
            of the firmware's frame.
        travels: by number of the input.
        yaw_gain: ACRO_YAW_P.
        throttle_gain: JS_THR_GAIN.
    """

    interface: Interface
    scale: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    travels: Mapping[int, Travel] = field(default_factory=dict)
    yaw_gain: float = YAW_GAIN
    throttle_gain: float = 1.0

    def sent(self, command: Sequence[float], gain: float) -> Sent:
        """The message for a command (4,) in [-1, 1]; ``gain`` is the pilot's, which only MANUAL_CONTROL passes."""
        pulses = {number: self._travel(number).trim for number in (PITCH, ROLL)}
        for number, (channel, sign) in ALONG.items():
            share = sign * self._scale(number) * command[channel]
            pulses[number] = self._travel(number).pulse(max(-1.0, min(1.0, share)))
        if self.interface is Interface.RC:
            return self._override({number: round(pulse) for number, pulse in pulses.items()})
        return self._manual(pulses, gain)

    def _override(self, pulses: Mapping[int, int]) -> Sent:
        fields = {f"chan{number}_raw": pulses.get(number, LEAVE) for number in range(1, 9)}
        return Sent("RC_CHANNELS_OVERRIDE", fields, self._command(pulses))

    def _manual(self, pulses: Mapping[int, float], gain: float) -> Sent:
        """x, y and r in +-1000, z in 0 to 1000, neutral at 500; half the authority where the gain is a half."""
        scales = {number: 0.4 * gain for number in (FORWARD, LATERAL, YAW)}
        scales[THROTTLE] = 0.8 * gain * self.throttle_gain
        most = {THROTTLE: 500}
        values = {}
        for number, scale in scales.items():
            limit = most.get(number, 1000)
            values[number] = max(-limit, min(limit, round((pulses[number] - CENTRE_US) / scale)))
        passed = {number: CENTRE_US + scales[number] * value for number, value in values.items()}
        fields = {
            "x": values[FORWARD], "y": values[LATERAL], "z": 500 + values[THROTTLE], "r": values[YAW], "buttons": 0,
        }  # fmt: skip
        return Sent("MANUAL_CONTROL", fields, self._command(passed))

    def _command(self, pulses: Mapping[int, float]) -> tuple[float, ...]:
        found = [0.0] * len(ALONG)
        for number, (channel, sign) in ALONG.items():
            found[channel] = sign * self._travel(number).share(pulses[number]) / self._scale(number)
        return tuple(found)

    def _scale(self, number: int) -> float:
        channel, _ = ALONG[number]
        return self.scale[channel] * (YAW_GAIN / self.yaw_gain if number == YAW else 1.0)

    def _travel(self, number: int) -> Travel:
        return self.travels.get(number, Travel())


def parameters_of(number: int) -> tuple[str, ...]:
    """The parameters that say what pulses of an input mean."""
    return tuple(f"RC{number}_{name}" for name in ("MIN", "TRIM", "MAX", "REVERSED"))


def travel_of(number: int, parameters: Mapping[str, Any]) -> Travel:
    """What pulses of an input mean.

    Raises:
        ValueError: for travels that leave nothing on one side.
    """
    low, trim, high, turned = (parameters[name] for name in parameters_of(number))
    if not 800 <= low < trim < high <= 2200:
        raise ValueError(
            f"RC{number}_MIN, _TRIM and _MAX are {low:g}, {trim:g} and {high:g} us: set them in that order, "
            "as 1100, 1500 and 1900"
        )
    return Travel(low, trim, high, bool(turned))
