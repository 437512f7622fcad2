"""Effects of the water on the moving body."""

from collections.abc import Callable

from array_api_compat import array_namespace

from auv_torchrl.array_api import diagonal_matrix, joined, like, vector
from auv_torchrl.effects import advice
from auv_torchrl.effects.body import per_dof
from auv_torchrl.effects.effect import Array, Effect, Origin, Parameter, changed, own, sets
from auv_torchrl.effects.trial import Scan, Trial
from auv_torchrl.vehicle import CONTROLLED, DEGREES_OF_FREEDOM, Vehicle
from auv_torchrl.vehicle.fields import GRAVITY


def _own(field: str, degree: int) -> Callable[[Vehicle], float]:
    """Nominal value of one degree of freedom's entry of a field."""

    def nominal(vehicle: Vehicle) -> float:
        values = getattr(vehicle, field)
        values = array_namespace(values).linalg.diagonal(values) if field == "linear_drag" else values
        return float(values.reshape(-1, 6)[0, degree])

    return nominal


def _hull_parameters() -> tuple[Parameter, ...]:
    found: list[Parameter] = []
    for prefix, field, words, units, highs in (
        ("linear", "linear_drag", "linear drag", ("kg/s", "kg m^2/s"), (1000.0, 50.0)),
        ("quadratic", "quadratic_drag", "quadratic drag", ("kg/m", "kg m^2"), (1500.0, 50.0)),
        ("added_mass", "added_mass", "added mass", ("kg", "kg m^2"), (300.0, 20.0)),
    ):
        for degree, name in enumerate(DEGREES_OF_FREEDOM):
            unit, high = units[degree // 3], highs[degree // 3]
            sentence = f"the {words} in {name} is {{value:.3g}} {unit}"
            found.append(Parameter(f"{prefix}_{name}", unit, _own(field, degree), 0.0, high, sentence))
    return tuple(found)


def _hull(vehicle: Vehicle, mass: Array, righting_arm: Array, **coefficients: Array) -> Vehicle:
    linear, quadratic, added = (
        vector(*(coefficients[f"{prefix}_{name}"] for name in DEGREES_OF_FREEDOM))
        for prefix in ("linear", "quadratic", "added_mass")
    )
    off_diagonal = 1 - array_namespace(mass).eye(6, **like(vehicle.linear_drag))
    centre = joined(vehicle.centre_of_buoyancy[..., :2], -righting_arm[..., None])
    return changed(
        vehicle,
        mass=mass,
        inertia=vehicle.inertia * (mass / vehicle.mass)[..., None],
        buoyancy=vehicle.buoyancy + GRAVITY * (mass - vehicle.mass),
        linear_drag=vehicle.linear_drag * off_diagonal + diagonal_matrix(linear),
        quadratic_drag=quadratic,
        added_mass=added,
        centre_of_buoyancy=centre,
    )


hull = Effect(
    name="hull",
    origin=Origin.FLOW,
    meaning="the coefficients of the hull themselves, all six degrees of freedom: what calibration fits where the "
    "published ones are a guess and may be zero, so that no scale reaches them",
    source="Fossen 2021, section 6.4, diagonal damping and added mass; section 4.1, restoring",
    parameters=(
        *_hull_parameters(),
        Parameter(
            "mass",
            "kg",
            own("mass"),
            0.1,
            1000.0,
            "it weighs {value:.3g} kg, and displaces as much",
            guessed=lambda vehicle, member: 0.1 * float(vehicle.mass.mean()),  # what one carries and the other does not
        ),
        Parameter(
            "righting_arm",
            "m",
            lambda vehicle: -float(vehicle.centre_of_buoyancy.reshape(-1, 3)[0, 2]),
            -0.1,
            1.0,
            "the centre of buoyancy is {quantity} above the origin",
        ),
    ),
    change=_hull,
    trial=Trial(
        covers=("linear_drag", "quadratic_drag", "added_mass"),
        shows="axes",
        is_searched=False,
    ),
)


_LOOK = "look for weed, line and what was put on or lost; if it is meant, enter the drag in the vehicle file"


def _linear(vehicle: Vehicle, scale: Array) -> Vehicle:
    return changed(vehicle, linear_drag=per_dof(scale)[..., :, None] * vehicle.linear_drag)


def _quadratic(vehicle: Vehicle, scale: Array) -> Vehicle:
    return changed(vehicle, quadratic_drag=per_dof(scale) * vehicle.quadratic_drag)


def _drag(order: str, change: Callable[[Vehicle, Array], Vehicle]) -> Effect:
    """Drag that grows with the speed, or with its square, per degree of freedom."""
    clause = f"the {order} drag in {{which}} is {{value:.2f}} times the nominal one"
    published = 0.4  # published drags of one vehicle differ by that
    return Effect(
        name=f"{order}_drag",
        origin=Origin.FLOW,
        meaning=f"{order} drag per degree of freedom times its scale",
        source="Lu et al. 2023, Eq. 14 and Table 1",
        parameters=(Parameter("scale", "1", 1.0, 0.0, 10.0, clause, CONTROLLED, guessed=published),),
        change=change,
        advice=advice.always(_LOOK),
        trial=Trial(
            wears={"scale": 1},
            scans={"scale": Scan((1.5,), linear=True, all=True)},
            nuisance={"scale": 0.03},
        ),
    )


TRAVELLED = ("surge", "sway", "heave")


def _uneven(vehicle: Vehicle, asymmetry: Array) -> Vehicle:
    return changed(vehicle, drag_asymmetry=vehicle.drag_asymmetry + joined(asymmetry, 0 * asymmetry))


drag_asymmetry = Effect(
    name="drag_asymmetry",
    origin=Origin.FLOW,
    meaning="quadratic drag times 1 + asymmetry ahead, to starboard or down, and times 1 - asymmetry the other way",
    source="Hoerner 1965, Fluid-Dynamic Drag, chapter 3: of a blunt body it is another one by which end leads",
    parameters=(
        Parameter(
            "asymmetry",
            "1",
            0.0,
            -0.9,
            0.9,
            "the quadratic drag in {which} is {value:+.2f} of itself larger ahead, to starboard or down, and as much "
            "smaller the other way",
            TRAVELLED,
        ),
    ),
    change=_uneven,
    is_property=True,
    advice=advice.always(
        "look for what hangs or grows on one end; if it is meant, enter drag_asymmetry in the vehicle file"
    ),
    trial=Trial(
        shows="axes",
        scans={"asymmetry": Scan((0.3,), linear=True)},
    ),
)

linear_drag, quadratic_drag = _drag("linear", _linear), _drag("quadratic", _quadratic)

COUPLINGS = tuple(f"{to}_from_{by}" for to in CONTROLLED for by in CONTROLLED if to != by)


def _coupling(vehicle: Vehicle, drag: Array) -> Vehicle:
    none = array_namespace(drag).zeros_like(drag[..., 0])
    given = {name: drag[..., column] for column, name in enumerate(COUPLINGS)}
    rows = (vector(*(given.get(f"{to}_from_{by}", none) for by in DEGREES_OF_FREEDOM)) for to in DEGREES_OF_FREEDOM)
    entries = array_namespace(drag).stack(tuple(rows), axis=-2)
    return changed(vehicle, linear_drag=vehicle.linear_drag + entries)


def _guessed_coupling(vehicle: Vehicle, member: str) -> float:
    """A tenth of the drags that it couples, at 1 m/s and 1 rad/s, in their mean: no hull is quite symmetric."""
    both = member.removeprefix("drag_").split("_from_")
    linear = array_namespace(vehicle.mass).linalg.diagonal(vehicle.linear_drag).reshape(-1, 6)[0]
    drag = linear + vehicle.quadratic_drag.reshape(-1, 6)[0]
    one, other = (float(drag[DEGREES_OF_FREEDOM.index(name)]) for name in both)
    return 0.1 * (one * other) ** 0.5


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
            guessed=_guessed_coupling,
        ),
    ),
    change=_coupling,
    advice=advice.always("look for what sits or trails on one side alone"),
    trial=Trial(
        shows="turning",
        scans={"drag": Scan((5.0,), linear=True)},
    ),
)


coriolis = Effect(
    name="coriolis",
    origin=Origin.FLOW,
    meaning="rigid-body and added-mass Coriolis terms: 0 none, 1 all",
    source="Fossen 2021, Theorem 3.2",
    parameters=(
        Parameter("strength", "1", own("coriolis"), 0.0, 2.0, "Coriolis terms act at {value:.2f} of full strength"),
    ),
    change=sets(strength="coriolis"),
    is_property=True,
    advice=advice.always("enter how far Coriolis terms act in the vehicle file"),
    trial=Trial(
        scans={"strength": Scan((1.0,), linear=True)},
    ),
)


def _current(vehicle: Vehicle, north: Array, east: Array, down: Array) -> Vehicle:
    return changed(vehicle, current=vehicle.current + vector(north, east, down))


current = Effect(
    name="current",
    origin=Origin.FLOW,
    meaning="velocity of the water; drag acts on the relative velocity",
    source="Fossen 2021, section 10.3",
    parameters=(
        Parameter("north", "m/s", 0.0, -2.0, 2.0, "the water moves north at {signed}", varies=0.02),
        Parameter("east", "m/s", 0.0, -2.0, 2.0, "the water moves east at {signed}", varies=0.02),
        Parameter("down", "m/s", 0.0, -2.0, 2.0, "the water moves down at {signed}"),
    ),
    change=_current,
    advice=advice.always("nothing is broken: fly where the water stands still, or train for this current"),
    trial=Trial(
        scans={
            "north": Scan((0.1,), linear=True),
            "east": Scan((0.1,), linear=True),
            "down": Scan((0.1,), linear=True),
        },
    ),
)

EFFECTS = (hull, linear_drag, quadratic_drag, drag_asymmetry, drag_coupling, coriolis, current)
