"""The moments of one flight that a figure and a recording mark: change, alarm, refit, recovery."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from auv_torchrl.adaptation.flight import AdaptedFlight
from auv_torchrl.adaptation.learner import PHASES, Phase
from auv_torchrl.adaptation.recovery import BACK_M, Recovery

_APART_S = 0.1  # s; a change that is felt as soon as this needs no moment of its own


class Happening(StrEnum):
    """What a moment is; the value is what a legend calls it."""

    CHANGE = "the vehicle changes"
    FELT = "felt"
    NOTICED = "noticed"
    SETTLED = "map settled"
    FROZEN = "measurements lost"
    RECOVERED = "recovered"


@dataclass(frozen=True)
class Moment:
    """Something that happened at a time of a flight."""

    time_s: float
    happening: Happening
    text: str


def moments(
    flown: AdaptedFlight, start: int, changes: Mapping[str, float], recovered: Sequence[Recovery]
) -> list[Moment]:
    """All moments of one flight, in order: every change of the vehicle, every alarm, every end of a search.

    Args:
        flown: N flights.
        start: which of them.
        changes: what changes in it, and when, in s.
        recovered: of the N flights, by change.
    """
    found = [*_of_the_adapter(flown.of_start(start))]
    for (what, at), recovery in zip(changes.items(), recovered, strict=True):
        felt, back = float(recovery.felt_s[start]), float(recovery.time_s[start])
        found.append(Moment(at, Happening.CHANGE, what))
        if _APART_S < felt < math.inf:
            found.append(Moment(at + felt, Happening.FELT, f"{what}: the first thrust that differs"))
        if 0.0 < back < math.inf:
            text = f"error < {BACK_M:g} m for good, {back:.2f} s after the change"
            found.append(Moment(at + back, Happening.RECOVERED, text))
    return sorted(found, key=lambda moment: moment.time_s)


def _of_the_adapter(flown: AdaptedFlight) -> Iterator[Moment]:
    time, phase, alarm = flown.flight.time.double().tolist(), flown.phase.tolist(), flown.alarm.tolist()
    noticed_s = 0.0
    for k in range(1, len(time)):
        before, now = PHASES[phase[k - 1]], PHASES[phase[k]]
        if alarm[k]:
            noticed_s = time[k]
            yield Moment(time[k], Happening.NOTICED, Phase.SEARCHING.value)
        if before is Phase.SEARCHING and now is Phase.FOLLOWING:
            yield Moment(
                time[k], Happening.SETTLED, f"the map is refitted, {time[k] - noticed_s:.2f} s after the alarm"
            )
        if now is Phase.FROZEN is not before:
            yield Moment(time[k], Happening.FROZEN, Phase.FROZEN.value)
