"""Effects on servos, which are counted among the thrusters: how their angles follow their commands, and from where.

A servo is that of a fin, or of an azimuth thruster, which it turns. Both fail alike, and their effects are made
alike: ``fin_gain`` and ``azimuth_gain`` differ by the actuators that they are for, and by what these are called.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from auv_torchrl.effects import advice
from auv_torchrl.effects.effect import (
    Array,
    Change,
    Effect,
    Origin,
    Parameter,
    PartAbsent,
    adds,
    among,
    changed,
    scales,
)
from auv_torchrl.effects.trial import Scan, Trial
from auv_torchrl.vehicle import Vehicle


@dataclass(frozen=True)
class Kind:
    """A kind of servo: which actuators are of it, and what is said of them."""

    name: str  # before the names of its effects
    rows: str  # the property of a vehicle that lists them, and the plural of what they are
    entry: str  # of a vehicle file, that makes an actuator one
    called: str  # in sentences, before its number
    source: str  # of a gain
    offset: float  # rad, largest
    scan: tuple[float, ...]  # rad, offsets that are tried

    def of_these(self, change: Change) -> Change:
        """The change of actuators of this kind alone."""

        def changed_alone(vehicle: Vehicle, **values: Array) -> Vehicle:
            rows = getattr(vehicle, self.rows)
            return among(vehicle, change(vehicle, **values), rows) if rows else vehicle

        return changed_alone

    def read(self, effect: str) -> Callable[[Vehicle, Mapping[str, Any]], dict[str, Any]]:
        """The settings of an effect, refused where they are of an actuator of another kind."""

        def read(vehicle: Vehicle, settings: Mapping[str, Any]) -> dict[str, Any]:
            numbers = [index + 1 for index in getattr(vehicle, self.rows)]
            if settings and not numbers:
                raise PartAbsent(
                    f"effect {effect}: the vehicle has no {self.called}s: give one whose file has {self.entry}"
                )
            for name in settings:
                number = str(name).rpartition("_")[2]
                if number.isdigit() and int(number) <= vehicle.thrusters and int(number) not in numbers:
                    there = ", ".join(map(str, numbers))
                    is_none = f"thruster {number} is no {self.called}: the {self.called}s are {there}"
                    raise PartAbsent(f"effect {effect}: {name}: {is_none}")
            return dict(settings)

        return read


FIN = Kind(
    name="fin",
    rows="fins",
    entry="fins.area",
    called="fin",
    source="a linkage that slips or is put together the wrong way round",
    offset=0.6,
    scan=(-0.2, -0.1, 0.1, 0.2),
)
AZIMUTH = Kind(
    name="azimuth",
    rows="azimuths",
    entry="servos.turns",
    called="azimuth servo",
    source="a belt that slips, a motor with its wires exchanged, ends of the feedback that are set wrong",
    offset=1.6,  # a quarter turn: beyond it the thruster pushes the other way, as a gain below 0 says
    scan=(-0.8, -0.4, -0.2, -0.1, 0.1, 0.2, 0.4, 0.8),
)


def _gain(kind: Kind) -> Effect:
    name = f"{kind.name}_gain"
    return Effect(
        name=name,
        origin=Origin.ACTUATION,
        meaning=f"gain of the angle of {kind.called} i; 0 stays in the middle, negative is reversed; "
        "i counts thrusters, too",
        source=kind.source,
        parameters=(
            Parameter(
                "gain", "1", 1.0, -2.0, 2.0, f"{kind.called} {{which}} turns {{value:z.2f}} times as far as it is told",
                "thruster", guessed=0.1, varies=0.01,
            ),
        ),
        change=kind.of_these(scales(gain="gain")),
        of_several=f"{kind.called}s {{which}} turn otherwise than told",
        shorthand=kind.read(name),
        advice=advice.servo_gain(kind.called),
        trial=Trial(wears={"gain": -1}, scans={"gain": Scan((0.0,), linear=True)}, nuisance={"gain": 0.03}),
    )  # fmt: skip


def _offset(kind: Kind) -> Effect:
    name = f"{kind.name}_offset"
    return Effect(
        name=name,
        origin=Origin.ACTUATION,
        meaning=f"angle of {kind.called} i at no command, on top of what the vehicle file says",
        source="a horn that is one tooth off on its servo: 15 degrees of 24 teeth",
        parameters=(
            Parameter(
                "offset", "rad", 0.0, -kind.offset, kind.offset,
                f"{kind.called} {{which}} stands {{signed}} off its middle", "thruster", guessed=0.02, ordinary=0.02,
            ),
        ),
        change=kind.of_these(adds(offset="servo_offset")),
        of_several=f"{kind.called}s {{which}} stand off their middle",
        shorthand=kind.read(name),
        advice=advice.servo_offset(kind.called),
        trial=Trial(scans={"offset": Scan(kind.scan)}),
    )  # fmt: skip


def _stays(vehicle: Vehicle, stuck: Array, angle: Array) -> Vehicle:
    free = 1.0 - stuck
    return changed(vehicle, gain=vehicle.gain * free, servo_offset=vehicle.servo_offset * free + stuck * angle)


def _stuck(kind: Kind) -> Effect:
    name = f"{kind.name}_stuck"
    return Effect(
        name=name,
        origin=Origin.ACTUATION,
        meaning=f"{kind.called} i stands at an angle whatever it is told, where stuck is 1; below, it follows a share "
        "of its commands",
        source="a servo that has lost its power or its teeth",
        parameters=(
            Parameter("stuck", "1", 0.0, 0.0, 1.0, f"{kind.called} {{which}} is stuck by {{share}}", "thruster"),
            Parameter(
                "angle",
                "rad",
                0.0,
                -kind.offset,
                kind.offset,
                f"{kind.called} {{which}} is stuck at {{signed}}",
                "thruster",
            ),
        ),
        change=kind.of_these(_stays),
        of_several=f"{kind.called}s {{which}} are stuck",
        shorthand=kind.read(name),
        advice=advice.servo_stuck(kind.called),
        trial=Trial(is_searched=False),  # a gain of 0 and an offset say the same
    )


fin_gain, azimuth_gain = _gain(FIN), _gain(AZIMUTH)
azimuth_offset = _offset(AZIMUTH)

EFFECTS = (fin_gain, _offset(FIN), _stuck(FIN), azimuth_gain, azimuth_offset, _stuck(AZIMUTH))
