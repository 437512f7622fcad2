"""Effects on how a thruster answers its command: its curve, and when."""

from functools import partial

import numpy as np
from array_api_compat import array_namespace

from auv_torchrl.array_api import host
from auv_torchrl.effects import advice
from auv_torchrl.effects.effect import Array, Effect, Origin, Parameter, changed, mean, of_thrusters, own, sets
from auv_torchrl.effects.trial import DELAYS, Scan, Trial, Valley
from auv_torchrl.vehicle import Vehicle


def in_proportion(values: Array, to: Array, zero: float = 0.0) -> Array:
    """One value per thruster (..., n) with the mean ``to`` (...), where thrusters differ as their ``values`` do.

    Their distances from ``zero`` are multiplied by one factor; all must lie on one side of it. Where all values are
    alike, all become ``to``.
    """
    xp = array_namespace(values, to)
    constant = xp.all(values == values[..., :1], axis=-1)
    distance = mean(values) - zero
    one = xp.ones_like(distance)
    factor = (to - zero) / xp.where(constant, one, distance)
    return xp.where(constant[..., None], to[..., None], zero + (values - zero) * factor[..., None])


def _dead_band(vehicle: Vehicle, width: Array) -> Vehicle:
    return changed(vehicle, dead_band=in_proportion(vehicle.dead_band, width))


def _guessed_width(vehicle: Vehicle, member: str) -> float:
    """A dead band is known within 40 %, and one that a file leaves out is 1 % of the thrust at most."""
    return float(np.maximum(0.4 * host(vehicle.dead_band), 0.01 * host(vehicle.full_thrust)).mean())


dead_band = Effect(
    name="dead_band",
    origin=Origin.ACTUATION,
    meaning="no thrust below this many newtons, all thrusters; the mean where they differ, which stay in proportion",
    source="Lu et al. 2023, Eq. 2",
    parameters=(
        Parameter(
            "width",
            "N",
            own("dead_band"),
            0.0,
            30.0,
            "the thrusters give nothing below {quantity}",
            guessed=_guessed_width,
        ),
    ),
    change=of_thrusters(_dead_band),
    advice=advice.always(
        "look at the pulse limits of the speed controllers; if the dead band is theirs, enter it in the vehicle file"
    ),
    trial=Trial(
        wears={"width": 1},
        scans={"width": Scan((0.0, 2.5, 7.5, 10.0, 12.5, 15.0, 20.0, 25.0))},
        nuisance={"width": 0.03},
        is_rough=True,
    ),
)


def _curve(vehicle: Vehicle, exponent: Array, asymmetry: Array) -> Vehicle:
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
        Parameter(
            "exponent",
            "1",
            own("exponent"),
            0.5,
            3.0,
            "thrust grows as the command to the power {value:.2f}",
            guessed=0.4,  # 1 where a controller makes thrust linear, 2 where it commands speed
        ),
        Parameter(
            "asymmetry",
            "1",
            own("asymmetry"),
            -0.6,
            0.6,
            "reverse thrust is weaker by {share}",
            guessed=0.15,  # T200: a fifth
        ),
    ),
    change=of_thrusters(_curve),
    is_property=True,
    advice=advice.always("enter the curve of these propellers at this voltage in the vehicle file"),
    trial=Trial(
        valley=Valley("exponent", ("dead_band", "width"), _same_commands),
        scans={"exponent": Scan((0.7, 0.85, 1.2, 1.5, 1.8, 2.2, 2.6)), "asymmetry": Scan((0.3,), linear=True)},
    ),
)


def _one_way(field: str, way: str, meaning: str) -> Effect:
    """Gain of thrust one way alone."""
    return Effect(
        name=field,
        origin=Origin.ACTUATION,
        meaning=meaning,
        source="bidirectional speed controllers switch between two senses of turning, and some do not switch back",
        parameters=(
            Parameter(
                "gain",
                "1",
                own(field),
                -1.0,  # it pushes the same way whatever it is told
                2.0,
                f"thruster {{which}} gives {{share}} of its nominal thrust {way}",
                "thruster",
                at_zero=f"thruster {{which}} gives no thrust {way}",
            ),
        ),
        change=of_thrusters(lambda vehicle, gain: changed(vehicle, **{field: gain})),
        of_several=f"thrusters {{which}} do not give their nominal thrust {way}",
        advice=partial(advice.one_way_gain, way),
        trial=Trial(
            wears={"gain": -1},
            scans={"gain": Scan((0.0,), linear=True)},
        ),
    )


forward_gain = _one_way(
    "forward_gain", "forwards", "thrust of thruster i forwards times this gain; 0 pushes backwards only"
)
reverse_gain = _one_way(
    "reverse_gain", "backwards", "thrust of thruster i backwards times this gain; 0 pushes forwards only"
)

neutral_offset = Effect(
    name="neutral_offset",
    origin=Origin.ACTUATION,
    meaning="command at which thruster i gives nothing, as a share of the full one; at command 0 it pushes",
    source="a speed controller takes the middle of its calibrated pulses for neutral",
    parameters=(
        Parameter(
            "offset",
            "1",
            own("neutral_offset"),
            -0.5,
            0.5,
            "thruster {which} pushes at command 0: its neutral lies at {value:+.2f} of the full command",
            "thruster",
        ),
    ),
    change=of_thrusters(sets(offset="neutral_offset")),
    of_several="thrusters {which} push at command 0",
    is_property=True,  # a setting of the speed controller: it does not come about between two runs
    advice=advice.neutral_offset,
    trial=Trial(
        odds=1e-2,  # a thruster that turns at rest is seen before the dive; a constant push is weight far more often
        scans={"offset": Scan((-0.25, -0.1, -0.04, 0.04, 0.1, 0.25), all=True)},
    ),
)


def _lag(vehicle: Vehicle, time_constant: Array) -> Vehicle:
    return changed(vehicle, lag=in_proportion(vehicle.lag, time_constant))


thruster_lag = Effect(
    name="thruster_lag",
    origin=Origin.ACTUATION,
    meaning="thrust follows its target with a first-order time constant; the mean where thrusters differ, which stay "
    "in proportion",
    source="Yoerger, Cooke and Slotine 1990, thruster dynamics",
    parameters=(
        Parameter(
            "time_constant",
            "s",
            own("lag"),
            0.0,
            1.5,
            "thrust follows the command with a lag of {quantity}",
            guessed=lambda vehicle, member: 0.4 * float(vehicle.lag.mean()),  # none: delay stands for it
        ),
    ),
    change=_lag,
    advice=advice.always(
        "look at the ramp of the speed controllers; if the lag is theirs, enter it in the vehicle file"
    ),
    trial=Trial(
        smooths=True,
        wears={"time_constant": 1},
        scans={"time_constant": Scan((0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.2))},
    ),
)


command_delay = Effect(
    name="command_delay",
    origin=Origin.ACTUATION,
    meaning="commands reach the thrusters late",
    source="network and driver latency; a T200's own dead time is 13 ms",
    parameters=(
        Parameter(
            "delay",
            "s",
            own("delay"),
            0.0,
            0.8,
            "commands arrive {quantity} late",
            guessed=0.05,  # driver and link
            ordinary=0.01,  # snapshots of an output at 10 Hz
            varies=0.005,  # of a clock against another
        ),
    ),
    change=sets(delay="delay"),
    advice=advice.always("look for what holds commands back: a filter, a slow link, a busy computer"),
    trial=Trial(
        wears={"delay": 1},
        scans={"delay": Scan(DELAYS)},
    ),
)


battery_sag = Effect(
    name="battery_sag",
    origin=Origin.ACTUATION,
    meaning="share of the thrust lost per minute from the start of the episode",
    source="T200 thrust is roughly proportional to voltage (Blue Robotics chart, 10 to 20 V)",
    parameters=(
        Parameter("rate", "1/min", own("battery_sag"), 0.0, 0.9, "thrust fades by {share} of its value per minute"),
    ),
    change=sets(rate="battery_sag"),
    advice=advice.always("charge or change the battery, and log its volts"),
    trial=Trial(
        scans={"rate": Scan((0.3,), linear=True)},
    ),
)

EFFECTS = (
    dead_band, thrust_curve, forward_gain, reverse_gain, neutral_offset, thruster_lag, command_delay, battery_sag,
)  # fmt: skip
