"""The moments of one flight that a figure and a recording mark: change, alarm, refit, recovery."""

from dataclasses import dataclass
from enum import StrEnum

from auv_torchrl.experiment.in_flight import InFlight
from auv_torchrl.online import PHASES, Phase
from auv_torchrl.online.recovery import BACK_M

_APART_S = 0.1  # s; a change that is felt as soon as this needs no moment of its own


class Happening(StrEnum):
    """What a moment is; the value is what the legend calls it."""

    CHANGE = "the vehicle changes"
    FELT = "first alters a thrust"
    NOTICED = "noticed"
    SETTLED = "map settled"
    FROZEN = "measurements lost"
    RECOVERED = f"within {BACK_M:g} m for good"


@dataclass(frozen=True)
class Moment:
    """Something that happened at a time of a flight."""

    time_s: float
    happening: Happening
    text: str


def moments(flown: InFlight, start: int) -> list[Moment]:
    """All moments of one flight, in order: every change of the vehicle, every alarm, every end of a search.

    Args:
        flown: the flights.
        start: which of them.
    """
    found = [*_of_the_adapter(flown, start)]
    for change, recovery in zip(flown.schedule.changes, flown.recovered, strict=True):
        at, felt, back = (float(value[start]) for value in (change.at_s, recovery.felt_s, recovery.time_s))
        found.append(Moment(at, Happening.CHANGE, change.what))
        if _APART_S < felt < float("inf"):
            text = f"{change.what}: first alters a thrust, the thrusters were silent"
            found.append(Moment(at + felt, Happening.FELT, text))
        if 0.0 < back < float("inf"):
            text = f"error < {BACK_M:g} m for good, {back:.2f} s after the change"
            found.append(Moment(at + back, Happening.RECOVERED, text))
    return sorted(found, key=lambda moment: moment.time_s)


def _of_the_adapter(flown: InFlight, start: int) -> list[Moment]:
    one = flown.adapted.of_start(start)
    time, phase, alarm = one.flight.time.double().tolist(), one.phase.tolist(), one.alarm.tolist()
    found, noticed_s = [], 0.0
    for k in range(1, len(time)):
        before, now = PHASES[phase[k - 1]], PHASES[phase[k]]
        if alarm[k]:
            noticed_s = time[k]
            found.append(Moment(time[k], Happening.NOTICED, Phase.SEARCHING.value))
        if before is Phase.SEARCHING and now is Phase.FOLLOWING:
            found.append(Moment(time[k], Happening.SETTLED, f"map refitted within {time[k] - noticed_s:.2f} s"))
        if now is Phase.FROZEN is not before:
            found.append(Moment(time[k], Happening.FROZEN, Phase.FROZEN.value))
    return found
