"""Effects of the water on the moving body."""

import torch
from torch import Tensor

from auv_torchrl.effects.body import per_dof
from auv_torchrl.effects.effect import PER_DOF, Effect, Origin, Parameter, changed, own
from auv_torchrl.vehicle import DEGREES_OF_FREEDOM, Vehicle


def _linear(vehicle: Vehicle, scale: Tensor) -> Vehicle:
    return changed(vehicle, linear_drag=per_dof(scale)[..., :, None] * vehicle.linear_drag)


linear_drag = Effect(
    name="linear_drag",
    origin=Origin.FLOW,
    meaning="linear drag per degree of freedom times its scale",
    source="Lu et al. 2023, Eq. 14 and Table 1",
    parameters=(
        Parameter(
            "scale", "1", 1.0, 0.0, 10.0, "the linear drag in {which} is {value:.2f} times the nominal one", PER_DOF
        ),
    ),
    change=_linear,
)


def _quadratic(vehicle: Vehicle, scale: Tensor) -> Vehicle:
    return changed(vehicle, quadratic_drag=per_dof(scale) * vehicle.quadratic_drag)


quadratic_drag = Effect(
    name="quadratic_drag",
    origin=Origin.FLOW,
    meaning="quadratic drag per degree of freedom times its scale",
    source="Lu et al. 2023, Eq. 14 and Table 1",
    parameters=(
        Parameter(
            "scale", "1", 1.0, 0.0, 10.0, "the quadratic drag in {which} is {value:.2f} times the nominal one", PER_DOF
        ),
    ),
    change=_quadratic,
)

COUPLINGS = tuple(f"{to}_from_{by}" for to in PER_DOF for by in PER_DOF if to != by)


def _coupling(vehicle: Vehicle, drag: Tensor) -> Vehicle:
    entries = torch.zeros((*drag.shape[:-1], 6, 6), dtype=drag.dtype, device=drag.device)
    for column, name in enumerate(COUPLINGS):
        to, by = name.split("_from_")
        entries[..., DEGREES_OF_FREEDOM.index(to), DEGREES_OF_FREEDOM.index(by)] = drag[..., column]
    return changed(vehicle, linear_drag=vehicle.linear_drag + entries)


drag_coupling = Effect(
    name="drag_coupling",
    origin=Origin.FLOW,
    meaning="off-diagonal terms of the linear drag: speed in one degree of freedom gives force in another",
    source="Fossen 2021, section 6.5: a body without the assumed symmetry planes",
    parameters=(
        Parameter(
            "drag",
            "kg/s, kg m/s",
            0.0,
            -100.0,
            100.0,
            "the drag {which} is {value:+.2f} although none is modelled",
            COUPLINGS,
        ),
    ),
    change=_coupling,
)


def _coriolis(vehicle: Vehicle, strength: Tensor) -> Vehicle:
    return changed(vehicle, coriolis=strength)


coriolis = Effect(
    name="coriolis",
    origin=Origin.FLOW,
    meaning="rigid-body and added-mass Coriolis terms: 0 none, 1 all",
    source="Fossen 2021, Theorem 3.2",
    parameters=(
        Parameter("strength", "1", own("coriolis"), 0.0, 2.0, "Coriolis terms act at {value:.2f} of full strength"),
    ),
    change=_coriolis,
)


def _current(vehicle: Vehicle, north: Tensor, east: Tensor, down: Tensor) -> Vehicle:
    return changed(vehicle, current=vehicle.current + torch.stack((north, east, down), dim=-1))


current = Effect(
    name="current",
    origin=Origin.FLOW,
    meaning="velocity of the water; drag acts on the relative velocity",
    source="Fossen 2021, section 10.3",
    parameters=(
        Parameter("north", "m/s", 0.0, -2.0, 2.0, "the water moves north at {value:+.2f} m/s"),
        Parameter("east", "m/s", 0.0, -2.0, 2.0, "the water moves east at {value:+.2f} m/s"),
        Parameter("down", "m/s", 0.0, -2.0, 2.0, "the water moves down at {value:+.2f} m/s"),
    ),
    change=_current,
)

EFFECTS = (linear_drag, quadratic_drag, drag_coupling, coriolis, current)
