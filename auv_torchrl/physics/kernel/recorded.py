"""Coefficients of vehicles as a kernel reads them: all, or what is left of them where little is out of line."""

from collections.abc import Callable, Sequence
from enum import Enum
from functools import cache
from typing import Any

import numpy as np

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.kernel.assembly import assembly
from auv_torchrl.physics.kernel.native import Code, load
from auv_torchrl.physics.kernel.program import Program
from auv_torchrl.physics.kernel.symbols import Symbols, Tape

Shapes = tuple[tuple[int, ...], ...]

# Terms that no step works out: thrust targets come before it, reports behind it.
_OUTSIDE_A_STEP = frozenset(("routing", "curve", "sensing", "sensor_noise"))
_MATRICES = ("mass_inverse", "mass_matrix", "linear_drag")
_OFF_DIAGONAL = 1.0 - np.eye(6)


class Variant(Enum):
    """What a compiled step computes; its value is the name of its machine code."""

    AZIMUTH = "azimuth"  # all terms
    FINS = "fins"  # all but azimuth thrusters
    SURFACE = "surface"  # all but fins, which take half of a step, and which few vehicles have
    DEEP = "deep"  # nor the surface of the water, which takes a quarter of a step, and which few vehicles meet
    DIAGONAL = "diagonal"  # diagonal mass and drag; no current, tether, lag, sag, uneven drag: 2 to 3 times faster

    @property
    def terms(self) -> ActiveTerms:
        """The terms that are there."""
        if self is not Variant.DIAGONAL:
            azimuth = self is Variant.AZIMUTH
            fins = azimuth or self is Variant.FINS
            surface = fins or self is Variant.SURFACE
            return ActiveTerms.everything()._replace(surface=surface, fins=fins, azimuth=azimuth)
        return ActiveTerms(*(False for _ in ActiveTerms._fields))._replace(coriolis=True)

    @staticmethod
    def full(terms: ActiveTerms) -> "Variant":
        """All terms, but azimuth thrusters, fins and the surface where there are none."""
        if terms.azimuth:
            return Variant.AZIMUTH
        if terms.fins:
            return Variant.FINS
        return Variant.SURFACE if terms.surface else Variant.DEEP

    @staticmethod
    def of(c: Coefficients) -> "Variant":
        """The least that does all that vehicles (R,), numpy, need."""
        needed, there = ActiveTerms.of(c)._asdict(), Variant.DIAGONAL.terms._asdict()
        lacking = {name for name, needs in needed.items() if needs and not there[name]} - _OUTSIDE_A_STEP
        more = bool(lacking) or bool((c.mass_matrix * _OFF_DIAGONAL).any())
        return Variant.full(ActiveTerms(**needed)) if more else Variant.DIAGONAL


def constants(c: Coefficients, dtype: Any, more: Sequence[float] = ()) -> np.ndarray:
    """All coefficients (1, R, k) of vehicles (R,), and behind them ``more`` numbers, the same for each."""
    rows = len(c.lag)
    numbers = [np.asarray(field, dtype).reshape(rows, -1) for field in c]
    return np.concatenate([*numbers, np.full((rows, len(more)), more, dtype)], axis=-1)[None]


@cache
def code_of(
    traced: Callable[[Shapes, Variant], Program], shapes: Shapes, variant: Variant, bits: int = 64
) -> Code | None:
    """The code of what is traced for vehicles whose coefficients have these shapes; None where LLVM does not run."""
    name = f"{traced.__name__}-{sizes_of(shapes)['full_thrust']}-{variant.value}-{bits}"
    return load(name, lambda: assembly(traced(shapes, variant), bits))


def sizes_of(shapes: Shapes) -> dict[str, int]:
    """Numbers that each of the coefficients of a vehicle has, by name."""
    return {name: int(np.prod(shape)) for name, shape in zip(Coefficients._fields, shapes, strict=True)}


def recorded_coefficients(tape: Tape, shapes: Shapes, variant: Variant = Variant.DEEP) -> Coefficients:
    """Coefficients of one vehicle as inputs of what a tape records, with zeros where a variant needs none."""
    c = Coefficients(*(tape.inputs(name, shape) for name, shape in zip(Coefficients._fields, shapes, strict=True)))
    if variant is not Variant.DIAGONAL:
        return c
    diagonal = {name: Symbols(np.where(_OFF_DIAGONAL, 0.0, getattr(c, name).numbers)) for name in _MATRICES}
    return c._replace(**diagonal)
