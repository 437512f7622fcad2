"""A dive by hand: sticks and modes drawn from a seed, in simulated time, as a ground station sends them."""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from auv_torchrl.fly.channels import Channels, Interface
from auv_torchrl.fly.known import MANUAL
from auv_torchrl.fly.mavlink import LAYOUTS, Message, text_of
from auv_torchrl.fly.talk import ARM, AUTOPILOT, INTERVAL, Talk
from benchmarks.trial.stack import Stack

log = logging.getLogger(__name__)

STABILIZE, ALT_HOLD = 0, 2  # numbers of ArduSub's modes; the third is MANUAL
MODES = (MANUAL, STABILIZE, ALT_HOLD)
STARTED_S, LOCATED_S = 35.0, 120.0  # simulated, in which the firmware starts; until it knows where it is
ARMED_S, SET_S = 60.0, 20.0  # within which it arms, and takes parameters
WRITTEN_S = 4.0  # until its log is written
_EVERY_S = 0.05
_SYSTEM = 255  # the number of a ground station that ArduSub obeys
_HOLDS_S = 0.8, 3.0  # of a stick
_NEUTRAL = 0.35  # share of holds in which a stick is centred
# How far it is moved, by the frame. With the righting moments that are published for these two vehicles a quarter of
# the thrust ahead overturns the one that nobody levels, half of it the one that cannot hold its pitch.
_LARGEST = {
    1: {MANUAL: 0.12, STABILIZE: 0.28, ALT_HOLD: 0.28},
    2: {MANUAL: 0.12, STABILIZE: 0.5, ALT_HOLD: 0.5},
}
_MOVED_S = 0.3  # time constant of a hand
_SHALLOW_M, _DEEP_M, _PUSH = (15.0, 17.0), (25.0, 23.0), 0.5  # where the pilot heeds the depth, from and until when
_REAL32 = 9  # MAV_PARAM_TYPE
_AXES = 4  # surge, sway, heave, yaw


class Refused(RuntimeError):
    """The firmware does not arm, or not change its mode; the message is what it says."""


@dataclass(frozen=True)
class Sticks:
    """What the pilot does: positions of sticks by time, and modes."""

    ends: tuple[np.ndarray, ...]  # s, of the holds of each axis
    holds: tuple[np.ndarray, ...]
    modes: tuple[int, ...]
    seconds: float
    largest: Mapping[int, float]  # by mode

    def at(self, time_s: float) -> list[float]:
        """(4,) surge, sway, heave and yaw in [-1, 1]."""
        most = self.largest[self.mode_at(time_s)]
        held = [holds[np.searchsorted(ends, time_s)] for ends, holds in zip(self.ends, self.holds, strict=True)]
        return [most * float(share) for share in held]

    def mode_at(self, time_s: float) -> int:
        """The mode, each for the same time."""
        return self.modes[min(int(len(self.modes) * time_s / self.seconds), len(self.modes) - 1)]


def draw_sticks(rng: np.random.Generator, seconds: float, frame: int) -> Sticks:
    """A pilot who tries all axes, in each of the modes, without overturning a healthy vehicle."""
    count = int(seconds / _HOLDS_S[0]) + 2
    ends = tuple(np.cumsum(rng.uniform(*_HOLDS_S, count)) for _ in range(_AXES))
    holds = tuple(
        np.where(rng.random(count + 1) < _NEUTRAL, 0.0, rng.uniform(-1.0, 1.0, count + 1)) for _ in range(_AXES)
    )
    return Sticks(ends, holds, tuple(rng.permutation(MODES).tolist()), seconds, _LARGEST[frame])


class Diver:
    """A ground station at a stack.

    Args:
        stack: firmware and vehicle.
    """

    def __init__(self, stack: Stack):
        self.stack, self.texts = stack, []
        self.down_m: float | None = None  # once the firmware knows
        self.talk = Talk(stack, _SYSTEM, silent=False)
        self.talk.hear = self._hear
        self._beat_s, self._recovers = 0.0, 0.0

    def _hear(self, message: Message, received: float) -> None:
        if message.name == "STATUSTEXT":
            self.texts.append(text_of(message.fields["text"]))
        elif message.name == "LOCAL_POSITION_NED":
            self.down_m = message.fields["z"]

    def begin(self, let_down_s: float = 0.0) -> None:
        """Let the firmware start, and find out where it is.

        Args:
            let_down_s: when the vehicle is where it is let go.

        Raises:
            Refused: where it does not say.
        """
        self.wait(STARTED_S)
        if self.talk.heard is None:
            raise Refused("no heartbeat")
        while self.down_m is None or self.stack.now() < let_down_s:
            if self.stack.now() > LOCATED_S:
                raise Refused(f"no position: {'; '.join(self.texts[-3:])}")
            self.talk.send(self.talk.command(INTERVAL, LAYOUTS["LOCAL_POSITION_NED"].number, 100_000))
            self.wait(1.0)

    def wait(self, seconds: float) -> None:
        """Let time go by, with heartbeats and centred sticks, without which ArduSub disarms after 3 s."""
        end = self.stack.now() + seconds
        while self.stack.now() < end:
            self._beat()
            self._move((0.0,) * _AXES, Channels(Interface.RC))
            self.talk.listen(min(self.stack.now() + 0.5, end))

    def set(self, parameters: Mapping[str, float]) -> None:
        """Set parameters, as a ground station does.

        Raises:
            Refused: for those that do not come back as they were set.
        """

        def open_ones() -> Iterator[bytes]:
            for name, value in parameters.items():
                if self.talk.parameters.get(name) != value:
                    to = {"target_system": self.talk.vehicle, "target_component": AUTOPILOT}
                    told = {"param_value": value, "param_id": name.encode(), "param_type": _REAL32}
                    yield self.talk.bytes_of("PARAM_SET", **to, **told)

        if not self.talk.ask(open_ones, SET_S):
            raise Refused(f"parameters {', '.join(parameters)} were not taken")

    def arm(self, mode: int) -> None:
        """Choose a mode and arm.

        Raises:
            Refused: where that does not happen, with what the firmware says.
        """
        self._until(lambda: self.talk.mode(mode), lambda: self._mode == mode, f"mode {mode}")
        self._until(lambda: self.talk.command(ARM, 1.0), lambda: self.armed, "arming")

    def disarm(self) -> None:
        """Disarm, and wait until the log is written.

        Raises:
            Refused: where that does not happen.
        """
        self._until(lambda: self.talk.command(ARM, 0.0), lambda: not self.armed, "disarming")
        self.wait(WRITTEN_S)

    def push(self, wanted: Sequence[float], seconds: float) -> None:
        """Keep the sticks (4,) where they are."""
        end = self.stack.now() + seconds
        while self.stack.now() < end:
            self._move(wanted, Channels(Interface.RC))
            self._beat()
            self.talk.listen(self.stack.now() + _EVERY_S)

    @property
    def armed(self) -> bool:
        """Whether its thrusters may turn."""
        return self.talk.heard is not None and self.talk.heard.armed

    @property
    def _mode(self) -> int | None:
        return None if self.talk.heard is None else self.talk.heard.mode

    def fly(self, sticks: Sticks, scale: Sequence[float]) -> None:
        """Fly a dive from arming to disarming.

        Args:
            sticks: what to do.
            scale: (4,) as ``fly.known.scale_of`` has it.

        Raises:
            Refused: where the firmware does not arm.
        """
        channels = Channels(Interface.RC, tuple(scale))
        self.arm(sticks.modes[0])
        begun, hand = self.stack.now(), np.zeros(_AXES)
        while (time_s := self.stack.now() - begun) < sticks.seconds:
            if sticks.mode_at(time_s) != self._mode:
                self.talk.send(self.talk.mode(sticks.mode_at(time_s)))
            wanted = sticks.at(time_s)
            wanted[2] = self._heeding_depth(wanted[2])
            hand += (wanted - hand) * _EVERY_S / _MOVED_S
            self._move(hand.tolist(), channels)
            self._beat()
            self.talk.listen(self.stack.now() + _EVERY_S)
            if not self.armed:
                raise Refused(f"disarmed after {time_s:.0f} s: {'; '.join(self.texts[-3:])}")
        self.disarm()

    def _move(self, wanted: Sequence[float], channels: Channels) -> None:
        if self.talk.vehicle is None:
            return
        sent = channels.sent(wanted, 1.0)
        to = {"target_system": self.talk.vehicle, "target_component": AUTOPILOT}
        self.talk.send(self.talk.bytes_of(sent.name, **to, **sent.fields))

    def _heeding_depth(self, heave: float) -> float:
        """The stick of a pilot who stays clear of the surface and of the bottom; down is positive."""
        assert self.down_m is not None
        if self._recovers:
            over = self.down_m > _SHALLOW_M[1] if self._recovers > 0 else self.down_m < _DEEP_M[1]
            self._recovers = 0.0 if over else self._recovers
        elif self.down_m < _SHALLOW_M[0]:
            self._recovers = _PUSH
        elif self.down_m > _DEEP_M[0]:
            self._recovers = -_PUSH
        return self._recovers or heave

    def _beat(self) -> None:
        if self.stack.now() - self._beat_s >= 1.0:
            self._beat_s = self.stack.now()
            self.talk.send(self.talk.heartbeat())

    def _until(self, question: Callable[[], bytes], answered: Callable[[], bool], what: str) -> None:
        end = self.stack.now() + ARMED_S
        while not answered():
            if self.stack.now() >= end:
                raise Refused(f"{what} was refused: {'; '.join(self.texts[-3:])}")
            self.talk.send(question())
            self._beat()
            self.talk.listen(self.stack.now() + 0.5)
