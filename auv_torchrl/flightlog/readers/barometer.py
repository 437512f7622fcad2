"""Which of several barometers is the one outside, and the depth that it tells."""

import numpy as np

from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.readers.messages import Columns, Messages
from auv_torchrl.flightlog.streams.stream import Sampling, Stream, stream

_SAME_M = 0.25  # m, median by which a barometer differs from the altitude in use; the one inside is metres away


def depth(messages: Messages, primary: Columns | None) -> tuple[Stream | None, list[Finding]]:
    """Depth below where the barometer was set to zero; of several barometers that which the vehicle dives by.

    That one is known by CTUN.BAlt, which repeats it, or by the depth of the filter, which follows it.
    """
    sensed = messages.get("BARO", "Alt")
    if sensed is None or not len(sensed["t"]):
        return None, []
    numbers = sensed["I"] if "I" in sensed else np.zeros(len(sensed["t"]), np.int64)
    reference = _reference(messages, primary)
    each = np.unique(numbers).tolist()
    if reference is None and len(each) > 1:
        sentence = f"there are {len(each)} barometers and nothing tells which is outside: depth is left out"
        return None, [Finding(Severity.WARNING, "which_barometer", sentence, "Log CTUN or XKF1", ("z",))]
    chosen = each[0]
    if reference is not None:
        off = {number: _difference(sensed, numbers == number, *reference) for number in each}
        chosen = min(each, key=lambda number: off[number])
        if not off[chosen] < _SAME_M:
            sentence = f"no barometer follows the depth in use (nearest by {off[chosen]:.2f} m): depth is left out"
            return None, [Finding(Severity.WARNING, "which_barometer", sentence, "Look at BARO and CTUN", ("z",))]
    mine = numbers == chosen
    t, altitude = sensed["t"][mine], sensed["Alt"][mine].astype(np.float64)
    return stream("depth", "z", "m", t, -altitude, Sampling.MEASURED, f"BARO {int(chosen)}"), []


def _reference(messages: Messages, primary: Columns | None) -> tuple[np.ndarray, np.ndarray, bool] | None:
    """Times and altitude of what the vehicle dives by, and whether only its changes count."""
    control = messages.get("CTUN", "BAlt")
    if control is not None and len(control["t"]):
        return control["t"], control["BAlt"].astype(np.float64), False
    estimate = messages.get("XKF1", "PD")
    if estimate is None or not len(estimate["t"]):
        return None
    lane = estimate["C"] == (primary["PI"][0] if primary is not None and len(primary["t"]) else 0)
    mine = lane if "C" in estimate else slice(None)
    return estimate["t"][mine], -estimate["PD"][mine].astype(np.float64), True


def _difference(sensed: Columns, mine: np.ndarray, t: np.ndarray, altitude: np.ndarray, changes: bool) -> float:
    if not len(t) or not mine.any():
        return np.inf
    order = np.argsort(t, kind="stable")
    off = sensed["Alt"][mine].astype(np.float64) - np.interp(sensed["t"][mine], t[order], altitude[order])
    off = off[np.isfinite(off)]
    if not len(off):
        return np.inf
    return float(np.median(np.abs(off - np.median(off) if changes else off)))
