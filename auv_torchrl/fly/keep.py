"""What is kept of a flight: a flight log that auv-diagnose reads, and what became of the flight."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from auv_torchrl.files import write_text
from auv_torchrl.flightlog.writer import GrowingLog
from auv_torchrl.fly.safety import Motion
from auv_torchrl.physics.kinematics import euler_angles

FLIGHT, REPORT = "flight.csv", "flight.json"
_ROWS = 100  # rows until they are written: some 2 s
_DEMANDS = ("surge", "sway", "heave", "yaw")


class Keeper:
    """Writes ``flight.csv``: a row for each measured state, with the command that was in force when it was measured.

    Args:
        folder: where it is written.
    """

    def __init__(self, folder: Path):
        self._folder, self._log = folder, GrowingLog(folder / FLIGHT)
        self._rows: list[tuple[Motion, Sequence[float]]] = []
        self._begun_s: float | None = None

    def add(self, motion: Motion, command: Sequence[float]) -> None:
        """A state was measured under a command (4,)."""
        self._begun_s = motion.time_s if self._begun_s is None else self._begun_s
        self._rows.append((motion, command))
        if len(self._rows) >= _ROWS:
            self._write()

    def close(self, report: Mapping[str, Any]) -> None:
        """Write the rest, and what became of the flight."""
        self._write()
        self._log.close()
        write_text(self._folder / REPORT, json.dumps(report, indent=2) + "\n")

    def _write(self) -> None:
        if not self._rows:
            return
        motions, commands = zip(*self._rows, strict=True)
        self._rows.clear()
        assert self._begun_s is not None
        columns = {"t": np.array([motion.time_s for motion in motions]) - self._begun_s}
        columns |= dict(zip("xyz", np.array([motion.position for motion in motions]).T, strict=True))
        angles = euler_angles(np.array([motion.quaternion for motion in motions]))
        columns |= dict(zip(("roll", "pitch", "yaw"), np.array(angles), strict=True))
        columns |= dict(zip("uvwpqr", np.array([motion.velocity for motion in motions]).T, strict=True))
        sent: dict[str, np.ndarray] = dict(zip(_DEMANDS, np.array(commands).T, strict=True))
        still = np.zeros(len(motions))
        columns |= {f"cmd_{axis}": sent.get(axis, still) for axis in (*_DEMANDS[:3], "roll", "pitch", "yaw")}
        self._log.write(columns)
