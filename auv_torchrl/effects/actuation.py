"""Effects on which thruster gets a command, and on how much and whereto it pushes."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from array_api_compat import array_namespace

from auv_torchrl.array_api import host, like, vector
from auv_torchrl.effects import advice
from auv_torchrl.effects.effect import (
    Array,
    Effect,
    Origin,
    Parameter,
    PartAbsent,
    changed,
    of_thrusters,
    own,
    scales,
    sets,
)
from auv_torchrl.effects.servos import azimuth_gain, azimuth_offset, fin_gain
from auv_torchrl.effects.trial import Same, Scan, Trial
from auv_torchrl.quantities import series
from auv_torchrl.vehicle import Vehicle

thruster_gain = Effect(
    name="thruster_gain",
    origin=Origin.ACTUATION,
    meaning="thrust of thruster i times its gain, after its limit; 0 is dead, negative is reversed",
    source="Lu et al. 2023, section 5.1, scenarios 2 and 3",
    parameters=(
        Parameter(
            "gain",
            "1",
            1.0,
            -2.0,
            2.0,
            "thruster {which} gives {value:z.2f} times its nominal thrust",
            "thruster",
            at_zero="thruster {which} gives no thrust",
            guessed=0.4,  # voltage, wake on the frame, scale of the commands: half to twice what charts say
            varies=0.03,  # volts, which all thrusters share
        ),
    ),
    change=of_thrusters(scales(gain="gain")),
    of_several="thrusters {which} do not give their nominal thrust",
    advice=advice.thruster_gain,
    trial=Trial(
        wears={"gain": -1},
        scans={"gain": Scan((0.0,), linear=True, all=True)},
        nuisance={"gain": 0.03},
    ),
)


def _swap(vehicle: Vehicle, command: Array) -> Vehicle:
    xp, number = array_namespace(command), like(command)
    giver = xp.clip(xp.round(xp.abs(command)), 1.0, float(vehicle.thrusters))[..., None]
    permutation = xp.astype(giver == xp.arange(1, vehicle.thrusters + 1, **number), command.dtype)
    return changed(vehicle, routing=(xp.sign(command)[..., None] * permutation) @ vehicle.routing)


def _read_swap(vehicle: Vehicle, settings: Mapping[str, Any]) -> dict[str, Any]:
    settings, numbers = dict(settings), range(1, vehicle.thrusters + 1)
    for key in ("pair", "cycle"):
        if key not in settings:
            continue
        ring = settings.pop(key)
        if not isinstance(ring, list | tuple) or not all(isinstance(number, int | float) for number in ring):
            raise ValueError(
                f"effect thruster_swap: {key} is {ring!r}: give a list of thrusters out of {list(numbers)}"
            )
        ring = list(ring)
        wrong_length = len(ring) != 2 if key == "pair" else len(ring) < 2
        absent = not set(ring) <= set(numbers)
        if wrong_length or absent or len(set(ring)) != len(ring):
            problem = PartAbsent if absent else ValueError
            raise problem(f"effect thruster_swap: {key} is {ring}: give different thrusters out of {list(numbers)}")
        for giver, receiver in zip(ring, ring[1:] + ring[:1], strict=True):
            settings[f"command_{receiver}"] = giver
    turned = settings.pop("reversed", [])
    if not isinstance(turned, list | tuple) or len(set(turned)) != len(turned) or not set(turned) <= set(numbers):
        raise ValueError(f"effect thruster_swap: reversed is {turned!r}: give a list of thrusters out of {[*numbers]}")
    for thruster in turned:
        settings[f"command_{thruster}"] = -settings.get(f"command_{thruster}", thruster)
    for member, given in settings.items():
        if member.startswith("command") and isinstance(given, int | float) and abs(given) not in numbers:
            raise ValueError(
                f"effect thruster_swap: {member} is {given}: give a thruster out of {[*numbers]}, negative for the "
                "opposite of its command"
            )
    return settings


def _plugs_in_words(values: Mapping[str, float]) -> str:
    """Pairs that are exchanged in one clause, then each thruster of a longer ring, then those that are reversed."""
    pairs, others = advice.exchanged(values)
    clauses = [f"the plugs of thrusters {advice.listed(pairs)} are exchanged"] if pairs else []
    clauses += [f"thruster {to} gets the command of thruster {by}" for to, by in others]
    backwards = sorted(advice.reversed_of(values), key=int)
    clauses += [f"thrusters {series(backwards)} turn the wrong way"] if len(backwards) > 1 else []
    clauses += [f"thruster {backwards[0]} turns the wrong way"] if len(backwards) == 1 else []
    return "; ".join(clauses)


def _reversed_gain(vehicle: Vehicle, member: str, command: float) -> Same | None:
    """A propeller that turns the wrong way has a gain of -1 where it pushes as hard both ways."""
    i = int(member.rsplit("_", 1)[1]) - 1
    fields = ((vehicle.asymmetry, 0.0), (vehicle.neutral_offset, 0.0), (vehicle.forward_gain, vehicle.reverse_gain))
    is_even = all(bool((host(own - other)[..., i] == 0).all()) for own, other in fields)
    gain = fin_gain if i in vehicle.fins else azimuth_gain if i in vehicle.azimuths else thruster_gain
    return (gain.name, f"gain_{i + 1}", -1.0) if is_even and command == -(i + 1) else None


thruster_swap = Effect(
    name="thruster_swap",
    origin=Origin.ACTUATION,
    meaning="thruster i gets the command meant for another; where negative the opposite of it, as by exchanged wires",
    source="Lu et al. 2023, Table 2, scenario 1",
    parameters=(
        Parameter(
            "command",
            "1",
            0.0,
            -16.0,
            16.0,
            "thruster {which} gets the command of thruster {value:.0f}",
            "thruster",
            True,
        ),
    ),
    change=_swap,
    shorthand=_read_swap,
    sentence=_plugs_in_words,
    of_several="the plugs of thrusters {which} are exchanged or reversed",
    advice=advice.thruster_swap,
    trial=Trial(same_as=_reversed_gain),
)


def _misalignment(vehicle: Vehicle, angle: Array) -> Vehicle:
    xp, direction = array_namespace(angle), vehicle.thruster_direction
    x, y, z = direction[..., 0], direction[..., 1], direction[..., 2]
    c, s = xp.cos(angle), xp.sin(angle)
    return changed(vehicle, thruster_direction=vector(c * x - s * y, s * x + c * y, z))


def _turned_by_servo(vehicle: Vehicle, member: str, value: float) -> Same | None:
    """A thruster that a servo turns about z points elsewhere where the servo stands off its middle."""
    number = int(member.rsplit("_", 1)[1])
    turns, axis = (host(own(name)(vehicle)) for name in ("turns", "thruster_direction"))
    servos = [k for k in vehicle.azimuths if turns[k] == number and abs(axis[k, 2]) == 1.0]
    return (azimuth_offset.name, f"offset_{servos[0] + 1}", value * float(axis[servos[0], 2])) if servos else None


thruster_misalignment = Effect(
    name="thruster_misalignment",
    origin=Origin.ACTUATION,
    meaning="direction of thruster i turned about the body z axis",
    source="Lu et al. 2023, section 4.1: uncertain transform from thruster forces to the generalized force",
    parameters=(
        Parameter(
            "angle",
            "rad",
            0.0,
            -1.6,
            1.6,
            "thruster {which} points {signed} off its direction",
            "thruster",
            guessed=0.05,  # brackets are straight within 3 degrees
            ordinary=0.05,
        ),
    ),
    change=of_thrusters(_misalignment),
    of_several="thrusters {which} point off their directions",
    advice=advice.thruster_misalignment,
    trial=Trial(
        same_as=_turned_by_servo,
        scans={"angle": Scan((-1.3, -0.7, -0.3, 0.3, 0.7, 1.3), all=True)},
    ),
)


def _dead(vehicle: Vehicle, member: str, value: float) -> Same | None:
    """A thruster whose limit lies within its dead band gives nothing, whatever the limit."""
    return (thruster_gain.name, member.replace("limit", "gain"), 0.0) if value < vehicle.dead_band.min() else None


thrust_limit = Effect(
    name="thrust_limit",
    origin=Origin.ACTUATION,
    meaning="saturation of thruster i in newtons; `limit` sets all",
    source="Lu et al. 2023, Eq. 2",
    parameters=(
        Parameter("limit", "N", own("limit"), 0.0, 200.0, "thruster {which} saturates at {quantity}", "thruster"),
    ),
    change=of_thrusters(sets(limit="limit")),
    of_several="thrusters {which} saturate early or late",
    advice=advice.thrust_limit,
    trial=Trial(
        wears={"limit": -1},
        same_as=_dead,
        scans={"limit": Scan((0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9), all=True, relative=True)},
    ),
)


def _place(vehicle: Vehicle, x: Array, y: Array, z: Array) -> Vehicle:
    return changed(vehicle, thruster_position=vehicle.thruster_position + vector(x, y, z))


def _guessed_place(vehicle: Vehicle, member: str) -> float:
    """Drawings and what is built differ by a third of the size of the ring of thrusters."""
    return 0.3 * float(np.linalg.norm(host(vehicle.thruster_position), axis=-1).mean())


thruster_place = Effect(
    name="thruster_place",
    origin=Origin.ACTUATION,
    meaning="thruster i sits elsewhere than the file says; along its own direction that changes nothing",
    source="Lu et al. 2023, section 4.1: uncertain transform from thruster forces to the generalized force",
    parameters=tuple(
        Parameter(
            axis,
            "m",
            0.0,
            -1.0,
            1.0,
            f"thruster {{which}} sits {{signed}} {words} where the file says",
            "thruster",
            guessed=_guessed_place,
        )
        for axis, words in (("x", "forward of"), ("y", "to starboard of"), ("z", "below"))
    ),
    change=of_thrusters(_place),
    of_several="thrusters {which} sit elsewhere than the file says",
    advice=advice.always("measure where the thrusters sit, and put it into the vehicle file (thrusters.position)"),
    is_property=True,
    trial=Trial(
        is_searched=False,  # a thruster that has moved is bent, and turned
    ),
)


def _guessed_arm(vehicle: Vehicle, member: str) -> float:
    """A third of what the file says; nothing where it leaves it out."""
    return 0.3 * abs(float(own("reaction")(vehicle)[int(member.rsplit("_", 1)[1]) - 1]))


reaction_torque = Effect(
    name="reaction_torque",
    origin=Origin.ACTUATION,
    meaning="moment of thruster i about its direction, per newton of its thrust; the sign is its sense of turning",
    source="Fossen 2021, section 9.1, propeller torque; a T200 at 16 V takes about 0.8 N m for 51.5 N: 0.016 m",
    parameters=(
        Parameter(
            "arm",
            "m",
            own("reaction"),
            -0.1,
            0.1,
            "the propeller of thruster {which} turns the vehicle by {value:+.3f} N m for each newton",
            "thruster",
            guessed=_guessed_arm,
        ),
    ),
    change=of_thrusters(sets(arm="reaction")),
    of_several="the propellers of thrusters {which} turn the vehicle",
    advice=advice.reaction_torque,
    trial=Trial(
        odds=1e-2,  # a propeller of the other hand, with its wires exchanged, is rarer than one that is worn
        scans={"arm": Scan((0.03,), linear=True)},
        nuisance={"arm": 0.1},  # of the torque of a propeller at one thrust
    ),
)

EFFECTS = (thruster_gain, thruster_swap, thruster_misalignment, thrust_limit, thruster_place, reaction_torque)
