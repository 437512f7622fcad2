"""Which lane of ArduPilot's filter was in use: it runs one for each IMU and takes what one of them says."""

import numpy as np

from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.readers.messages import Columns, Messages


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


def latest(known: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Rows of ``known`` that were the latest at ``t``, or the first."""
    return np.maximum(np.searchsorted(known, t + 1e-6, side="right") - 1, 0)


def rows(columns: Columns, kept: np.ndarray) -> Columns:
    """The messages that a mask (T,) keeps."""
    return {name: values[kept] for name, values in columns.items()}
