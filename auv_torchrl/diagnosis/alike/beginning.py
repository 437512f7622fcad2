"""How a run begins: what is measured before the vehicle pushes, on which sound runs depend.

Ballast that is moved between one day and the next tilts a vehicle at rest, and then it dives and turns otherwise; a
fuller battery pushes more. Neither is a fault, and no fault of what pushes shows in it.
"""

from collections.abc import Sequence

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.flightlog import POSE, Episode, FlightLog

TILTS = ("roll", "pitch")
VOLTS = "volts"
LONGEST_S = 1.0  # s, that count as the beginning where a run is left alone for longer


def known_beginnings(logs: Sequence[FlightLog]) -> tuple[str, ...]:
    """What is known of how every run of these logs begins."""
    tilts = [name for name in TILTS if all(name in log.axes for log in logs)]
    fed = all(episode.battery is not None for log in logs for episode in log.episodes)
    return (*tilts, VOLTS) if fed else tuple(tilts)


def beginning(episode: Episode, names: Sequence[str]) -> Floats:
    """Medians (H,) of that, in rad and V, before the commands first change; NaN where nothing is measured."""
    changes = np.flatnonzero((np.diff(episode.commands, axis=0) != 0).any(1))
    still = episode.t - episode.t[0] <= LONGEST_S
    still[changes[0] + 1 if len(changes) else len(still) :] = False
    found = []
    for name in names:
        column = episode.battery if name == VOLTS else episode.pose[:, POSE.index(name)]
        own = np.full(len(still), np.nan) if column is None else column
        own = own[still & np.isfinite(own)]
        found.append(float(np.median(own)) if len(own) else np.nan)
    return np.array(found)
