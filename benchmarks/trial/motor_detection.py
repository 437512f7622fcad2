"""What ArduSub finds itself, in its mode MOTOR_DETECT: it pulses each thruster and looks which way the vehicle turns.

It says of a thruster that it is in order, that it is reversed (and sets its direction), or that it failed, at which
it stops. Sticks are not touched meanwhile.
"""

import re
from collections.abc import Sequence
from typing import NamedTuple

from auv_torchrl.fly.known import MANUAL
from benchmarks.trial.cases import Case
from benchmarks.trial.dive import Diver

MOTOR_DETECT = 20
LONGEST_S = 120.0
_SAYS = {"ok": r"Thruster (\d+) is ok", "reversed": r"Thruster (\d+) is reversed", "failed": r"check Thruster (\d+) "}


class Detected(NamedTuple):
    """What it said: numbers of thrusters."""

    ok: tuple[int, ...]
    reversed: tuple[int, ...]
    failed: tuple[int, ...]

    def names(self, case: Case) -> bool:
        """Whether it says of this vehicle's thrusters what is wrong with them, and of no other that it is wrong."""
        gains = case.truth.get("thruster_gain", {})
        wanted = {kind: {int(k.rsplit("_", 1)[1]) for k, v in gains.items() if v == value}
                  for kind, value in (("reversed", -1.0), ("failed", 0.0))}  # fmt: skip
        return set(self.reversed) == wanted["reversed"] and set(self.failed) == wanted["failed"]

    @property
    def said(self) -> str:
        """In words."""
        parts = [f"{kind} {', '.join(map(str, those))}" for kind, those in self._asdict().items() if those]
        return "; ".join(parts) or "nothing"


def read_texts(texts: Sequence[str]) -> Detected:
    """What its messages say."""
    found = {kind: [int(n) for text in texts for n in re.findall(pattern, text)] for kind, pattern in _SAYS.items()}
    return Detected(**{kind: tuple(dict.fromkeys(those)) for kind, those in found.items()})


def detect(diver: Diver) -> Detected:
    """Let ArduSub look for itself, with the vehicle as it is."""
    diver.arm(MANUAL)
    begun = diver.stack.now()
    diver.talk.send(diver.talk.mode(MOTOR_DETECT))
    while diver.armed and diver.stack.now() - begun < LONGEST_S:
        diver.wait(1.0)
    return read_texts(diver.texts)
