"""What is sent to a vehicle that is flown, and what is to be sent in its place where this process ends."""

from collections.abc import Iterator, Sequence

from auv_torchrl.fly.channels import Channels, Sent
from auv_torchrl.fly.safety import NEUTRAL, Decision
from auv_torchrl.fly.talk import ARM, AUTOPILOT, Talk
from auv_torchrl.fly.watch import Guard

HEARTBEAT_S = 1.0  # s between heartbeats of ours


class Helm:
    """Sends decisions, and knows what leaves the vehicle as it was found.

    Args:
        talk: with the vehicle.
        channels: how commands reach it.
        guard: who sends neutral where this process ends; None where nobody does.
    """

    def __init__(self, talk: Talk, channels: Channels, guard: Guard | None):
        self.talk, self.channels, self.guard = talk, channels, guard
        self.found_mode: int | None = None  # in place of which another one was set
        self.has_armed = False
        self.has_sent = False  # whether any command has gone to the vehicle
        self.is_theirs = False  # whether somebody else has taken the vehicle: it stays as it is then
        self.in_force: Sequence[float] = NEUTRAL  # the command that the vehicle has now
        self._beat_s = -HEARTBEAT_S

    @property
    def gain(self) -> float:
        """The pilot's, as the vehicle says it, or as it is after a start."""
        gain = self.talk.named.get("PilotGain", self.talk.parameters.get("JS_GAIN_DEFAULT", 1.0))
        return min(max(gain, 0.1), 1.0)  # as ArduSub limits it

    def send(self, decision: Decision) -> None:
        """Send a decision, have the second process know until when it holds, and keep what is in force."""
        sent = self.channels.sent(decision.command, self.gain)
        self.in_force, self.has_sent = sent.command, True
        self.talk.send(self._bytes(sent))
        if self.guard is not None:
            self.guard.beat(decision.until_s)
        self.beat()

    def beat(self) -> None:
        """Send our heartbeat, where it is time."""
        now = self.talk.link.now()
        if now - self._beat_s >= HEARTBEAT_S:
            self._beat_s = now
            self.talk.send(self.talk.heartbeat())

    def plan(self) -> None:
        """Tell the second process what to send in our place."""
        if self.guard is not None:
            neutral = self.channels.sent(NEUTRAL, self.gain)
            self.guard.plan(self._bytes(neutral), list(self.ending()))

    def ending(self) -> Iterator[bytes]:
        """What leaves the vehicle as it was found."""
        if self.has_armed and not self.is_theirs:
            yield self.talk.command(ARM, 0.0)
        if self.found_mode is not None and not self.is_theirs:
            yield self.talk.mode(self.found_mode)

    def _bytes(self, sent: Sent) -> bytes:
        if sent.name == "MANUAL_CONTROL":
            return self.talk.bytes_of(sent.name, target=self.talk.vehicle, **sent.fields)
        return self.talk.bytes_of(sent.name, target_system=self.talk.vehicle, target_component=AUTOPILOT, **sent.fields)
