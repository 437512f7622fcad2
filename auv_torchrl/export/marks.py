"""Where each number of a vehicle comes from: told by data, tied to another, or from the file.

A calibrated file says in ``uncertainty`` and ``calibration`` what flights told of the parameters of effects. Which
numbers of the vehicle a parameter moves is found by moving it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np

from auv_torchrl.diagnosis.calibrate.parameters import Coefficient, read_uncertainty
from auv_torchrl.diagnosis.calibrate.vehicle_file import StoredCalibration, read_calibration
from auv_torchrl.effects import EFFECTS
from auv_torchrl.physics.coefficients import total_mass_matrix
from auv_torchrl.vehicle import Vehicle, load_vehicle, read_vehicle_file
from auv_torchrl.vehicle.changed_file import fold
from auv_torchrl.vehicle.fields import VEHICLE_FIELDS

TIED = 0.9  # correlation from which on two numbers are told together
SCALED = 0.5  # share of a width that is the scale which no log tells, from which on a number is tied to it
_STEP = 0.01  # of a width, by which a parameter is moved
_LEAST = 1e-12  # relative change that counts


class Kind(Enum):
    """Where a number comes from; the value is how tables say it."""

    TOLD = "told by data"
    TIED = "tied to another"
    FILE = "from the file"


@dataclass(frozen=True)
class Mark:
    """Where one number comes from."""

    kind: Kind
    words: str = ""  # to what it is tied, and how far it may be off

    def __str__(self) -> str:
        return f"{self.kind.value}{f': {self.words}' if self.words else ''}"


@dataclass(frozen=True)
class Described:
    """A vehicle with what its file says of its numbers."""

    name: str
    vehicle: Vehicle
    source: str  # the file
    remarks: tuple[str, ...]  # remarks at the head of the file; after a calibration the errors of held-out flight
    marks: Mapping[str, np.ndarray]  # by field, an array of Mark in its shape

    def mark(self, name: str, *place: int) -> Mark:
        """Of one number of a field; what is told of the total of a mass is told of its added mass."""
        scale = self.marks["mass_scale"]
        if name == "added_mass" and scale[place].kind is not Kind.FILE:
            return scale[place]
        return self.marks[name][place]

    @property
    def added_mass(self) -> np.ndarray:
        """(6,) of the file, with what ``mass_scale`` makes of the total of rigid body and added mass."""
        bare = self.vehicle.replace(added_mass=np.zeros(6), mass_scale=np.ones(6))
        return np.diag(total_mass_matrix(self.vehicle) - total_mass_matrix(bare))


def read_described(given: str) -> Described:
    """A vehicle by its name or file, and where its numbers come from.

    Raises:
        FileNotFoundError: for an unknown name.
        ValueError: for a file that is none of a vehicle.
    """
    content = read_vehicle_file(given)
    vehicle = load_vehicle(given)
    coefficients = read_uncertainty(content.get("uncertainty"), vehicle)
    kept = read_calibration(content.get("calibration"), coefficients)
    return Described(
        str(content.get("name", Path(given).stem)),
        vehicle,
        given,
        _head(Path(given)) if kept is not None else (),
        marks_of(vehicle, coefficients, kept),
    )


def _head(path: Path) -> tuple[str, ...]:
    """The remarks above the first entry of a file."""
    lines = []
    for line in path.expanduser().read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# ").rstrip())
    return tuple(lines)


def marks_of(
    vehicle: Vehicle, coefficients: tuple[Coefficient, ...], kept: StoredCalibration | None
) -> dict[str, np.ndarray]:
    """For each field an array of marks in its shape.

    Args:
        vehicle: no batch.
        coefficients: the uncertain parameters of the file.
        kept: what flights told of them; None where the file was not calibrated.
    """
    marks = {}
    for name in VEHICLE_FIELDS:
        marks[name] = np.full(np.shape(vehicle.get(name)), Mark(Kind.FILE), dtype=object)
    before = fold(vehicle)
    for place, coefficient in enumerate(coefficients):
        mark = _mark(place, coefficients, kept)
        after = fold(EFFECTS[coefficient.effect].apply(vehicle, {coefficient.member: _moved(coefficient)}))
        for name in marks:
            was, now = before.get(name), after.get(name)
            changed = np.abs(now - was) > _LEAST * np.maximum(np.abs(was), 1e-3)
            marks[name][changed] = mark
    return marks


def _moved(c: Coefficient) -> float:
    step = _STEP * c.width
    return c.nominal + step if c.nominal + step <= c.high else c.nominal - step


def _mark(place: int, coefficients: tuple[Coefficient, ...], kept: StoredCalibration | None) -> Mark:
    """Of one parameter."""
    c = coefficients[place]
    unit = "" if c.unit == "1" else f" {c.unit}"
    off = f"{c.effect}.{c.member} +- {c.width:.3g}{unit}"
    if kept is None:
        return Mark(Kind.FILE, f"uncertain by {off}")
    if kept.scales is not None and float(np.linalg.norm(kept.scales[place])) >= SCALED:
        return Mark(Kind.TIED, f"the overall scale of masses, thrusts and drags; {off}")
    correlation = np.abs(kept.together @ kept.together.T)
    correlation[place, place] = 0.0
    other = int(np.argmax(correlation[place]))
    if correlation[place, other] >= TIED:
        tied = coefficients[other]
        return Mark(Kind.TIED, f"{tied.effect}.{tied.member}, correlation {correlation[place, other]:.2f}; {off}")
    return Mark(Kind.TOLD, off)
