"""Which lane of ArduPilot's filter was in use: it runs one for each IMU and takes what one of them says."""

import numpy as np

from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.readers.messages import Columns, Messages

_VELOCITY_KNOWN = 1 << 1  # of XKF4.SS and EKF_STATUS_REPORT.flags: horizontal velocity,
_POSITION_KNOWN = (1 << 3) | (1 << 4)  # relative, absolute; https://mavlink.io/en/messages/ardupilotmega.html
_STANDS_STILL = 1 << 7  # constant position mode: the filter has no position and says 0


def primary_lane(messages: Messages) -> tuple[Columns | None, int, list[Finding]]:
    """XKF4 of the lane in use at each time, the lane that was in use longest, and where it was exchanged."""
    status = messages.get("XKF4", "SS", "PI")
    if status is None or not len(status["t"]):
        return None, 0, []
    kept = rows(status, status["C"] == status["PI"]) if "C" in status else status
    lanes = status["PI"]
    lane = int(np.bincount(lanes.astype(np.int64).clip(0, 255)).argmax())
    switches = np.flatnonzero(np.diff(kept["PI"].astype(np.int64))) + 1
    findings = []
    if len(switches):
        at = ", ".join(f"{kept['t'][i]:.1f} s" for i in switches[:3]) + (", ..." if len(switches) > 3 else "")
        sentence = f"the filter changed its lane at {at}; what it estimates may leap there"
        findings.append(Finding(Severity.WARNING, "lane_switch", sentence, "Look for the sensor that it gave up"))
    return kept, lane, findings


def of_lane(columns: Columns, primary: Columns | None, lane: int) -> Columns:
    """The rows of the lane that was in use at their times."""
    if "C" not in columns:
        return columns
    if primary is None or not len(primary["t"]):
        return rows(columns, columns["C"] == lane)
    return rows(columns, columns["C"] == primary["PI"][latest(primary["t"], columns["t"])])


def leave_out_unknown(place: np.ndarray, speed: np.ndarray, t: np.ndarray, status: Columns | None, field: str) -> None:
    """Make NaN, of positions and velocities (T, 3) in NED, what a filter does not know by its flags at those times.

    Without ``status`` it does not say what it knows along the horizontal.
    """
    if status is None or not len(status["t"]):
        place[:, :2] = speed[:, :2] = np.nan
        return
    flags = status[field].astype(np.int64)[latest(status["t"], t)]
    moves = (flags & _STANDS_STILL) == 0
    place[~(((flags & _POSITION_KNOWN) != 0) & moves), :2] = np.nan
    speed[~(((flags & _VELOCITY_KNOWN) != 0) & moves), :2] = np.nan


def latest(known: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Rows of ``known`` that were the latest at ``t``, or the first."""
    return np.maximum(np.searchsorted(known, t + 1e-6, side="right") - 1, 0)


def rows(columns: Columns, kept: np.ndarray) -> Columns:
    """The messages that a mask (T,) keeps."""
    return {name: values[kept] for name, values in columns.items()}
