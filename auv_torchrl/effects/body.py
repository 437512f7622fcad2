"""Effects of what the vehicle is made of and carries."""

from array_api_compat import array_namespace

from auv_torchrl.array_api import vector
from auv_torchrl.effects import advice
from auv_torchrl.effects.effect import Array, Effect, Origin, Parameter, adds, changed
from auv_torchrl.effects.trial import Scan, Trial
from auv_torchrl.vehicle import CONTROLLED, CONTROLLED_INDEX, DEGREES_OF_FREEDOM, Vehicle


def per_dof(scale: Array) -> Array:
    """Spread factors of the four controlled degrees of freedom (..., 4) over all six."""
    one = array_namespace(scale).ones_like(scale[..., 0])
    among = {index: place for place, index in enumerate(CONTROLLED_INDEX)}
    return vector(*(scale[..., among[index]] if index in among else one for index in range(len(DEGREES_OF_FREEDOM))))


def _added_mass(vehicle: Vehicle, scale: Array) -> Vehicle:
    return changed(vehicle, mass_scale=vehicle.mass_scale * per_dof(scale))


added_mass = Effect(
    name="added_mass",
    origin=Origin.BODY,
    meaning="inertia per degree of freedom, on the total of rigid body and added mass",
    source="Lu et al. 2023, Eq. 13 and Table 1",
    parameters=(
        Parameter(
            "scale",
            "1",
            1.0,
            0.2,
            5.0,
            "the inertia in {which} is {value:.2f} times the nominal one",
            CONTROLLED,
            guessed=0.4,  # published added masses of one vehicle differ by that
        ),
    ),
    change=_added_mass,
    advice=advice.always(
        "look for water caught in frames and shells; if it belongs there, enter the inertia in the vehicle file"
    ),
    trial=Trial(
        wears={"scale": 1},
        scans={"scale": Scan((0.5, 0.8, 1.25, 1.6, 2.2, 3.0), all=True)},
        nuisance={"scale": 0.03},
    ),
)


def _payload(vehicle: Vehicle, mass: Array, weight: Array, x: Array, y: Array, z: Array) -> Vehicle:
    return changed(vehicle, payload_mass=mass, payload_weight=weight, payload_position=vector(x, y, z))


payload = Effect(
    name="payload",
    origin=Origin.BODY,
    meaning="a rigidly carried mass with its net weight in water, at a position in the body",
    source="Fossen 2021, Eq. 3.49, for its inertia",
    parameters=(
        Parameter("mass", "kg", 0.0, 0.0, 20.0, "it carries {quantity} more"),
        Parameter("weight", "N", 0.0, -60.0, 60.0, "the load weighs {quantity} in water"),
        Parameter("x", "m", 0.0, -1.0, 1.0, "the load sits {signed} forward of the origin"),
        Parameter("y", "m", 0.0, -1.0, 1.0, "the load sits {signed} to starboard"),
        Parameter("z", "m", 0.0, -1.0, 1.0, "the load sits {signed} below the origin"),
    ),
    change=_payload,
    advice=advice.payload,
    trial=Trial(
        together=(
            {"mass": 1.0, "weight": 3.0, "x": 0.0, "y": 0.0},
            {"mass": 2.0, "weight": 10.0, "x": 0.0, "y": 0.0},
            {"mass": 4.0, "weight": 15.0, "x": 0.0, "y": 0.0},
            {"mass": 4.0, "weight": 30.0, "x": 0.0, "y": 0.0},
            {"mass": 2.0, "weight": -10.0, "x": 0.0, "y": 0.0},
            {"mass": 8.0, "weight": 10.0, "x": 0.0, "y": 0.0},
        ),
    ),
)


buoyancy = Effect(
    name="buoyancy",
    origin=Origin.BODY,
    meaning="a constant force along earth z, down positive: trim weight missing or water inside",
    source="Lu et al. 2023, Eq. 1, the term g",
    parameters=(
        Parameter(
            "force",
            "N",
            0.0,
            -60.0,
            60.0,
            "its weight in water is off by {signed}",
            guessed=lambda vehicle, member: 0.2 * float(vehicle.mass.mean()),  # trimmed by hand, to 2 % of its weight
            varies=0.5,  # 50 g of trim, a bubble, salt
        ),
    ),
    change=adds(force="vertical_force"),
    advice=advice.buoyancy,
    trial=Trial(
        shows="idle",
        scans={"force": Scan((5.0,), linear=True)},
    ),
)


def _mass_offset(vehicle: Vehicle, x: Array, y: Array) -> Vehicle:
    offset = vector(x, y, 0 * x)
    return changed(vehicle, centre_of_mass=vehicle.centre_of_mass + offset)


mass_offset = Effect(
    name="mass_offset",
    origin=Origin.BODY,
    meaning="centre of mass off the body origin",
    source="Fossen 2021, Eq. 3.49",
    parameters=tuple(
        Parameter(
            axis,
            "m",
            0.0,
            -0.3,
            0.3,
            f"the centre of mass is {{signed}} {words} of where it should be",
            guessed=0.005,
            varies=0.001,  # a battery that sits a little otherwise
        )
        for axis, words in (("x", "forward"), ("y", "to starboard"))
    ),
    change=_mass_offset,
    advice=advice.mass_offset,
    trial=Trial(
        scans={"x": Scan((0.05,), linear=True), "y": Scan((0.05,), linear=True)},
    ),
)

EFFECTS = (added_mass, payload, buoyancy, mass_offset)
