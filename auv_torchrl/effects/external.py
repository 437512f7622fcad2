"""Effects of what is tied to the vehicle, and of where its water ends."""

from auv_torchrl.array_api import vector
from auv_torchrl.effects import advice
from auv_torchrl.effects.effect import Array, Effect, Origin, Parameter, changed, own, sets
from auv_torchrl.effects.trial import Trial
from auv_torchrl.vehicle import Vehicle


def _tether(vehicle: Vehicle, north: Array, east: Array, down: Array, stiffness: Array, slack: Array) -> Vehicle:
    anchor = vector(north, east, down)
    return changed(vehicle, tether_anchor=anchor, tether_stiffness=stiffness, tether_slack=slack)


tether = Effect(
    name="tether",
    origin=Origin.EXTERNAL,
    meaning="a spring to an anchor beyond the slack length",
    source="von Benzon et al. 2022, section on the tether, reduced to its static pull",
    parameters=(
        Parameter("north", "m", 0.0, -100.0, 100.0, "the tether leads to {signed} north"),
        Parameter("east", "m", 0.0, -100.0, 100.0, "the tether leads to {signed} east"),
        Parameter("down", "m", 0.0, -100.0, 100.0, "the tether leads to {signed} depth"),
        Parameter("stiffness", "N/m", 0.0, 0.0, 200.0, "the tether pulls with {value:.2g} N per metre of stretch"),
        Parameter("slack", "m", 0.0, 0.0, 100.0, "the tether has {quantity} of slack"),
    ),
    change=_tether,
    advice=advice.always("give the tether more slack, or fly nearer to where it leads"),
    trial=Trial(
        together=(
            {"north": 3.0, "east": 0.0, "down": -2.0, "stiffness": 5.0, "slack": 0.0},
            {"north": -3.0, "east": 0.0, "down": -2.0, "stiffness": 5.0, "slack": 0.0},
            {"north": 0.0, "east": 3.0, "down": -2.0, "stiffness": 5.0, "slack": 0.0},
            {"north": 0.0, "east": -3.0, "down": -2.0, "stiffness": 5.0, "slack": 0.0},
            {"north": 0.0, "east": 0.0, "down": -3.0, "stiffness": 5.0, "slack": 0.0},
            {"north": 0.0, "east": 0.0, "down": -3.0, "stiffness": 10.0, "slack": 3.0},
            {"north": 0.0, "east": 0.0, "down": 0.0, "stiffness": 10.0, "slack": 0.0},
            {"north": 0.0, "east": 0.0, "down": 0.0, "stiffness": 10.0, "slack": 0.5},
            {"north": 3.0, "east": 0.0, "down": 0.0, "stiffness": 10.0, "slack": 3.0},
            {"north": -3.0, "east": 0.0, "down": 0.0, "stiffness": 10.0, "slack": 3.0},
            {"north": 0.0, "east": 3.0, "down": 0.0, "stiffness": 10.0, "slack": 3.0},
            {"north": 0.0, "east": -3.0, "down": 0.0, "stiffness": 10.0, "slack": 3.0},
        ),
    ),
)


free_surface = Effect(
    name="free_surface",
    origin=Origin.EXTERNAL,
    meaning="the surface of the water: a hull that leaves it loses buoyancy and drag, a propeller its thrust",
    source="Archimedes; Minsaas, Faltinsen and Persson 1983 for the thrust; Fossen 2021, section 4.2",
    parameters=(
        Parameter("depth", "m", own("surface"), -50.0, 50.0, "the surface of the water lies at z = {quantity}"),
        Parameter("air", "1", own("air"), 0.0, 1.0, "above the surface {value:.2f} of the water's density is missing"),
    ),
    change=sets(depth="surface", air="air"),
    advice=advice.always("nothing is broken: fly clear of the surface, or enter where it lies in the vehicle file"),
    trial=Trial(
        # What was flown at the surface is left out of a log, unless the vehicle's file says where it is.
        is_searched=False,
    ),
)

EFFECTS = (tether, free_surface)
