"""Effects between the command and the force of a thruster."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from auv_torchrl.effects import advice
from auv_torchrl.effects.effect import Effect, Origin, Parameter, Same, Valley, changed, in_proportion, mean, own, sets
from auv_torchrl.effects.scan import DELAYS, Scan
from auv_torchrl.vehicle import Vehicle


def _gain(vehicle: Vehicle, gain: Tensor) -> Vehicle:
    return changed(vehicle, gain=vehicle.gain * gain)


thruster_gain = Effect(
    name="thruster_gain",
    origin=Origin.ACTUATION,
    meaning="thrust of thruster i times its gain, after its limit; 0 is dead, negative is reversed",
    source="Lu et al. 2023, section 5.1, scenarios 2 and 3",
    parameters=(
        Parameter(
            "gain", "1", 1.0, -2.0, 2.0, "thruster {which} gives {value:z.2f} times its nominal thrust", "thruster"
        ),
    ),
    change=_gain,
    advice=advice.thruster_gain,
    scans={"gain": Scan((0.0,), linear=True, all=True)},
    slack={"gain": 0.03},
)


def _swap(vehicle: Vehicle, command: Tensor) -> Vehicle:
    order = command.round().long().clamp(1, vehicle.thrusters) - 1
    permutation = torch.nn.functional.one_hot(order, vehicle.thrusters).to(vehicle.routing.dtype)
    return changed(vehicle, routing=permutation @ vehicle.routing)


def _read_swap(vehicle: Vehicle, settings: Mapping[str, Any]) -> dict[str, Any]:
    settings = dict(settings)
    for key in ("pair", "cycle"):
        if key not in settings:
            continue
        ring, numbers = settings.pop(key), range(1, vehicle.thrusters + 1)
        if not isinstance(ring, list | tuple) or not all(isinstance(number, int | float) for number in ring):
            raise ValueError(
                f"effect thruster_swap: {key} is {ring!r}: give a list of thrusters out of {list(numbers)}"
            )
        ring = list(ring)
        wrong_length = len(ring) != 2 if key == "pair" else len(ring) < 2
        if wrong_length or len(set(ring)) != len(ring) or not set(ring) <= set(numbers):
            raise ValueError(f"effect thruster_swap: {key} is {ring}: give different thrusters out of {list(numbers)}")
        for giver, receiver in zip(ring, ring[1:] + ring[:1], strict=True):
            settings[f"command_{receiver}"] = giver
    return settings


thruster_swap = Effect(
    name="thruster_swap",
    origin=Origin.ACTUATION,
    meaning="thruster i gets the command meant for another; `pair: [1, 2]` exchanges two, `cycle: [1, 2, 3]` passes "
    "the command of 1 to 2, of 2 to 3 and of 3 to 1",
    source="Lu et al. 2023, Table 2, scenario 1",
    parameters=(
        Parameter(
            "command",
            "1",
            0.0,
            1.0,
            16.0,
            "thruster {which} gets the command of thruster {value:.0f}",
            "thruster",
            True,
        ),
    ),
    change=_swap,
    shorthand=_read_swap,
    advice=advice.thruster_swap,
)


def _misalignment(vehicle: Vehicle, angle: Tensor) -> Vehicle:
    x, y, z = vehicle.thruster_direction.unbind(-1)
    c, s = angle.cos(), angle.sin()
    return changed(vehicle, thruster_direction=torch.stack((c * x - s * y, s * x + c * y, z), dim=-1))


thruster_misalignment = Effect(
    name="thruster_misalignment",
    origin=Origin.ACTUATION,
    meaning="direction of thruster i turned about the body z axis",
    source="Lu et al. 2023, section 4.1: uncertain transform from thruster forces to the generalized force",
    parameters=(
        Parameter(
            "angle", "rad", 0.0, -1.6, 1.6, "thruster {which} points {value:+.2f} rad off its direction", "thruster"
        ),
    ),
    change=_misalignment,
    advice=advice.thruster_misalignment,
    scans={"angle": Scan((-1.3, -0.7, -0.3, 0.3, 0.7, 1.3), all=True)},
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
        Parameter("limit", "N", own("limit"), 0.0, 200.0, "thruster {which} saturates at {value:.1f} N", "thruster"),
    ),
    change=sets(limit="limit"),
    same_as=_dead,
    advice=advice.thrust_limit,
    scans={"limit": Scan((0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9), all=True, relative=True)},
)


def _dead_band(vehicle: Vehicle, width: Tensor) -> Vehicle:
    return changed(vehicle, dead_band=in_proportion(vehicle.dead_band, width))


dead_band = Effect(
    name="dead_band",
    origin=Origin.ACTUATION,
    meaning="no thrust below this many newtons, all thrusters; the mean where they differ, which stay in proportion",
    source="Lu et al. 2023, Eq. 2",
    parameters=(
        Parameter("width", "N", own("dead_band"), 0.0, 30.0, "the thrusters give nothing below {value:.1f} N"),
    ),
    change=_dead_band,
    advice=advice.said(
        "look at the pulse limits of the speed controllers; if the dead band is theirs, enter it in the vehicle file"
    ),
    scans={"width": Scan((0.0, 2.5, 7.5, 10.0, 12.5, 15.0, 20.0, 25.0))},
    slack={"width": 0.03},
    is_rough=True,
)


def _curve(vehicle: Vehicle, exponent: Tensor, asymmetry: Tensor) -> Vehicle:
    return changed(
        vehicle,
        exponent=in_proportion(vehicle.exponent, exponent),
        asymmetry=in_proportion(vehicle.asymmetry, asymmetry, zero=1.0),  # what is left in reverse is 1 less it
    )


def _same_commands(vehicle: Vehicle, step: float) -> dict[tuple[str, str], float]:
    """Moves of the means, under another exponent, with which the same commands get through the dead band."""
    fields = vehicle.exponent, vehicle.dead_band, vehicle.full_thrust, vehicle.asymmetry
    now, width, full, weaker = (float(mean(values[0])) for values in fields)
    power = (now + step) / now  # these commands have their thrust, over the full one, to this power
    return {
        ("thrust_curve", "exponent"): step,
        ("dead_band", "width"): full * (width / full) ** power - width,
        ("thrust_curve", "asymmetry"): (1 - weaker) - (1 - weaker) ** power,
    }


thrust_curve = Effect(
    name="thrust_curve",
    origin=Origin.ACTUATION,
    meaning="F = full sign(c) |c|^exponent, reverse thrust times (1 - asymmetry), then limit and dead band; the means "
    "where thrusters differ, which stay in proportion",
    source="Blue Robotics T200 chart",
    parameters=(
        Parameter("exponent", "1", own("exponent"), 0.5, 3.0, "thrust grows as the command to the power {value:.2f}"),
        Parameter("asymmetry", "1", own("asymmetry"), -0.6, 0.6, "reverse thrust is weaker by {value:.0%}"),
    ),
    change=_curve,
    valley=Valley("exponent", ("dead_band", "width"), _same_commands),
    advice=advice.said("enter the curve of these propellers at this voltage in the vehicle file"),
    scans={"exponent": Scan((0.7, 0.85, 1.2, 1.5, 1.8, 2.2, 2.6)), "asymmetry": Scan((0.3,), linear=True)},
)


def _lag(vehicle: Vehicle, time_constant: Tensor) -> Vehicle:
    return changed(vehicle, lag=in_proportion(vehicle.lag, time_constant))


thruster_lag = Effect(
    name="thruster_lag",
    origin=Origin.ACTUATION,
    meaning="thrust follows its target with a first-order time constant; the mean where thrusters differ, which stay "
    "in proportion",
    source="Yoerger, Cooke and Slotine 1990, thruster dynamics",
    parameters=(
        Parameter("time_constant", "s", own("lag"), 0.0, 1.5, "thrust follows the command with a lag of {value:.2f} s"),
    ),
    change=_lag,
    advice=advice.said("look at the ramp of the speed controllers; if the lag is theirs, enter it in the vehicle file"),
    scans={"time_constant": Scan((0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.2))},
)


command_delay = Effect(
    name="command_delay",
    origin=Origin.ACTUATION,
    meaning="commands reach the thrusters late",
    source="network and driver latency; a T200's own dead time is 13 ms",
    parameters=(Parameter("delay", "s", own("delay"), 0.0, 0.8, "commands arrive {value:.2f} s late"),),
    change=sets(delay="delay"),
    advice=advice.said("look for what holds commands back: a filter, a slow link, a busy computer"),
    scans={"delay": Scan(DELAYS)},
)


battery_sag = Effect(
    name="battery_sag",
    origin=Origin.ACTUATION,
    meaning="share of the thrust lost per minute from the start of the episode",
    source="T200 thrust is roughly proportional to voltage (Blue Robotics chart, 10 to 20 V)",
    parameters=(
        Parameter("rate", "1/min", own("battery_sag"), 0.0, 0.9, "thrust fades by {value:.0%} of its value per minute"),
    ),
    change=sets(rate="battery_sag"),
    advice=advice.said("charge or change the battery, and log its volts"),
    scans={"rate": Scan((0.3,), linear=True)},
)

EFFECTS = (
    thruster_gain,
    thruster_swap,
    thruster_misalignment,
    thrust_limit,
    dead_band,
    thrust_curve,
    thruster_lag,
    command_delay,
    battery_sag,
)
