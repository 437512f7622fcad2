"""A flight: meet the vehicle, make sure that it is known, take it over, fly, and leave it as it was."""

import logging
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from auv_torchrl.fly import known
from auv_torchrl.fly.channels import Channels, Interface
from auv_torchrl.fly.connection import Link
from auv_torchrl.fly.flyer import Flyer
from auv_torchrl.fly.helm import Helm
from auv_torchrl.fly.known import MANUAL, Identity, UnknownVehicle
from auv_torchrl.fly.mavlink import LAYOUTS, Message
from auv_torchrl.fly.motion import Measured, Source
from auv_torchrl.fly.safety import NEUTRAL, Decision, End, Limits, Motion, Phase, Safety
from auv_torchrl.fly.talk import ARM, INTERVAL, Talk
from auv_torchrl.fly.watch import Guard

log = logging.getLogger("fly")

MEET_S, ANSWER_S, CONFIRM_S = 10.0, 10.0, 5.0  # s for a heartbeat, for all parameters, for a mode and for arming
LEAVE_S = 0.5  # s for which neutral is sent at the end
STREAMED_HZ = 20.0  # of measured states; where fewer come, more are asked for
_ASKED_US = 20_000  # us between them then
_STREAMS = {
    Source.LOCAL: ("LOCAL_POSITION_NED", "ATTITUDE"),
    Source.ODOMETRY: ("ODOMETRY",),
    Source.VISION: ("VISION_POSITION_ESTIMATE", "ATTITUDE"),
}


class CannotFly(ValueError):
    """A flight that does not begin; the message says why, and what to do."""


class Keeper(Protocol):
    """Who keeps a flight."""

    def add(self, motion: Motion, command: Sequence[float]) -> None:
        """A state was measured under a command (4,)."""
        ...


@dataclass(frozen=True)
class Settings:
    """How to fly."""

    limits: Limits
    interface: Interface = Interface.RC
    source: Source = Source.LOCAL
    system: int = 255
    arm: bool = False
    dry_run: bool = False
    until_s: float | None = None
    firmware: str | None = None  # a version beyond those that are known, which the user has tried


@dataclass
class Tally:
    """What became of a flight."""

    phases: Counter[Phase] = field(default_factory=Counter)  # control steps in each
    wild: int = 0  # measurements that could not be true
    flown_s: float = 0.0
    off_m: list[float] = field(default_factory=list)  # distance from the reference at each step that was flown


class Pilot:
    """Flies a vehicle; :meth:`fly` does all of it, and leaves the vehicle as it was whatever happens.

    Args:
        link: to the vehicle.
        flyer: the policy.
        settings: how to fly.
        stop: whether somebody asked to end.
        guard: who sends neutral where this process ends; None where nobody does.
        keeper: who keeps the flight.
    """

    def __init__(
        self,
        link: Link,
        flyer: Flyer,
        settings: Settings,
        stop: Callable[[], Any] = lambda: None,
        guard: Guard | None = None,
        keeper: Keeper | None = None,
    ):
        self.link, self.flyer, self.settings, self.keeper, self._stop = link, flyer, settings, keeper, stop
        self.talk = Talk(link, settings.system, settings.dry_run)
        self.safety = Safety(settings.limits, flyer.control_dt, MANUAL)
        self.helm = Helm(self.talk, Channels(settings.interface), guard)
        self.tally = Tally()
        self.has_left = False  # whether the vehicle is as it was found
        self._asked_streams = False
        self._measured: Measured | None = None
        self._next_s = 0.0
        self.talk.hear = self._hear

    def hear_first(self) -> None:
        """Wait for a heartbeat of the vehicle.

        Raises:
            CannotFly: where none comes.
        """
        talk, end = self.talk, self.link.now() + MEET_S
        while talk.heard is None and self.link.now() < end and not self._stop():
            talk.take(self.link.receive(min(end, self.link.now() + 0.2)))
        if talk.heard is None:
            raise CannotFly(f"no vehicle was heard for {MEET_S:g} s: start it, or look at connection=")

    def fly(self) -> End:
        """The whole flight; why it ended.

        Raises:
            ValueError: where it does not begin, because the vehicle is not known, not measured, or does not arm.
        """
        try:
            self._meet()
            self._take_over()
            while self.safety.ended is None:
                self._step()
        except BaseException:
            self.safety.end(End.CRASH)
            raise
        finally:
            self._leave()
            self.has_left = True
        return self.safety.ended

    def _hear(self, message: Message, received: float) -> None:
        """Hand on what a message says."""
        if message.name == "HEARTBEAT" and self.talk.heard is not None and message.system == self.talk.vehicle:
            mode, armed = self.talk.heard.mode, self.talk.heard.armed
            if self.settings.dry_run:  # it flies in thought, whether or not the vehicle would
                mode, armed = MANUAL, True
            self.safety.heartbeat(received, mode, armed)
        if self._measured is None and self.talk.vehicle is not None:
            self._measured = Measured(self.settings.source, self.talk.vehicle)
        if self._measured is None:
            return
        motion = self._measured.take(message, received)
        if self._measured.restarted:
            self.safety.end(End.RESTARTED)
        if motion is None:
            return
        newest = self.safety.good
        if self.safety.measured(received, motion):
            if self.keeper is not None and self.safety.begun is not None and self.safety.ended is None:
                self.keeper.add(motion, self.helm.in_force)
        elif newest is None or motion.time_s > newest.time_s:
            self.tally.wild += 1

    def _meet(self) -> None:
        """Hear the vehicle, and make sure that it is one that is flown; so far nothing moves it."""
        talk, settings = self.talk, self.settings
        self.hear_first()
        assert talk.heard is not None
        known.check_heartbeat(talk.heard.kind, talk.heard.autopilot)
        if settings.dry_run:
            log.info("dry run: nothing is sent, so the vehicle's frame, version and settings are not asked for")
            return
        manual = known.OF_MANUAL if settings.interface is Interface.MANUAL else ()
        talk.ask_parameters((*known.NEEDED, known.FAILSAFE, *manual), known.GROUND_STATION, ANSWER_S)
        if talk.others:
            numbers = sorted({*talk.others, talk.vehicle or 0})
            raise UnknownVehicle(f"several vehicles are heard, {numbers}: give a connection to one of them")
        identity = Identity(talk.heard.kind, talk.heard.autopilot, talk.version, talk.parameters)
        contract = self.flyer.policy.contract
        self.helm.channels = known.channels_of(
            identity, contract, settings.interface, settings.system, settings.firmware
        )
        name, reached = known.weakest(self.helm.channels, self.helm.gain)
        if reached < 0.99:
            why = f"at pilot gain {self.helm.gain:.2f}: interface=rc has all of it" if manual else "for its input ends"
            log.warning("%s reaches %.0f %% of what the policy may ask for, %s", name, 100 * reached, why)
        if not talk.parameters.get(known.FAILSAFE):
            log.warning("%s is 0: if both processes are lost, nothing stops the vehicle; set it to 2", known.FAILSAFE)

    def _take_over(self) -> None:
        """Have measurements come, then mode MANUAL, and arm if that was asked for; neutral all the time."""
        if self._stop():
            self.safety.end(End.ASKED)
            return
        self._settle()
        if self.settings.dry_run:
            return
        self.helm.plan()
        heard = self.talk.heard
        assert heard is not None
        if heard.mode != MANUAL:
            self.helm.found_mode = heard.mode
            self.helm.plan()
            self._confirm(lambda: self.talk.mode(MANUAL), lambda: self.safety.now_mode == MANUAL, "mode MANUAL")
        if self.settings.arm and not self.safety.armed:
            self.helm.has_armed = True
            self.helm.plan()
            self._confirm(lambda: self.talk.command(ARM, 1.0), lambda: self.safety.armed, "arming")
        elif not self.safety.armed:
            log.info("the vehicle is disarmed: neutral is sent until somebody arms it; arm=true does so")

    def _settle(self) -> None:
        """Wait for measurements that a flight can begin with, and for enough of them in a second."""
        begun, count = self.link.now(), 0
        end = begun + MEET_S
        while not (self.safety.settled(self.link.now()) and self.link.now() - begun >= 1.0):
            if self.link.now() >= end or self.link.lost:
                names = " and ".join(_STREAMS[self.settings.source])
                raise CannotFly(
                    f"no usable {names} came for {MEET_S:g} s: give the vehicle a position "
                    "(docs/how-to/fly-a-policy.md), or another source="
                )
            if self._stop():
                self.safety.end(End.ASKED)
                return
            before = self.safety.good
            self.talk.take(self.link.receive(self.link.now() + 0.05))
            count += self.safety.good is not before
            if not self._asked_streams and self.link.now() - begun > 1.0 and count < STREAMED_HZ:
                self._stream(_ASKED_US)
            self.helm.beat()

    def _stream(self, interval_us: float) -> None:
        """Ask the autopilot for measured states; 0 is its default."""
        self._asked_streams = interval_us != 0
        for name in _STREAMS[self.settings.source]:
            self.talk.send(self.talk.command(INTERVAL, LAYOUTS[name].number, interval_us))

    def _confirm(self, question: Callable[[], bytes], answered: Callable[[], bool], what: str) -> None:
        """Ask until it is so, with neutral between.

        Raises:
            CannotFly: where the vehicle refuses, with what it says.
        """
        end = self.link.now() + CONFIRM_S
        asked_s = -1.0
        while not answered() and self.safety.ended is None:
            if self.link.now() >= end or self._stop():
                answer = "; ".join(self.talk.texts) or "nothing"
                raise CannotFly(f"the vehicle refused {what} (it says: {answer}): look at it in the ground station")
            if self.link.now() - asked_s > 0.5:
                self.talk.send(question())
                asked_s = self.link.now()
            self.helm.send(self.safety.decide(self.link.now(), None))
            self.talk.listen(self.link.now() + self.flyer.control_dt)

    def _step(self) -> None:
        """One control step: listen until its time, then decide and send."""
        self._next_s = max(self._next_s + self.flyer.control_dt, self.link.now())
        self.talk.listen(self._next_s)
        now = self.link.now()
        self._look(now)
        if self.safety.begun is None and self.safety.begin(now) and self.safety.begun is not None:
            self.flyer.start(self.safety.begun)
            log.info("flying: %s", self.flyer.says)
        motion = self.safety.motion(now)
        wanted = None if motion is None else self.flyer.command(motion)
        decision = self.safety.decide(self.link.now(), wanted)
        self.helm.send(decision)
        if self.safety.begun is not None:
            self.tally.phases[decision.phase] += 1
            self.tally.flown_s = now - self.safety.begun.time_s
        if motion is not None:
            self.tally.off_m.append(self.flyer.off(motion))

    def _look(self, now: float) -> None:
        """Look at all that ends a flight and is not a matter of measurements."""
        begun, until = self.safety.begun, self.settings.until_s
        held = self.settings.interface is Interface.MANUAL and any(map(self.talk.named.get, ("InputHold", "RollPitch")))
        for why, happens in {
            End.ASKED: bool(self._stop()),
            End.TIME: begun is not None and until is not None and now - begun.time_s >= until,
            End.BLOCKED: self.link.lost or self.link.blocked(),
            End.UNWATCHED: self.helm.guard is not None and not self.helm.guard.alive(),
            End.HELD: held,
        }.items():
            if happens:
                self.safety.end(why)

    def _leave(self) -> None:
        """Send neutral, disarm if this flight has armed, and give back the mode that was found."""
        talk, helm = self.talk, self.helm
        if talk.heard is None or self.settings.dry_run:
            return
        helm.is_theirs = self.safety.ended is End.MODE
        steps = 1 if helm.is_theirs else round(LEAVE_S / self.flyer.control_dt)
        for _ in range(steps if helm.has_sent else 0):  # a vehicle that is not known is sent nothing
            helm.send(Decision(NEUTRAL, Phase.ENDED, self.link.now() + 2 * CONFIRM_S))
            helm.plan()
            talk.listen(self.link.now() + self.flyer.control_dt)
        if self._asked_streams:
            self._stream(0.0)
        if helm.is_theirs:
            return

        def questions() -> Iterator[bytes]:
            if helm.has_armed and self.safety.armed:
                yield talk.command(ARM, 0.0)
            if helm.found_mode is not None and self.safety.now_mode != helm.found_mode:
                yield talk.mode(helm.found_mode)

        if not talk.ask(questions, CONFIRM_S):
            log.warning("the vehicle did not confirm that it is disarmed, or back in its mode: look at it")
