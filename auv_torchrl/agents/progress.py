"""What a person sees of a training: how far it is, and its learning curve as a CSV."""

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from auv_torchrl.files import write_whole
from auv_torchrl.progress import Progress
from auv_torchrl.quantities import quantity

# One row of the learning curve, written after every stretch, by name: frames, transitions so far; wall_s and cpu_s,
# seconds of training so far, those before a resumption included; episode_return, mean return of a training episode;
# error_m and worst_m, mean and worst error of the averaged policy from the evaluation starts, t >= 10 s; best_m, lowest
# error_m so far; the losses that the agent tells; frames_per_s, wall
CurvePoint = dict[str, float]


class CurveReport:
    """Reports a learning curve while it grows, and writes it as a whole to ``progress.csv`` after every stretch.

    So the file never disagrees with the checkpoint, unlike one that is appended to.

    Args:
        folder: where ``progress.csv`` goes.
        frames: transitions of the whole training.
        curve: rows of the part before a resumption.
    """

    def __init__(self, folder: Path, frames: int, curve: list[CurvePoint]):
        self.folder = folder
        self.done, self.frames, self.note = curve[-1]["frames"] if curve else 0, frames, ""
        self.begun = self.done  # of those before a resumption nobody can tell how long they took here
        self.progress = Progress()
        self.progress.__enter__()
        self.advance(0)

    def advance(self, frames: int) -> None:
        """Say that so many more transitions are done."""
        self.done += frames
        self.progress("training", (self.done - self.begun) / max(self.frames - self.begun, 1), self.note)

    def report(self, curve: list[CurvePoint]) -> None:
        """Show and write the newest row."""
        newest = curve[-1]
        errors = " and ".join(quantity(newest[name], "m") for name in ("error_m", "best_m"))
        self.note = f"error and best one {errors}"
        write_whole(self.folder / "progress.csv", _as_csv(curve).encode())

    def close(self) -> None:
        """Say no more."""
        self.progress.__exit__()


def _as_csv(curve: Sequence[CurvePoint]) -> str:
    """A row per point, empty where a value is no number."""
    text = io.StringIO()
    writer = csv.DictWriter(text, curve[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: "" if math.isnan(value) else value for name, value in row.items()} for row in curve)
    return text.getvalue()
