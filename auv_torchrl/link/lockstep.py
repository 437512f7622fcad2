"""Lock-step with a firmware that may lose packets, ask again, start anew, or be another one; without sockets."""

import logging
import time
from collections import Counter
from collections.abc import Callable, Hashable, Sequence
from typing import Protocol

from auv_torchrl.link.plant import LONGEST_STEP_S, Moment, Plant
from auv_torchrl.link.protocol import Servos, answer_line, commands_of, parse

log = logging.getLogger(__name__)

SILENT_S = 2.0  # s after which a firmware is gone: it asks again about every second


class Observer(Protocol):
    """Somebody who follows the flights."""

    def begin(self, moment: Moment) -> None:
        """A vehicle was placed, and flies from this moment on."""
        ...

    def flown(self, command: Sequence[float], moment: Moment) -> None:
        """The command (n,) was held until this moment."""
        ...


class Lockstep:
    """Answers servo packets: a new frame steps the vehicle once, a frame that was answered is answered alike.

    A firmware counts answers and starts at frame 0. So frame 0 of another address, or after a higher one, is a firmware
    that was started: the vehicle is placed anew and its time is 0 again. An older frame is a packet that was late on
    its way; it has no answer, unless it comes a second time: who asks again really is there.

    Args:
        plant: the vehicle.
        outputs: for each thruster the output of the firmware that drives it, from 1.
        paced: whether the firmware may wait for the wall clock.
        observers: are called in this order.
        clock: in s.
    """

    def __init__(
        self,
        plant: Plant,
        outputs: Sequence[int],
        paced: bool = True,
        observers: Sequence[Observer] = (),
        clock: Callable[[], float] = time.monotonic,
    ):
        self.plant, self.outputs, self.paced, self.observers, self._clock = plant, outputs, paced, observers, clock
        self.frame = -1  # the last that was answered; -1 before the first one
        self.counts: Counter[str] = Counter()
        self._peer: Hashable = None
        self._heard_s = 0.0
        self._line = b""
        self._late_frame = -1  # an older frame that came once
        self._reported: set[Hashable] = set()

    def answer(self, packet: bytes, sender: Hashable) -> bytes | None:
        """The line for the sender of a packet; None where nothing is to be answered."""
        servos = parse(packet)
        if servos is None:
            self.counts["garbage"] += 1
            self._say_once("garbage", f"{sender} sent what is no servo packet, of length {len(packet)}: no answer")
            return None
        now = self._clock()
        if sender != self._peer:
            if self._peer is not None and servos.frame != 0 and now - self._heard_s < SILENT_S:
                self.counts["stranger"] += 1
                self._say_once(sender, f"{sender} sends frames too, while {self._peer} flies: left unanswered")
                return None
            self._begin(sender, servos)
        elif servos.frame == self.frame:
            self._heard_s = now
            self.counts["repeated"] += 1
            return self._line
        elif servos.frame < self.frame:
            if servos.frame not in (0, self._late_frame):
                self._late_frame = servos.frame
                self.counts["late"] += 1
                return None
            self._begin(sender, servos)
        self._heard_s = now
        self._fly(servos)
        return self._line

    def _begin(self, sender: Hashable, servos: Servos) -> None:
        if self._peer is not None:
            self.counts["restart"] += 1
            log.info("the firmware was started anew, at %s: the vehicle is placed anew, at 0 s", sender)
            self.plant.reset()
        else:
            log.info("ArduSub flies, from %s: %d outputs, %d Hz", sender, len(servos.pwm), servos.rate_hz)
        self._peer, self.frame = sender, -1
        for observer in self.observers:
            observer.begin(self.plant.moment)

    def _fly(self, servos: Servos) -> None:
        if max(self.outputs) > len(servos.pwm):
            self._say_once("outputs", _undriven(self.outputs, len(servos.pwm)))
        command = commands_of(servos.pwm, self.outputs)
        if self.plant.step(command, step_of(servos.rate_hz)):
            self._say_once("lost", "the vehicle left what the physics can follow, and stays where it was")
        for observer in self.observers:
            observer.flown(command, self.plant.moment)
        self._line = answer_line(self.plant.reading(), self.paced)
        self.frame, self._late_frame = servos.frame, -1
        self.counts["frame"] += 1

    def _say_once(self, what: Hashable, message: str) -> None:
        if what not in self._reported:
            self._reported.add(what)
            log.warning("%s", message)


def _undriven(outputs: Sequence[int], came: int) -> str:
    thruster = next(n for n, output in enumerate(outputs, start=1) if output > came)
    return (
        f"outputs come up to number {came}, and thruster {thruster} is driven by output {outputs[thruster - 1]}: "
        "it stands still; set SERVO_32_ENABLE to 1, or give other outputs="
    )


def step_of(rate_hz: int) -> float:
    """The step in s of a rate that a firmware asks for; of slower ones than the physics can follow, the longest."""
    return min(1.0 / rate_hz, LONGEST_STEP_S) if rate_hz > 0 else LONGEST_STEP_S
