"""Stretches in which a vehicle is held, as on deck behind a dive, while its thrusters are commanded.

Then every channel stands still at once. No sensor is at fault, and no thruster: what was flown before and behind is
explained by itself.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.unanswered.stillness import (
    LEAST_S,
    STABILISED,
    WHOLE,
    Motions,
    Stillness,
    measure_motions,
)
from auv_torchrl.flightlog import FlightLog
from auv_torchrl.flightlog.signals import runs
from auv_torchrl.vehicle import Vehicle


def find_held(
    log: FlightLog, vehicle: Vehicle, settings: Settings, still: Sequence[Stillness]
) -> tuple[Stillness, ...]:
    """Every channel, in each stretch in which all of them stand still.

    Args:
        log: as it was read.
        vehicle: that should explain it, empty batch.
        settings: of the diagnosis.
        still: the stretches in which single channels stand still. Channels in which an autopilot, or weight, holds a
            vehicle are not among them: these count only where all others stand still, too.
    """
    numbers = {entry.episode for entry in still if entry.episode is not None}
    spans = [(number, *span) for number in sorted(numbers) for span in _shared(log, still, number)]
    motions = measure_motions(log, vehicle, settings) if spans else None
    if motions is None:
        return ()
    held = [span for span in spans if _is_held(motions, *span)]
    return tuple(Stillness(name, *span) for span in held for name in log.axes)


def _shared(log: FlightLog, still: Sequence[Stillness], number: int) -> list[tuple[float, float]]:
    """First and last s of the stretches of an episode in which all channels stand still that nothing holds."""
    spans = [(-np.inf, np.inf)]
    for name in log.axes:
        if name in STABILISED:
            continue
        own = [(one.first_s, one.last_s) for one in still if one.episode == number and one.channel == name]
        both = [(max(first, begin), min(last, end)) for first, last in spans for begin, end in own]
        spans = [(first, last) for first, last in both if last - first >= LEAST_S]
    return [span for span in spans if np.isfinite(span).all()]


def _is_held(motions: Motions, number: int, first_s: float, last_s: float) -> bool:
    """Whether the channels that an autopilot may hold stand still, too, in the windows of a stretch."""
    windows = motions.windows
    end = windows.time + windows.steps * windows.dt
    rows = (windows.number == number) & (windows.time >= first_s - windows.dt) & (end <= last_s + windows.dt)
    columns = [column for column, name in enumerate(windows.channels) if name in STABILISED]
    return bool(rows.any() and all(motions.still(column)[rows].mean() >= WHOLE for column in columns))


def beside(log: FlightLog, held: Sequence[Stillness]) -> FlightLog | None:
    """The log without these stretches; None where nothing is left. The second part of an episode has a new number."""
    parts, fresh = [], 1 + max(episode.number for episode in log.episodes)
    for episode in log.episodes:
        own = [one.covers(episode.t) for one in held if one.episode == episode.number]
        kept = list(runs(~np.any(own, axis=0))) if own else [(0, len(episode))]
        for place, (first, behind) in enumerate(kept):
            part = episode.rows(first, behind)
            parts.append(replace(part, number=fresh) if place else part)
            fresh += place > 0
    return replace(log, episodes=tuple(parts)) if parts else None
