"""What may be sent to a vehicle, and when: a state machine of plain numbers, without clock, socket or policy.

Whoever flies hands over what was heard (:meth:`Safety.heartbeat`, :meth:`Safety.measured`) and what the policy wants,
and sends what :meth:`Safety.decide` gives back. Times are s on one clock that never steps back.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

STALE_S = 0.5  # s after a measurement from which on the vehicle must be neutral
GIVE_UP_S = 3.0  # s without a measurement after which the flight ends; ArduSub's own failsafe has as many
HEARTBEAT_S = 3.5  # s without a heartbeat, of which one comes every second
SETTLED = 5  # good measurements in a row before a flight begins
_JUMP_M, _JUMP_RAD = 0.5, 0.5  # by which an estimate may correct itself at once
NEUTRAL = (0.0, 0.0, 0.0, 0.0)

Vector = tuple[float, ...]


class Motion(NamedTuple):
    """A measured state: earth NED, body FRD."""

    time_s: float  # when it was measured
    position: Vector  # (3,) m
    quaternion: Vector  # (4,) w x y z, body to earth
    velocity: Vector  # (6,) m/s and rad/s, along the axes of the body


class Phase(Enum):
    """What the flight is doing; the value is the sentence of the log."""

    WAITING = "neutral: the flight has not begun"
    FLYING = "flying"
    STALE = "neutral: no measurement for 0.5 s"
    WILD = "neutral: the newest measurement cannot be true"
    ENDED = "neutral: the flight has ended"


class End(Enum):
    """Why a flight ended; the value is the sentence of the log, with what to do."""

    ASKED = "it was asked to end"
    TIME = "the time that was set is over"
    STALE = "no usable measurement came for 3 s: look at the vehicle's position estimate (EKF, DVL, tracker)"
    HEARTBEAT = "no heartbeat came for 3.5 s: look at the tether and at the connection"
    NOT_A_NUMBER = "the policy gave what is no number: export it anew, and look at what the vehicle measured"
    SHALLOW = "the vehicle is above the depth limit: give limits.shallowest_m, or begin deeper"
    DEEP = "the vehicle is below the depth limit: give limits.deepest_m, or begin higher"
    FAR = "the vehicle is outside the radius: give limits.radius_m, or look at what pushes the vehicle"
    MODE = "somebody chose another mode: that mode stays"
    DISARMED = "the vehicle was disarmed: by a person, or by a failsafe of its own"
    RESTARTED = "the vehicle's clock went back: the autopilot was started anew"
    HELD = "the pilot's input hold or roll and pitch trim is on: switch that off, for it adds to what is sent"
    BLOCKED = "the vehicle takes no more bytes: look at the tether and at the connection"
    UNWATCHED = "the second process, which watches this one, has ended: nobody would send neutral in its place"
    CRASH = "this program failed"


@dataclass(frozen=True)
class Limits:
    """Within which a vehicle is flown."""

    shallowest_m: float  # depths
    deepest_m: float
    radius_m: float  # m along the horizontal, from where the flight began
    fastest_m_s: float = 5.0  # along any axis; what is faster was measured wrongly
    fastest_rad_s: float = 6.0
    authority: float = 1.0  # largest command


class Decision(NamedTuple):
    """What to send now."""

    command: Vector  # (4,) surge, sway, heave, yaw in [-1, 1]
    phase: Phase
    until_s: float  # when the vehicle must be neutral unless another decision is sent

    @property
    def neutral(self) -> bool:
        """Whether nothing is wanted of the vehicle."""
        return not any(self.command)


class Safety:
    """Decides what is sent: nothing but neutral, unless all of what a flight needs is there.

    Args:
        limits: within which a vehicle is flown.
        control_dt: s for which a command is held.
        mode: number of the mode in which a vehicle is flown.
    """

    def __init__(self, limits: Limits, control_dt: float, mode: int):
        self.limits, self.control_dt, self.mode = limits, control_dt, mode
        self.ended: End | None = None
        self.begun: Motion | None = None  # where the flight began
        self.good: Motion | None = None  # the last measurement that can be true
        self.armed = False
        self.now_mode: int | None = None
        self._heard_s = -math.inf
        self._in_a_row = 0
        self._wild = False

    def heartbeat(self, now: float, mode: int, armed: bool) -> None:
        """A heartbeat came."""
        self._heard_s, self.now_mode, self.armed = now, mode, armed

    def measured(self, now: float, motion: Motion) -> bool:
        """A measurement came; whether it can be true. One that is no newer than the last one says nothing."""
        if not math.isfinite(motion.time_s) or motion.time_s > now:
            self._wild, self._in_a_row = True, 0
            return False
        if self.good is not None and motion.time_s <= self.good.time_s:
            return False
        if not self._can_be(motion):
            self._wild, self._in_a_row = True, 0
            if self.begun is None:
                self.good = None  # nobody flies yet: what comes next may be right, and the last one wrong
            return False
        self.good, self._wild = motion, False
        self._in_a_row += 1
        return True

    def settled(self, now: float) -> bool:
        """Whether measurements are such that a flight may begin."""
        return self._in_a_row >= SETTLED and not self._wild and self._is_fresh(now)

    def begin(self, now: float) -> bool:
        """Begin the flight here, if the vehicle is armed, in its mode, heard and measured; whether it has begun."""
        ready = self.armed and self.now_mode == self.mode and now - self._heard_s <= HEARTBEAT_S
        if self.ended is None and self.begun is None and ready and self.settled(now):
            self.begun = self.good
        return self.begun is not None

    def end(self, why: End) -> None:
        """End the flight; the first reason is kept."""
        self.ended = self.ended or why

    def motion(self, now: float) -> Motion | None:
        """What the policy is to fly by; None where nothing but neutral would be sent."""
        return self.good if self._phase(now) is Phase.FLYING else None

    def decide(self, now: float, wanted: Sequence[float] | None) -> Decision:
        """What to send now.

        Args:
            now: s.
            wanted: (4,) what the policy wants of :meth:`motion`; None where there is none.
        """
        phase = self._phase(now)
        if phase is Phase.FLYING and wanted is not None:
            if len(wanted) != len(NEUTRAL) or not all(map(math.isfinite, wanted)):
                self.end(End.NOT_A_NUMBER)
                return Decision(NEUTRAL, Phase.ENDED, now + STALE_S)
            most = min(self.limits.authority, 1.0)
            assert self.good is not None
            command = tuple(max(-most, min(most, float(value))) for value in wanted)
            return Decision(command, phase, self.good.time_s + STALE_S)
        return Decision(NEUTRAL, phase, now + STALE_S)

    def _phase(self, now: float) -> Phase:
        if self.ended is None and (why := self._reason(now)) is not None:
            self.end(why)
        if self.ended is not None:
            return Phase.ENDED
        if self.begun is None:
            return Phase.WAITING
        if self._wild:
            return Phase.WILD
        return Phase.FLYING if self._is_fresh(now) else Phase.STALE

    def _reason(self, now: float) -> End | None:
        """Why a flight must end."""
        if now - self._heard_s > HEARTBEAT_S and self.now_mode is not None:
            return End.HEARTBEAT
        if self.begun is None or self.good is None:
            return None
        if not self.armed:
            return End.DISARMED
        if self.now_mode != self.mode:
            return End.MODE
        if now - self.good.time_s > GIVE_UP_S:
            return End.STALE
        north, east, down = self.good.position
        if down < self.limits.shallowest_m:
            return End.SHALLOW
        if down > self.limits.deepest_m:
            return End.DEEP
        away = math.hypot(north - self.begun.position[0], east - self.begun.position[1])
        return End.FAR if away > self.limits.radius_m else None

    def _is_fresh(self, now: float) -> bool:
        """Whether a command that is held for a step ends before the measurement is stale."""
        return self.good is not None and now + self.control_dt <= self.good.time_s + STALE_S

    def _can_be(self, motion: Motion) -> bool:
        """Whether a vehicle may be there, at that speed, after where it was last."""
        if not all(map(math.isfinite, (*motion.position, *motion.quaternion, *motion.velocity))):
            return False
        limits = self.limits
        if max(map(abs, motion.velocity[:3])) > limits.fastest_m_s:
            return False
        if max(map(abs, motion.velocity[3:])) > limits.fastest_rad_s:
            return False
        if abs(math.hypot(*motion.quaternion) - 1.0) > 0.01:
            return False
        if self.good is None:
            return True
        passed = motion.time_s - self.good.time_s
        moved = math.dist(motion.position, self.good.position)
        along = sum(a * b for a, b in zip(motion.quaternion, self.good.quaternion, strict=True))
        turned = 2.0 * math.acos(min(1.0, abs(along)))
        return moved <= _JUMP_M + limits.fastest_m_s * passed and turned <= _JUMP_RAD + limits.fastest_rad_s * passed
