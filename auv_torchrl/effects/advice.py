"""What to do about an effect that was found, in the words of the vehicle's owner.

Each function takes the values that depart from nominal, by member, and the autopilot's parameters as far as the log
tells them. An effect of one's own declares such a function as its ``advice``.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from auv_torchrl.autopilot import function_of, is_function
from auv_torchrl.quantities import percent
from auv_torchrl.vehicle.fields import GRAVITY

Values = Mapping[str, float]

LEAD = 1.1  # kg of lead for each kg in water: 11,340 kg/m^3 against 1,025 kg/m^3
DEAD = 0.1  # of the thrust, below which a thruster is said to give nothing
REVERSED = -0.5  # times the thrust, beyond which it is the direction alone that is wrong
SOUND = 1.0
NEUTRAL, PULSE = 1500.0, 400.0  # us, at command 0 and between that and full command: what ArduSub sends to a thruster


@dataclass(frozen=True)
class Advice:
    """One thing to do."""

    do: str  # a sentence without its full stop
    param: Values = field(default_factory=dict[str, float])  # of the autopilot, to set where they are the remedy


def thruster_gain(values: Values, autopilot: Values) -> tuple[Advice, ...]:
    """Of a thruster that is dead, weak, strong or turns the wrong way."""
    return tuple(_gain(which(member), gain, autopilot) for member, gain in values.items())


def _gain(thruster: str, gain: float, autopilot: Values) -> Advice:
    if gain <= -DEAD:
        weak = "" if gain <= REVERSED else "; it is weak, too: look for weed or a propeller of the other hand"
        return _turned_back(thruster, autopilot, weak)
    if gain < DEAD:
        return Advice(
            f"thruster {thruster} gives nothing: look whether its propeller is there and free, then at its plug, its "
            "speed controller and the output that it is on"
        )
    gives = f"thruster {thruster} gives {percent(gain)} of its thrust"
    if gain < SOUND:
        return Advice(f"{gives}: look for weed or line, a broken blade or a bad phase")
    return Advice(f"{gives}: compare its propeller and its volts with the vehicle file")


Adviser = Callable[[Values, Values], tuple[Advice, ...]]


def servo_gain(called: str) -> Adviser:
    """Of a servo, ``called`` so, that stays where it is, turns the wrong way, or not as far as it is told."""
    return lambda values, autopilot: tuple(_servo(f"{called} {which(m)}", gain) for m, gain in values.items())


def _servo(name: str, gain: float) -> Advice:
    if gain <= -DEAD:
        return Advice(f"{name} turns the wrong way: exchange the ends of its servo in the autopilot, or its linkage")
    if gain < DEAD:
        return Advice(f"{name} does not follow its command: look at its servo, its power and its linkage")
    return Advice(f"{name} turns {percent(gain)} as far as it is told: look at its linkage and the ends of its servo")


def servo_offset(called: str) -> Adviser:
    """Of a servo that is off its middle."""

    def advise(values: Values, autopilot: Values) -> tuple[Advice, ...]:
        turned = [f"{called} {which(member)} by {-math.degrees(angle):+.0f}°" for member, angle in values.items()]
        return (Advice(f"set the middle of {' and '.join(turned)}: at its servo horn, or as the trim of its output"),)

    return advise


def servo_stuck(called: str) -> Adviser:
    """Of a servo that stands still."""

    def advise(values: Values, autopilot: Values) -> tuple[Advice, ...]:
        stuck = sorted({which(member) for member in values}, key=int)
        return tuple(Advice(f"{called} {n} is stuck: look at its servo, its power and its linkage") for n in stuck)

    return advise


def _turned_back(thruster: str, autopilot: Values, besides: str = "") -> Advice:
    """Of a propeller that turns the wrong way."""
    name = f"MOT_{thruster}_DIRECTION"
    if abs(autopilot.get(name, 0.0)) == 1:  # else it is no direction, and its sign says nothing
        set_to = -autopilot[name]
        return Advice(f"set {name} to {set_to:g} (it is {autopilot[name]:g}){besides}", {name: set_to})
    return Advice(
        f"thruster {thruster} turns the wrong way: change the sign of {name}, or exchange two of its three "
        f"phase wires{besides}"
    )


def thruster_swap(values: Values, autopilot: Values) -> tuple[Advice, ...]:
    """Of thrusters that get each other's commands, or the opposite of one."""
    pairs, others = exchanged(values)
    found: list[Advice] = []
    if pairs:
        there = {n: v for a, b in pairs for to, by in ((a, b), (b, a)) for n, v in _function(to, by, autopilot).items()}
        known = len(there) == 2 * len(pairs)
        either = "or set " + " and ".join(f"{n} to {v:g}" for n, v in there.items()) if known else (
            "or the values of " + ", and of ".join(f"SERVO{a}_FUNCTION and SERVO{b}_FUNCTION" for a, b in pairs)
        )  # fmt: skip
        found.append(Advice(f"exchange the plugs of motors {listed(pairs)}, {either}", there if known else {}))
    for to, by in others:
        there = _function(to, by, autopilot)
        either = "".join(f", or set {name} to {value:g}" for name, value in there.items())
        lost = f"thruster {to} is plugged in where thruster {by} belongs: put it on its own output{either}"
        found.append(Advice(lost, there))
    return *found, *(_turned_back(thruster, autopilot) for thruster in reversed_of(values))


def reversed_of(values: Values) -> list[str]:
    """Thrusters that get the opposite of a command."""
    return [which(member) for member, command in values.items() if command < 0]


def exchanged(values: Values) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """Pairs of thrusters that get each other's commands; then of all others each, and whose command it gets."""
    giver = {which(member): f"{abs(command):.0f}" for member, command in values.items()}
    pairs = sorted((to, by) for to, by in giver.items() if giver.get(by) == to and int(to) < int(by))
    paired = {thruster for pair in pairs for thruster in pair}
    return pairs, [(to, by) for to, by in giver.items() if to not in paired and to != by]


def listed(pairs: Sequence[tuple[str, str]]) -> str:
    """Pairs in words: ``1 and 2, and 3 and 4``."""
    return ", and ".join(f"{a} and {b}" for a, b in pairs)


def _function(to: str, by: str, autopilot: Values) -> dict[str, float]:
    """The output that thruster ``to`` is plugged into, which has the function of ``by``, and what to set it to."""
    wanted, had = (float(function_of(int(number))) for number in (to, by))
    return {name: wanted for name, value in autopilot.items() if is_function(name) and value == had}


def thruster_misalignment(values: Values, autopilot: Values) -> tuple[Advice, ...]:
    """Of a thruster that points elsewhere."""
    return tuple(
        Advice(
            f"turn thruster {which(member)} by {-math.degrees(angle):+.0f}° about the vertical, clockwise from above "
            "positive, and look at its bracket"
        )
        for member, angle in values.items()
    )


def one_way_gain(way: str, values: Values, autopilot: Values) -> tuple[Advice, ...]:
    """Of thrusters that push otherwise ``forwards`` or ``backwards`` than the other way."""
    return tuple(_one_way(which(member), way, gain) for member, gain in values.items())


def _one_way(thruster: str, way: str, gain: float) -> Advice:
    if gain < -DEAD:
        does = f"thruster {thruster} pushes the other way when it is told to push {way}"
    elif gain < DEAD:
        does = f"thruster {thruster} gives nothing {way}"
    else:
        does = f"thruster {thruster} gives {percent(gain)} of its thrust {way} and all of it the other way"
    return Advice(
        f"{does}: set its speed controller to both ways (bidirectional) and calibrate it with neutral at "
        f"{NEUTRAL:.0f} µs; if that does not help, exchange the controller with that of a neighbour"
    )


def neutral_offset(values: Values, autopilot: Values) -> tuple[Advice, ...]:
    """Of thrusters that push at rest; those that stand still at one pulse in one sentence."""
    by_pulse: dict[str, dict[str, float]] = {}
    for member, offset in values.items():
        by_pulse.setdefault(_still_at(which(member), offset, autopilot), {})[member] = offset
    return tuple(_neutral(its, pulse) for pulse, its in by_pulse.items())


def _still_at(thruster: str, offset: float, autopilot: Values) -> str:
    direction, off = autopilot.get(f"MOT_{thruster}_DIRECTION", 0.0), PULSE * offset
    return f"{NEUTRAL + direction * off:.0f} µs" if abs(direction) == 1 else f"{abs(off):.0f} µs beside {NEUTRAL:.0f}"


def _neutral(values: Values, pulse: str) -> Advice:
    stand, its, each = ("stands", "its", "") if len(values) == 1 else ("stand", "their", "s")
    return Advice(
        f"{_numbered(values)} {stand} still at {pulse}: set the trim of {its} output{each} (SERVOn_TRIM) to "
        f"{NEUTRAL:.0f}, and calibrate {its} speed controller{each} with neutral at {NEUTRAL:.0f} µs, "
        "which ArduSub sends at rest"
    )


def thrust_limit(values: Values, autopilot: Values) -> tuple[Advice, ...]:
    """Of thrusters that saturate."""
    named = _numbered(values)
    return (Advice(f"look at the volts under load, and at the current and pulse limits of {named}"),)


def reaction_torque(values: Values, autopilot: Values) -> tuple[Advice, ...]:
    """Of propellers that turn the vehicle otherwise than its file says."""
    named = _numbered(values)
    return (
        Advice(f"look which hand the propeller of {named} is of, and enter its sense in the vehicle file (reaction)"),
    )


def compass_interference(values: Values, autopilot: Values) -> tuple[Advice, ...]:
    """Of a compass that turns with the current drawn."""
    (angle,) = values.values()
    turned = f"{math.degrees(angle):+.0f}° at full thrust"
    say = f"move the compass away from power wires, or twist those: it turns by {turned}"
    if autopilot.get("COMPASS_MOTCT") == 0:
        return (Advice(f"{say}; or calibrate it against the current, COMPASS_MOTCT 2"),)
    return (Advice(say),)


def buoyancy(values: Values, autopilot: Values) -> tuple[Advice, ...]:
    """Of a vehicle too heavy or too light."""
    (force,) = values.values()
    grams = abs(force) / GRAVITY * 1000
    if force > 0:
        return (
            Advice(f"look for water inside and for what it carries, then add about {grams:.0f} g of lift in float"),
        )
    return (Advice(f"add about {grams:.0f} g of ballast as weighed in water, which is {LEAD * grams:.0f} g of lead"),)


def payload(values: Values, autopilot: Values) -> tuple[Advice, ...]:
    """Of something that is carried."""
    place = ", ".join(
        f"{abs(values[axis]):.2f} m {ahead if values[axis] > 0 else behind}"
        for axis, ahead, behind in (("x", "forward", "aft"), ("y", "to starboard", "to port"), ("z", "below", "above"))
        if axis in values
    )
    found = [Advice(f"look for what it carries{' ' + place + ' of the origin' if place else ''}")]
    if weight := values.get("weight", 0.0):
        grams = abs(weight) / GRAVITY * 1000
        trim = f"{grams:.0f} g of lift in float" if weight > 0 else f"{LEAD * grams:.0f} g of lead"
        found.append(Advice(f"if it is to stay, trim it with about {trim} at the same place"))
    return tuple(found)


def mass_offset(values: Values, autopilot: Values) -> tuple[Advice, ...]:
    """Of a centre of mass that lies elsewhere."""
    names = {"x": ("aft", "forward"), "y": ("to port", "to starboard")}
    moves = [f"{abs(at) * 100:.1f} cm {names[axis][0 if at > 0 else 1]}" for axis, at in values.items()]
    return (Advice(f"move ballast so that the centre of mass goes {' and '.join(moves)}, or look for what shifted"),)


def heading_bias(values: Values, autopilot: Values) -> tuple[Advice, ...]:
    """Of a compass that is off."""
    (angle,) = values.values()
    degrees = f"{math.degrees(angle):+.0f}°"
    return (Advice(f"calibrate the compass away from iron: it is off by {degrees}; turn a motion-capture frame back"),)


def dvl_misalignment(values: Values, autopilot: Values) -> tuple[Advice, ...]:
    """Of a Doppler log that is turned on its bracket."""
    (angle,) = values.values()
    turned = f"{-math.degrees(angle):+.0f}° about the vertical, clockwise from above positive"
    return (Advice(f"turn the Doppler log by {turned}, or tell what reads it and the vehicle file (dvl_turn)"),)


def dvl_lever_arm(values: Values, autopilot: Values) -> tuple[Advice, ...]:
    """Of a Doppler log that sits elsewhere."""
    moved = ", ".join(f"{arm:+.2f} m in {member.removeprefix('arm_')}" for member, arm in values.items())
    return (Advice(f"measure where the Doppler log sits, and enter it in the vehicle file (dvl_position): {moved}"),)


def depth_bias(values: Values, autopilot: Values) -> tuple[Advice, ...]:
    """Of a pressure sensor that was not zeroed."""
    (offset,) = values.values()
    return (Advice(f"zero the pressure sensor at the surface before the dive: it reads {offset:+.2f} m too much"),)


def always(do: str) -> Callable[[Values, Values], tuple[Advice, ...]]:
    """The same sentence whatever the values."""
    return lambda values, autopilot: (Advice(do),)


def which(member: str) -> str:
    """The number of the thruster in ``gain_4``."""
    return member.rsplit("_", 1)[1]


def _numbered(members: Values) -> str:
    numbers = sorted((which(member) for member in members), key=int)
    return f"thruster{'s' if len(numbers) > 1 else ''} {', '.join(numbers)}"
