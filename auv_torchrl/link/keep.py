"""What is kept of flights through the link: two flight logs, written as they grow."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from auv_torchrl.flightlog.writer import GrowingLog
from auv_torchrl.link.plant import Moment
from auv_torchrl.sensors import FELT, MOTION, motion_of

FLIGHT, TRUTH = "flight.csv", "truth.csv"
_ROWS = 4000  # rows until they are written: 10 s at 400 Hz, in 0.03 s


class Keeper:
    """Writes ``flight.csv``, what the sensors reported, and ``truth.csv``, what the vehicle did; each with commands.

    A row has the motion at its time and the command that is held from then on; that of a sensor also the specific force
    on the mean over the steps around it. Each vehicle that is placed begins an episode.

    Args:
        folder: where they are written.
    """

    def __init__(self, folder: Path):
        self._logs = {name: GrowingLog(folder / name) for name in (FLIGHT, TRUTH)}
        self._episode = -1
        self._before: Moment | None = None
        self._rows: list[tuple[Moment, Moment, Sequence[float]]] = []  # before and after a step, and its command

    def begin(self, moment: Moment) -> None:
        """An episode begins."""
        self._write()
        self._episode, self._before = self._episode + 1, moment

    def flown(self, command: Sequence[float], moment: Moment) -> None:
        """A step was flown."""
        assert self._before is not None
        self._rows.append((self._before, moment, command))
        self._before = moment
        if len(self._rows) >= _ROWS:
            self._write()

    def close(self) -> None:
        """Write the rest, and close the files."""
        try:
            self._write()
        finally:
            for log in self._logs.values():
                log.close()

    def _write(self) -> None:
        if not self._rows:
            return
        before, after, commands = zip(*self._rows, strict=True)
        self._rows.clear()
        time_s = np.array([moment.time_s for moment in before])
        begun = time_s == 0.0  # nothing was felt before
        felt = np.array([moment.specific_force for moment in after])
        earlier = np.array([moment.specific_force for moment in before])
        felt = np.where(begun[:, None], felt, 0.5 * (earlier + felt))
        series = {FLIGHT: [moment.reported for moment in before], TRUTH: [moment.state for moment in before]}
        for name, parts in series.items():
            states = np.concatenate([np.concatenate(part, axis=-1) for part in parts])
            columns = {"episode": np.full(len(time_s), self._episode), "t": time_s}
            columns |= dict(zip(MOTION, motion_of(states).T, strict=True))
            if name == FLIGHT:  # the true one is measured by nobody
                columns |= dict(zip(FELT, felt.T, strict=True))
            columns |= {f"cmd_{n}": column for n, column in enumerate(np.array(commands).T, start=1)}
            self._logs[name].write(columns)
