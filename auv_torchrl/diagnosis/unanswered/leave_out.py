"""A log without the channels that stand still."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.axes import followable, restricted
from auv_torchrl.diagnosis.unanswered.stillness import Stillness
from auv_torchrl.flightlog import FlightLog, FlightLogError
from auv_torchrl.flightlog.log import Episode
from auv_torchrl.sensors import CHANNELS


def without(log: FlightLog, still: Sequence[Stillness]) -> FlightLog | None:
    """The log without channels that stand still all along, and without trust in the others while they do.

    None where nothing is left that can be followed.
    """
    gone = {entry.channel for entry in still if entry.episode is None}
    kept = tuple(axis for axis in log.axes if axis not in gone)
    if not kept:
        return None
    parts = [entry for entry in still if entry.episode is not None]
    masked = replace(log, episodes=tuple(_masked(episode, parts) for episode in log.episodes))
    try:
        return followable(restricted(masked, kept))
    except FlightLogError:  # what is left needs what is gone, as positions need a heading
        return None


def _masked(episode: Episode, parts: Sequence[Stillness]) -> Episode:
    """The episode with stretches of its channels marked as filled in."""
    own = [entry for entry in parts if entry.episode == episode.number]
    if not own:
        return episode
    filled = np.zeros((len(episode), len(CHANNELS)))
    if episode.filled is not None:
        filled[:, : episode.filled.shape[1]] = episode.filled
    for entry in own:
        filled[entry.covers(episode.t), CHANNELS.index(entry.channel)] = 1.0
    return replace(episode, filled=filled)
