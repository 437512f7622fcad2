"""A path from a file, recorded or drawn."""

# pyright: standard
# (the stubs of numpy do not know what linspace and unwrap return)

import csv
import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from auv_torchrl.paths import CONF
from auv_torchrl.quantities import counted
from auv_torchrl.tasks.curve import GRID_S, Curve, travelled
from auv_torchrl.tasks.tracking import Tracking

Floats = Any  # numpy, float64

EXAMPLE = "example"
EXAMPLE_PATH = CONF.parent / "examples" / "path.csv"
_PLACE, _ANGLES = ("x", "y", "z"), ("roll", "pitch", "yaw")


@dataclass(frozen=True)
class Recorded(Tracking):
    """The path of a CSV file with columns ``x,y,z`` in m, NED, and if there are any ``t`` in s and ``yaw`` in rad.

    With ``t`` it is flown as it is timed, smoothly between rows, without at the speed of the task. Without ``yaw`` the
    heading is as the task says; ``roll`` and ``pitch`` are followed with ``attitude``. Other columns are not looked at,
    so that a flight log will do.
    """

    name = "recorded"
    file: str = EXAMPLE  # path of the file; example: the one that comes with the package

    def drawn(self) -> Curve:
        """Read the file.

        Raises:
            ValueError: for a file that cannot be used, saying why.
        """
        columns = self._columns
        path = np.stack([columns[name] for name in _PLACE], axis=1)
        if len(path) < 2:
            raise self._unusable(f"it has {counted(len(path), 'row')}", "give two or more")
        if "t" not in columns:
            return self._with_heading(self.along_path(path, closed=False), columns, path)
        time = columns["t"] - columns["t"][0]
        if (np.diff(time) <= 0).any():
            row = int(np.flatnonzero(np.diff(time) <= 0)[0]) + 3  # of the file, with its head
            raise self._unusable(f"t does not grow in row {row}", "put the rows in order, each with a time of its own")
        return self._timed(time, path, columns)

    def described(self) -> dict[str, Any]:
        """With what the file says instead of where it lies."""
        digest = hashlib.sha256(self.curve.rows.tobytes()).hexdigest()[:16]
        return {**super().described(), "file": digest}

    def _timed(self, time: Floats, path: Floats, columns: dict[str, Floats]) -> Curve:
        from scipy.interpolate import PchipInterpolator  # type: ignore[import]  # here: it takes long to import

        steps = max(2, round(time[-1] / GRID_S))
        grid: Floats = np.linspace(0.0, time[-1], steps + 1)
        pose = np.zeros((steps + 1, 6))
        pose[:, :3] = PchipInterpolator(time, path)(grid)
        pose[:, 3:5] = self.roll, self.pitch
        if self.heading == "along":
            moved: Floats = np.gradient(pose[:, :2], axis=0)
            going = np.hypot(moved[:, 0], moved[:, 1]) > 1e-3 * GRID_S  # 1 mm/s; one that rests goes nowhere
            if going.any():
                yaw = np.unwrap(np.arctan2(moved[going, 1], moved[going, 0]))
                pose[:, 5] = np.interp(grid, grid[going], yaw)
        for number, name in enumerate(_ANGLES, start=3):
            if name in columns and (self.attitude or name == "yaw"):
                pose[:, number] = PchipInterpolator(time, np.unwrap(columns[name]))(grid)
        return Curve(pose, time[-1] / steps, closed=False)

    def _with_heading(self, curve: Curve, columns: dict[str, Floats], path: Floats) -> Curve:
        """The curve of a path without times with the angles of the file, by the distance flown."""
        named = [name for name in _ANGLES if name in columns and (self.attitude or name == "yaw")]
        if not named:
            return curve
        pose = curve.rows[:, :6].copy()
        corners, passed = travelled(path), travelled(pose[:, :3])
        for name in named:
            pose[:, 3 + _ANGLES.index(name)] = np.interp(passed, corners, np.unwrap(columns[name]))
        return Curve(pose, curve.step, closed=False)

    @property
    def _columns(self) -> dict[str, Floats]:
        path = EXAMPLE_PATH if self.file == EXAMPLE else Path(self.file).expanduser()
        try:
            with path.open(newline="") as file:
                head, *rows = [row for row in csv.reader(file) if row]
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise self._unusable(f"it cannot be read ({error})", "give a CSV file") from error
        except ValueError:
            raise self._unusable("it is empty", "give a CSV file with a head and rows") from None
        names = [name.strip() for name in head]
        if missing := [name for name in _PLACE if name not in names]:
            raise self._unusable(f"it has no column {', '.join(missing)}", "give x, y and z in m, and t in s if timed")
        columns: dict[str, Floats] = {}
        for name in ("t", *_PLACE, *_ANGLES):
            if name in names:
                columns[name] = self._numbers(name, names.index(name), rows)
        return columns

    def _numbers(self, name: str, column: int, rows: list[list[str]]) -> Floats:
        values = np.zeros(len(rows))
        for number, row in enumerate(rows):
            try:
                values[number] = float(row[column])
            except (ValueError, IndexError):
                values[number] = np.nan
            if not np.isfinite(values[number]):
                raise self._unusable(f"{name} in row {number + 2} is no number", "mend it or leave the row out")
        return values

    def _unusable(self, cause: str, remedy: str) -> ValueError:
        return ValueError(f"task.file is {self.file!r}: {cause}: {remedy}")
