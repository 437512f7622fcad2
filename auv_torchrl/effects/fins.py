"""Effects on fins, which are counted among the thrusters of a vehicle: how they follow their commands, and where."""

from collections.abc import Callable, Mapping
from typing import Any

from auv_torchrl.effects import advice
from auv_torchrl.effects.effect import Array, Effect, Origin, Parameter, PartAbsent, adds, changed, of_fins, scales
from auv_torchrl.effects.trial import Scan, Trial
from auv_torchrl.vehicle import Vehicle


def _fins_alone(effect: str) -> Callable[[Vehicle, Mapping[str, Any]], dict[str, Any]]:
    """The settings of an effect, refused where they are of a thruster that is no fin."""

    def read(vehicle: Vehicle, settings: Mapping[str, Any]) -> dict[str, Any]:
        fins = [index + 1 for index in vehicle.fins]
        if settings and not fins:
            raise PartAbsent(f"effect {effect}: the vehicle has no fins: give one whose file has fins.area")
        for name in settings:
            number = str(name).rpartition("_")[2]
            if number.isdigit() and int(number) <= vehicle.thrusters and int(number) not in fins:
                there = ", ".join(map(str, fins))
                raise PartAbsent(f"effect {effect}: {name}: thruster {number} is no fin: the fins are {there}")
        return dict(settings)

    return read


fin_gain = Effect(
    name="fin_gain",
    origin=Origin.ACTUATION,
    meaning="deflection of fin i times its gain; 0 stays in the middle, negative is reversed; i counts thrusters, too",
    source="a linkage that slips or is put together the wrong way round",
    parameters=(
        Parameter(
            "gain", "1", 1.0, -2.0, 2.0, "fin {which} turns {value:z.2f} times as far as it is told", "thruster",
            guessed=0.1, varies=0.01,
        ),
    ),
    change=of_fins(scales(gain="gain")),
    shorthand=_fins_alone("fin_gain"),
    advice=advice.fin_gain,
    trial=Trial(wears={"gain": -1}, scans={"gain": Scan((0.0,), linear=True)}, nuisance={"gain": 0.03}),
)  # fmt: skip


fin_offset = Effect(
    name="fin_offset",
    origin=Origin.ACTUATION,
    meaning="deflection of fin i at no command, on top of what the vehicle file says",
    source="a horn that is one tooth off on its servo: 15 degrees of 24 teeth",
    parameters=(
        Parameter(
            "offset", "rad", 0.0, -0.6, 0.6, "fin {which} stands {signed} off its middle", "thruster", guessed=0.02,
            ordinary=0.02,
        ),
    ),
    change=of_fins(adds(offset="fin_offset")),
    shorthand=_fins_alone("fin_offset"),
    advice=advice.fin_offset,
    trial=Trial(scans={"offset": Scan((-0.2, -0.1, 0.1, 0.2))}),
)  # fmt: skip


def _stuck(vehicle: Vehicle, stuck: Array, angle: Array) -> Vehicle:
    free = 1.0 - stuck
    return changed(vehicle, gain=vehicle.gain * free, fin_offset=vehicle.fin_offset * free + stuck * angle)


fin_stuck = Effect(
    name="fin_stuck",
    origin=Origin.ACTUATION,
    meaning="fin i stands at an angle whatever it is told, where stuck is 1; below, it follows a share of its commands",
    source="a servo that has lost its power or its teeth",
    parameters=(
        Parameter("stuck", "1", 0.0, 0.0, 1.0, "fin {which} is stuck by {share}", "thruster"),
        Parameter("angle", "rad", 0.0, -0.6, 0.6, "fin {which} is stuck at {signed}", "thruster"),
    ),
    change=of_fins(_stuck),
    shorthand=_fins_alone("fin_stuck"),
    advice=advice.fin_stuck,
    trial=Trial(is_searched=False),  # a gain of 0 and an offset say the same
)

EFFECTS = (fin_gain, fin_offset, fin_stuck)
