"""What a person sees of a training: a progress bar, a CSV and, by choice, TensorBoard."""

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from auv_torchrl.files import write_whole

# One row of the learning curve, written after every stretch, by name: frames, transitions so far; wall_s and cpu_s,
# seconds of training so far, those before a resumption included; episode_return, mean return of a training episode;
# error_m and worst_m, mean and worst error of the averaged policy from the evaluation starts, t >= 10 s; best_m, lowest
# error_m so far; the losses that the agent tells; frames_per_s, wall
CurvePoint = dict[str, float]


class Progress:
    """Reports a learning curve while it grows.

    TorchRL's loggers only append: after a kill they would hold what was done since the checkpoint twice.

    Args:
        folder: where ``progress.csv`` and ``tensorboard/`` go.
        frames: transitions of the whole training.
        curve: rows of the part before a resumption.
        csv: write the CSV, as a whole after every stretch, so that it never disagrees with the checkpoint.
        tensorboard: write TensorBoard events.
    """

    def __init__(self, folder: Path, frames: int, curve: list[CurvePoint], csv: bool, tensorboard: bool):
        self.folder = folder
        self.csv = csv
        done = curve[-1]["frames"] if curve else 0
        self.bar = tqdm(total=frames, initial=done, unit="frames", unit_scale=True, desc="training", disable=None)
        self.writer = None
        if tensorboard:
            from torch.utils.tensorboard import SummaryWriter  # takes a second to import

            self.writer = SummaryWriter(str(folder / "tensorboard"), purge_step=done + 1)

    def advance(self, frames: int) -> None:
        """Move the bar."""
        self.bar.update(frames)

    def report(self, curve: list[CurvePoint]) -> None:
        """Show and write the newest row."""
        newest = curve[-1]
        self.bar.set_postfix_str(
            f"return {newest['episode_return']:.1f}, error {newest['error_m']:.4f} m, "
            f"best {newest['best_m']:.4f} m, {newest['frames_per_s']:.0f} steps/s"
        )
        if self.csv:
            write_whole(self.folder / "progress.csv", _as_csv(curve).encode())
        if self.writer is not None:
            for name, value in newest.items():
                if name != "frames":
                    self.writer.add_scalar(f"train/{name}", value, newest["frames"])

    def close(self) -> None:
        """Leave the bar as it is and flush."""
        self.bar.close()
        if self.writer is not None:
            self.writer.close()


def _as_csv(curve: Sequence[CurvePoint]) -> str:
    """A row per point, empty where a value is no number."""
    text = io.StringIO()
    writer = csv.DictWriter(text, curve[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: "" if math.isnan(value) else value for name, value in row.items()} for row in curve)
    return text.getvalue()
