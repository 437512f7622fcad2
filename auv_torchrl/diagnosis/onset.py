"""A vehicle that changes while it flies: the log before and behind that moment."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from auv_torchrl.diagnosis.attitude import hold_attitude
from auv_torchrl.diagnosis.bench import Bench
from auv_torchrl.diagnosis.hypotheses import Settings
from auv_torchrl.diagnosis.where import gap_by_window, onset
from auv_torchrl.diagnosis.windows import cut_windows
from auv_torchrl.flightlog import FlightLog
from auv_torchrl.vehicle import Vehicle


def find_onset(log: FlightLog, vehicle: Vehicle, settings: Settings) -> dict[str, Any]:
    """When the gap sets in, as :func:`auv_torchrl.diagnosis.where.onset` has it; empty where it does not."""
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)
    bench = Bench(windows, hold_attitude(log, vehicle), settings)
    return onset(bench, gap_by_window(bench, bench.follow()))


def parted(log: FlightLog, moment: Mapping[str, Any], margin_s: float) -> tuple[FlightLog, FlightLog]:
    """The log before and behind an onset, ``margin_s`` on either side of it left out."""
    number, time = moment["onset_episode"], moment["onset_in_episode_s"]
    order = [episode.number for episode in log.episodes]
    at = order.index(number)
    changing = log.episodes[at]
    before = changing.rows(0, int(np.searchsorted(changing.t, time - margin_s)))
    behind = changing.rows(int(np.searchsorted(changing.t, time + margin_s)), len(changing))
    parts = ((*log.episodes[:at], before), (behind, *log.episodes[at + 1 :]))
    long = [tuple(e for e in part if len(e) > 1 and e.duration > 2 * margin_s) for part in parts]
    return replace(log, episodes=long[0]), replace(log, episodes=long[1])
