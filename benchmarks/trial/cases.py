"""The sealed cases: what is wrong with which vehicle, drawn from a seed; whoever diagnoses does not see them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from auv_torchrl.effects import EFFECTS
from auv_torchrl.link.plant import Plant
from auv_torchrl.vehicle import Vehicle, load_vehicle

FRAMES = {1: "bluerov2", 2: "bluerov2_heavy"}  # FRAME_CONFIG, vectored and vectored_6dof; and the vehicle file
KINDS = (
    "healthy", "reversed", "dead", "weak", "one_way", "plugs", "direction", "ballast", "delay", "current",
    "depth_sensor", "compass",
)  # fmt: skip
HEALTHY_DIVES = 2  # of each frame
# Relative standard deviations by which the vehicle that is flown differs from its file, the same in all its dives.
BUILT = {"linear_drag": 0.08, "quadratic_drag": 0.08, "added_mass": 0.05, "thruster_gain": 0.03}
TRIM_N, CURRENT_M_S = 0.3, 0.02  # standard deviations from dive to dive

Effects = Mapping[str, Mapping[str, Any]]  # as in the effects of a scenario


@dataclass(frozen=True)
class Case:
    """One vehicle with what is wrong with it."""

    number: int
    kind: str
    frame: int
    effects: Effects = field(default_factory=dict)  # of the vehicle
    parameters: Mapping[str, float] = field(default_factory=dict)  # of the firmware
    mirrored: tuple[int, ...] = ()  # thrusters two of whose phase wires are exchanged
    truth: Mapping[str, Mapping[str, float]] = field(default_factory=dict)  # what a diagnosis should name
    is_curable: bool = True  # whether anything that an owner does to the vehicle takes it away

    @property
    def name(self) -> str:
        """For people and for files."""
        return f"{self.number:02d}_{self.kind}"

    @property
    def vehicle(self) -> str:
        """The file of the vehicle."""
        return FRAMES[self.frame]


def draw_cases(count: int, seed: int) -> list[Case]:
    """Cases in the order in which they are flown: one of each kind, on alternating frames, again and again.

    Cases of a kind on a frame go through the thrusters in an order that is drawn, so that each has its turn.
    """
    orders: dict[tuple[str, int], Iterator[int]] = {}
    number_of = {frame: load_vehicle(name).thrusters for frame, name in FRAMES.items()}
    drawn = []
    for number in range(count):
        turn, which = divmod(number, len(KINDS))
        kind, frame = KINDS[which], list(FRAMES)[(which + turn) % len(FRAMES)]
        rng = np.random.default_rng((seed, number))
        thrusters = number_of[frame]
        if (kind, frame) not in orders:
            orders[kind, frame] = _again(thrusters, np.random.default_rng((seed, frame, which, 1)))
        drawn.append(_of_kind(number + 1, kind, frame, rng, next(orders[kind, frame]), thrusters))
    return drawn


def _again(thrusters: int, rng: np.random.Generator) -> Iterator[int]:
    while True:
        yield from (rng.permutation(thrusters) + 1).tolist()


def _of_kind(number: int, kind: str, frame: int, rng: np.random.Generator, n: int, thrusters: int) -> Case:
    sign = float(rng.choice((-1.0, 1.0)))

    def acting(effect: str, parameters: dict[str, float], **more: Any) -> Case:
        return Case(number, kind, frame, {effect: parameters}, truth={effect: parameters}, **more)

    if kind == "healthy":
        return Case(number, kind, frame)
    turned = {"thruster_swap": {f"command_{n}": -float(n)}}
    if kind == "direction":
        return Case(number, kind, frame, parameters={f"MOT_{n}_DIRECTION": -1.0}, truth=turned)
    if kind == "reversed":
        return Case(number, kind, frame, mirrored=(n,), truth=turned)
    if kind == "plugs":
        other = int(rng.choice([m for m in range(1, thrusters + 1) if m != n]))
        truth = {"thruster_swap": {f"command_{n}": float(other), f"command_{other}": float(n)}}
        return Case(number, kind, frame, {"thruster_swap": {"pair": sorted((n, other))}}, truth=truth)
    if kind == "current":
        angle = rng.uniform(0, 2 * np.pi)
        size = rng.uniform(0.15, 0.3)
        flow = {"north": size * np.cos(angle), "east": size * np.sin(angle)}
        return acting("current", {axis: round(float(v), 3) for axis, v in flow.items()}, is_curable=False)
    return acting(*{
        "dead": ("thruster_gain", {f"gain_{n}": 0.0}),
        "weak": ("thruster_gain", {f"gain_{n}": round(rng.uniform(0.4, 0.7), 2)}),
        "one_way": (str(rng.choice(("forward_gain", "reverse_gain"))), {f"gain_{n}": 0.0}),
        "ballast": ("buoyancy", {"force": round(sign * rng.uniform(4.0, 8.0), 1)}),
        "delay": ("command_delay", {"delay": round(rng.uniform(0.15, 0.3), 2)}),
        "depth_sensor": ("depth_scale", {"factor": round(1 + sign * rng.uniform(0.15, 0.3), 2)}),
        "compass": ("heading_bias", {"angle": round(sign * rng.uniform(0.25, 0.6), 2)}),
    }[kind])  # fmt: skip


class Wired(Plant):
    """A vehicle some of whose thrusters take each command for its opposite.

    That is what exchanged phase wires do: the propeller turns the other way, and gives what it gives that way. A gain
    of -1 is another thing, a thruster that pushes backwards as strongly as it should push ahead.

    Args:
        mirrored: these thrusters.
        plant: the arguments of a :class:`Plant`.
    """

    def __init__(self, mirrored: tuple[int, ...], *plant: Any):
        self._mirrored = mirrored
        super().__init__(*plant)

    def step(self, command: list[float], step_s: float) -> bool:
        """Hold the command, as the thrusters take it."""
        turned = [-c if n in self._mirrored else c for n, c in enumerate(command, start=1)]
        return super().step(turned, step_s)


def built(frame: int, seed: int) -> Vehicle:
    """The vehicle that is flown: as its file says, but for what a file has wrong."""
    vehicle, rng = load_vehicle(FRAMES[frame]), np.random.default_rng((seed, frame, 2))
    for name, spread in BUILT.items():
        nominal = EFFECTS[name].nominal(vehicle)
        values = {member: value * (1 + spread * rng.standard_normal()) for member, value in nominal.items()}
        vehicle = EFFECTS[name].apply(vehicle, values)
    return vehicle


def of_the_day(vehicle: Vehicle, seed: int, frame: int, dive: int) -> Vehicle:
    """The same vehicle in one dive: trimmed by hand, and in water that moves a little."""
    rng = np.random.default_rng((seed, frame, 3, dive))
    north, east = CURRENT_M_S * rng.standard_normal(2)
    trimmed = EFFECTS["buoyancy"].apply(vehicle, {"force": TRIM_N * rng.standard_normal()})
    return EFFECTS["current"].apply(trimmed, {"north": north, "east": east})
