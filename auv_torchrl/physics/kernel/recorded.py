"""Coefficients of a vehicle as a tape records them: all, or what is left of them where little is out of line."""

from enum import Enum

import numpy as np

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.kernel.symbols import Symbols, Tape

Shapes = tuple[tuple[int, ...], ...]

_MATRICES = ("mass_inverse", "mass_matrix", "linear_drag")
_OFF_DIAGONAL = 1.0 - np.eye(6)


class Variant(Enum):
    """What a compiled step computes; its value is the name of its machine code."""

    EVERYTHING = "everything"  # all terms
    DIAGONAL = "diagonal"  # diagonal mass and drag; no current, tether, lag, sag and uneven drag: 2 to 3 times faster

    @property
    def terms(self) -> ActiveTerms:
        """The terms that are there."""
        if self is Variant.EVERYTHING:
            return ActiveTerms.everything()
        return ActiveTerms(*(False for _ in ActiveTerms._fields))._replace(coriolis=True)

    @staticmethod
    def of(c: Coefficients) -> "Variant":
        """The least that does all that vehicles (R,), numpy, need."""
        needed, there = ActiveTerms.of(c), Variant.DIAGONAL.terms
        of_motion = ("current", "tether", "lag", "battery_sag", "coupled_drag", "uneven_drag", "coupled_mass")
        more = any(getattr(needed, name) and not getattr(there, name) for name in of_motion)
        coupled = any(bool((getattr(c, name) * _OFF_DIAGONAL).any()) for name in _MATRICES)
        return Variant.EVERYTHING if more or coupled else Variant.DIAGONAL


def coefficient_sizes(shapes: Shapes) -> dict[str, int]:
    """Numbers that each of the coefficients of a vehicle has, by name."""
    return {name: int(np.prod(shape)) for name, shape in zip(Coefficients._fields, shapes, strict=True)}


def recorded_coefficients(tape: Tape, shapes: Shapes, variant: Variant = Variant.EVERYTHING) -> Coefficients:
    """Coefficients of one vehicle as inputs of what a tape records, with zeros where a variant needs none."""
    c = Coefficients(*(tape.inputs(name, shape) for name, shape in zip(Coefficients._fields, shapes, strict=True)))
    if variant is Variant.EVERYTHING:
        return c
    diagonal = {name: Symbols(np.where(_OFF_DIAGONAL, 0.0, getattr(c, name).numbers)) for name in _MATRICES}
    return c._replace(**diagonal)
