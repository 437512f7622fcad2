"""How vehicles came through a change in flight: when it was noticed, how far they went off, when they were back."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import torch
from torch import Tensor

from auv_torchrl.adaptation.config import SETTLED_S
from auv_torchrl.adaptation.flight import AdaptedFlight
from auv_torchrl.adaptation.learner import FOLLOWING, PHASES, Phase
from auv_torchrl.flight import Flight
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.thrusters import applied_thrust, thrust_target
from auv_torchrl.vehicle import Vehicle
from auv_torchrl.vehicle.tensors import tensors

BACK_M = 0.05  # a vehicle has recovered once it stays closer than this to the target
BACK_RAD = 0.05  # and, where it steers by its heading, turns off from its course by less
FELT_N = 1.0  # a change is felt once a thruster gives this much more or less than it would have before
FELT_RAD = 0.01  # or a fin or a servo stands off by this much
_APART_S = 0.1  # s; a change that is felt as soon as this needs no moment of its own


@dataclass(frozen=True)
class Recovery:
    """Of N flights with a change each, (N,)."""

    time_s: Tensor  # from the change until the vehicle is closer than 5 cm for good; infinite if never
    largest_m: Tensor  # largest error after the change
    steady_m: Tensor  # mean error from 10 s after the change on; NaN where the next change comes before
    steady_rad: Tensor  # likewise of the heading
    felt_s: Tensor  # from the change until it first alters a thrust; infinite if it never does
    alarm_s: Tensor  # from the change until the first alarm; infinite if there is none
    delay_s: Tensor  # to the first alarm from when the change was felt, or came if no thrust is altered
    refit_s: Tensor  # from the first alarm until the map has settled; infinite if it never does
    alarms: Tensor  # number of alarms after the change
    alarms_before: Tensor  # number of alarms before it

    def as_dict(self) -> dict[str, Any]:
        """Shares, medians and percentiles over the flights, for JSON; None where there is no such number.

        Delay and refit are those of the flights in which the change was noticed.
        """
        noticed = self.alarm_s.isfinite()
        steady = self.steady_m[~self.steady_m.isnan()]
        return {
            "felt": float(self.felt_s.isfinite().double().mean()),
            "noticed": float(noticed.double().mean()),
            "delay_s": _spread(self.delay_s[noticed]),
            "refit_s": _spread(self.refit_s[noticed]),
            "recovery_s": _spread(self.time_s),
            "largest_m": _spread(self.largest_m),
            "steady_m": {"mean": _number(steady.mean()), "worst": _number(steady.max())} if len(steady) else None,
            "steady_rad": _number(self.steady_rad.nanmean()),
        }


def _spread(values: Tensor) -> dict[str, float | None] | None:
    if not len(values):
        return None
    quantiles = {"median": 0.5, "p90": 0.9}
    return {name: _number(values.quantile(q, interpolation="higher")) for name, q in quantiles.items()}


def _number(value: Tensor) -> float | None:
    return float(value) if math.isfinite(value) else None


def recoveries(
    flown: AdaptedFlight, change_s: Tensor, before: Vehicle, until_s: Tensor | None = None, steering: bool = False
) -> Recovery:
    """Judge N flights of vehicles that each change at ``change_s`` (N,).

    Args:
        flown: the flights.
        change_s: s since the start of the flight.
        before: the vehicle (empty batch) before the change.
        until_s: (N,) when the next change comes; None for none.
        steering: whether vehicles steer by their heading, so that being back is that of the heading, too.

    Raises:
        ValueError: if a flight ends less than 10 s after its last change.
    """
    flight = flown.flight
    time = flight.time.double()
    if until_s is None and float((time[:, -1] - change_s).min()) < SETTLED_S:
        raise ValueError(f"recovery: a flight ends within {SETTLED_S:g} s of its fault: fly longer or break it earlier")
    since = time - change_s.double()[:, None]
    after = since > 0
    if until_s is not None:
        after &= time <= until_s.double()[:, None]
    error = flight.position_error.double()
    off = error >= BACK_M
    if steering:
        off |= flight.heading_error.double() >= BACK_RAD
    outside = after & off
    last = torch.where(outside, since, 0.0).amax(1)
    final = torch.where(after, torch.arange(after.shape[1]), 0).amax(1, keepdim=True)
    never = outside.gather(1, final)[:, 0]
    least = torch.full_like(flight.thrust[0, 0].double(), FELT_N)
    least[list(before.servos)] = FELT_RAD
    felt = _first((altered_thrust(flight, before).abs() > least).any(-1), after, since)
    alarm = _first(flown.alarm, after, since)
    follows = after & (since > alarm[:, None])
    settled = _first(flown.phase == FOLLOWING, follows, since)
    late = after & (since >= SETTLED_S)
    return Recovery(
        time_s=torch.where(never, torch.inf, last),
        largest_m=torch.where(after, error, 0.0).amax(1),
        steady_m=torch.where(late, error, 0.0).sum(1) / late.sum(1),
        steady_rad=torch.where(late, flight.heading_error.double(), 0.0).sum(1) / late.sum(1),
        felt_s=felt,
        alarm_s=alarm,
        delay_s=(alarm - torch.where(felt.isfinite(), felt, 0.0)).clamp_min(0.0),
        refit_s=torch.where(settled.isfinite(), settled - alarm, torch.inf),
        alarms=(flown.alarm & after).sum(1),
        alarms_before=(flown.alarm & (since <= 0)).sum(1),
    )


def altered_thrust(flight: Flight, before: Vehicle) -> Tensor:
    """What each thruster gives beyond what it would have given before the change, N, (N, T + 1, n) float64.

    Of a servo it is the angle in rad by which it stands off.
    """
    c = prepare(tensors(before))
    terms = ActiveTerms.of(c)
    expected = applied_thrust(c, terms, thrust_target(c, terms, flight.command.double()), flight.time.double())
    return flight.thrust.double() - expected


def _first(event: Tensor, within: Tensor, since: Tensor) -> Tensor:
    """Time of the first event there, (N,); infinite if there is none."""
    return torch.where(event & within, since, torch.inf).amin(1)


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
