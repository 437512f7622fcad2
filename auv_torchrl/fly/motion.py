"""Measured states out of messages: which, when they were measured, and along which axes."""

import math
from collections import deque
from enum import StrEnum

import numpy as np

from auv_torchrl.fly.mavlink import Message
from auv_torchrl.fly.safety import Motion
from auv_torchrl.physics.kinematics import quaternion_from_euler, rotation_matrix

APART_S = 0.1  # s by which position and attitude may lie apart
_DRIFT = 1e-4  # s in a second, by which two clocks may drift apart
_RESTART_S = 1.0  # s by which the clock of a vehicle that was started anew steps back
_OVER_S = 0.2  # s over which a speed is taken from positions
_EARTH, _BODY = (1, 20), (12,)  # ODOMETRY: MAV_FRAME_LOCAL_NED or _LOCAL_FRD, MAV_FRAME_BODY_FRD


class Source(StrEnum):
    """Which messages say where the vehicle is."""

    LOCAL = "local"  # LOCAL_POSITION_NED and ATTITUDE: what the autopilot estimates
    ODOMETRY = "odometry"
    VISION = "vision"  # VISION_POSITION_ESTIMATE; turning rates from ATTITUDE, speed from successive positions


class Clock:
    """When something was measured, on our clock, from the time that its sender gave it.

    The message that came fastest says how the clocks differ; what comes later than that was on its way for longer.
    """

    def __init__(self) -> None:
        self._offset = math.inf
        self._at = self._sent = -math.inf
        self.went_back = False

    def ours(self, received: float, sent: float) -> float:
        """Our time of a message that was sent at ``sent`` on another clock."""
        if sent < self._sent - _RESTART_S:
            self.went_back = True
        self._sent = max(self._sent, sent)
        if math.isfinite(self._offset):
            self._offset += _DRIFT * max(0.0, received - self._at)
        self._at = received
        self._offset = min(self._offset, received - sent)
        return min(received, sent + self._offset)


class Measured:
    """Turns messages into measured states.

    Args:
        source: which messages are used.
        system: number of the vehicle; positions of a tracker may come from others.
    """

    def __init__(self, source: Source, system: int):
        self.source, self._system = source, system
        self._clocks = {"time_boot_ms": Clock(), "time_usec": Clock(), "usec": Clock()}
        self._attitude: tuple[float, tuple[float, ...], tuple[float, ...]] | None = None  # time, angles, rates
        self._places: deque[tuple[float, np.ndarray]] = deque()

    @property
    def restarted(self) -> bool:
        """Whether the clock of the vehicle, or of its tracker, stepped back."""
        return any(clock.went_back for clock in self._clocks.values())

    def take(self, message: Message, received: float) -> Motion | None:
        """The state that a message completes; None where it completes none."""
        name, content = message.name, message.fields
        ours = message.system == self._system
        if name == "ATTITUDE" and ours:
            at = self._clocks["time_boot_ms"].ours(received, content["time_boot_ms"] * 1e-3)
            rates = content["rollspeed"], content["pitchspeed"], content["yawspeed"]
            self._attitude = at, (content["roll"], content["pitch"], content["yaw"]), rates
        elif name == "LOCAL_POSITION_NED" and ours and self.source is Source.LOCAL:
            at = self._clocks["time_boot_ms"].ours(received, content["time_boot_ms"] * 1e-3)
            return self._local(at, [content[axis] for axis in ("x", "y", "z", "vx", "vy", "vz")])
        elif name == "ODOMETRY" and self.source is Source.ODOMETRY:
            return _odometry(self._clocks["time_usec"].ours(received, content["time_usec"] * 1e-6), message)
        elif name == "VISION_POSITION_ESTIMATE" and self.source is Source.VISION:
            return self._vision(self._clocks["usec"].ours(received, content["usec"] * 1e-6), message)
        return None

    def _local(self, at: float, local: list[float]) -> Motion | None:
        if self._attitude is None or abs(at - self._attitude[0]) > APART_S:
            return None
        _, angles, rates = self._attitude
        return _motion(at, local[:3], angles, local[3:], rates)

    def _vision(self, at: float, message: Message) -> Motion | None:
        content = message.fields
        place = np.array([content["x"], content["y"], content["z"]])
        if self._places and at <= self._places[-1][0]:
            return None
        self._places.append((at, place))
        while len(self._places) > 2 and self._places[1][0] <= at - _OVER_S:
            self._places.popleft()
        before, there = self._places[0]
        if self._attitude is None or abs(at - self._attitude[0]) > APART_S or not 0 < at - before <= 2 * _OVER_S:
            return None
        speed = ((place - there) / (at - before)).tolist()
        return _motion(
            at, place.tolist(), [content["roll"], content["pitch"], content["yaw"]], speed, self._attitude[2]
        )


def _motion(at: float, position, angles, over_ground, rates) -> Motion:
    """From angles of roll, pitch and yaw, and a speed along north, east and down."""
    quaternion = quaternion_from_euler(*(np.asarray(angle, dtype=np.float64) for angle in angles))
    along = rotation_matrix(quaternion).T @ np.asarray(over_ground, dtype=np.float64)
    return Motion(at, tuple(position), tuple(quaternion.tolist()), (*along.tolist(), *rates))


def _odometry(at: float, message: Message) -> Motion | None:
    content = message.fields
    if content["frame_id"] not in _EARTH or content["child_frame_id"] not in _BODY:
        return None
    position, quaternion, velocity = (
        tuple(content[name] for name in names.split())
        for names in ("x y z", "qw qx qy qz", "vx vy vz rollspeed pitchspeed yawspeed")
    )
    return Motion(at, position, quaternion, velocity)
