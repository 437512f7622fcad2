"""Which cases are flown: families of cases in fixed shares, in an order that any part of is representative."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import cycle

import numpy as np

from auv_torchrl.settings import choices
from benchmarks.blind.flights.damages import DAMAGES, FAULTS, POSES, can_show
from benchmarks.blind.flights.outside import OUTSIDE
from benchmarks.blind.flights.sensor_sets import FAULTS as SET_FAULTS
from benchmarks.blind.flights.sensor_sets import LOAD, THRUSTER, UNSEEN, sensor_set
from benchmarks.blind.flights.sizes import CLEAR

SLACK = 0.03  # standard deviation of the factors on gains, drags and inertias of a vehicle that is not quite nominal
STEPS_DOWN = (0.5, 0.25, 0.12, 0.06)  # of a clear size, to below the detection limit
SHORT_S = (30.0, 60.0, 120.0)  # length of shorter logs
NOISES = (2.0, 5.0)  # times the usual sensor noise
ONE_CAN_HIDE_THE_OTHER = (  # pairs that no log can tell from one effect, or of which one is a part of the other
    {"command_delay", "pose_delay"},
    {"payload", "buoyancy"},
    {"payload", "added_mass"},
    {"payload", "mass_offset"},
)
FAMILIES = (
    "single", "single_slack", "failures", "severity", "length", "noise", "pair", "no_gap", "no_gap_slack", "outside",
    "left_out", "onset", "damaged", "damaged_fault",
)  # fmt: skip
EPISODES = 6
HEALTHY = "healthy"  # family of flights that are given with other cases


@dataclass(frozen=True)
class Case:
    """What is to be flown; sizes are drawn when it is flown."""

    number: int
    family: str
    effects: tuple[str, ...] = ()  # of the library
    outside: str | None = None
    left_out: str | None = None  # effect that the library lacks for this case
    plant: str = "mujoco"  # or "foreign"
    scale: float = 1.0  # times a clear size
    slack: float = 0.0
    episodes: int = EPISODES  # of the log to explain
    episode_s: float = 30.0
    noise: float = 1.0
    failed: int = 0  # thrusters that have each failed in their own way; 0 where effects are drawn as usual
    onset: bool = False  # the effects begin during the log
    damage: str | None = None  # of the log, in DAMAGES
    axes: tuple[str, ...] = POSES  # that the log holds
    healthy: int = 0  # episodes of a log that is handed over as healthy and has the same effects
    stranger: int | None = None  # number of the vehicle, where it is a stranger
    sensors: str | None = None  # set of sensors, in SENSOR_SETS
    fault: str | None = None  # of a vehicle with such a set, in FAULTS there

    @property
    def name(self) -> str:
        """A name that tells nothing."""
        return f"{'healthy' if self.family == HEALTHY else 'case'}_{self.number:04d}"

    @property
    def truth(self) -> str:
        """What the first answer should be."""
        if self.damage:
            return "damage"
        if self.outside or self.left_out:
            return "unknown"
        return self.effects[0] if self.effects else "no_gap"


def count_by_family(cases: int, shares: Mapping[str, float], families: tuple[str, ...] = FAMILIES) -> dict[str, int]:
    """Split ``cases`` by shares of ``families``; the largest remainders get the odd ones.

    Raises:
        ValueError: for an unknown family or shares that are not positive numbers.
    """
    if unknown := set(shares) - set(families):
        raise ValueError(f"blind: unknown families {sorted(unknown)}: {choices(unknown, families)}")
    if not all(0 <= share < math.inf for share in shares.values()) or not sum(shares.values()) > 0:
        raise ValueError(f"blind: families are {dict(shares)}: give shares of 0 or more, one of them above 0")
    if cases < 1:
        raise ValueError(f"blind: cases is {cases}: give 1 or more")
    exact = {name: cases * share / sum(shares.values()) for name, share in shares.items()}
    counts = {name: int(value) for name, value in exact.items()}
    by_remainder = sorted(exact, key=lambda name: counts[name] - exact[name])
    for name in by_remainder[: cases - sum(counts.values())]:
        counts[name] += 1
    return counts


def draw_cases(cases: int, shares: Mapping[str, float], seed: int, sensors: str | None = None) -> list[Case]:
    """The cases, numbered from 1, families mixed; the same for the same arguments."""
    rng = np.random.default_rng([seed, 0])
    drawn = []
    by_name = _FAMILY if sensors is None else _SET_FAMILY
    for family, count in count_by_family(cases, shares, tuple(by_name)).items():
        drawn += by_name[family](count, rng)
    order = rng.permutation(len(drawn))
    plants = cycle(("mujoco", "foreign"))
    common = {} if sensors is None else {"sensors": sensors, "axes": sensor_set(sensors).axes}
    return [Case(**{"number": i + 1, "plant": next(plants), **drawn[k], **common}) for i, k in enumerate(order)]


def _shuffled(names: Iterable[str], count: int, rng: np.random.Generator) -> list[str]:
    """Names in a random order, each as often as the others (or once more)."""
    names = list(names)
    rounds = -(-count // len(names))
    return [str(name) for _ in range(rounds) for name in rng.permutation(names)][:count]


def _single(count: int, rng: np.random.Generator) -> list[dict]:
    return [{"family": "single", "effects": (name,)} for name in _shuffled(CLEAR, count, rng)]


def _single_slack(count: int, rng: np.random.Generator) -> list[dict]:
    return [{**case, "family": "single_slack", "slack": SLACK} for case in _single(count, rng)]


def _failures(count: int, rng: np.random.Generator) -> list[dict]:
    numbers = cycle((2, 3))
    return [{"family": "failures", "effects": ("thruster_gain",), "failed": next(numbers)} for _ in range(count)]


def _severity(count: int, rng: np.random.Generator) -> list[dict]:
    names = _shuffled((name for name in CLEAR if name != "thruster_swap"), count, rng)
    scales = cycle(STEPS_DOWN)
    return [{"family": "severity", "effects": (name,), "scale": next(scales)} for name in names]


def _length(count: int, rng: np.random.Generator) -> list[dict]:
    lengths = cycle(SHORT_S)
    return [{**case, "family": "length", "episodes": round(next(lengths) / 30)} for case in _single(count, rng)]


def _noise(count: int, rng: np.random.Generator) -> list[dict]:
    noises = cycle(NOISES)
    return [{**case, "family": "noise", "noise": next(noises)} for case in _single(count, rng)]


def _pair(count: int, rng: np.random.Generator) -> list[dict]:
    pairs: list[dict] = []
    while len(pairs) < count:
        names = _shuffled(CLEAR, 2 * len(CLEAR), rng)  # of so many pairs, each effect is in two
        drawn = list(zip(names[::2], names[1::2], strict=True))
        if all(one != other and {one, other} not in ONE_CAN_HIDE_THE_OTHER for one, other in drawn):
            pairs += [{"family": "pair", "effects": pair} for pair in drawn]
    return pairs[:count]


def _no_gap(count: int, rng: np.random.Generator) -> list[dict]:
    return [{"family": "no_gap"}] * count


def _no_gap_slack(count: int, rng: np.random.Generator) -> list[dict]:
    return [{"family": "no_gap_slack", "slack": SLACK}] * count


def _outside(count: int, rng: np.random.Generator) -> list[dict]:
    slacks = cycle((0.0, SLACK))
    return [{"family": "outside", "outside": name, "slack": next(slacks)} for name in _shuffled(OUTSIDE, count, rng)]


def _left_out(count: int, rng: np.random.Generator) -> list[dict]:
    return [{"family": "left_out", "effects": (name,), "left_out": name} for name in _shuffled(CLEAR, count, rng)]


def _onset(count: int, rng: np.random.Generator) -> list[dict]:
    names = _shuffled(("thruster_gain", "current", "buoyancy", "heading_bias", "thruster_swap"), count, rng)
    long = {"family": "onset", "onset": True, "episodes": 1, "episode_s": 120.0}
    return [{**long, "effects": (name,)} for name in names]


def _with_damage(name: str) -> dict:
    damage = DAMAGES[name]
    return {"damage": name, "axes": damage.axes, "healthy": EPISODES if damage.healthy else 0}


def _damaged(count: int, rng: np.random.Generator) -> list[dict]:
    return [
        {"family": "damaged", **_with_damage(name), "effects": ("thruster_gain",) if DAMAGES[name].healthy else ()}
        for name in _shuffled(DAMAGES, count, rng)
    ]


def _damaged_fault(count: int, rng: np.random.Generator) -> list[dict]:
    visible = [name for name, damage in DAMAGES.items() if any(can_show(damage, fault) for fault in FAULTS)]
    faults = cycle(_shuffled(FAULTS, len(FAULTS), rng))
    cases = []
    for name in _shuffled(visible, count, rng):
        fault = next(fault for fault in faults if can_show(DAMAGES[name], fault))
        cases.append({"family": "damaged_fault", **_with_damage(name), "effects": (fault,)})
    return cases


_FAMILY = {
    "single": _single, "single_slack": _single_slack, "failures": _failures, "severity": _severity, "length": _length,
    "noise": _noise, "pair": _pair, "no_gap": _no_gap, "no_gap_slack": _no_gap_slack, "outside": _outside,
    "left_out": _left_out, "onset": _onset, "damaged": _damaged, "damaged_fault": _damaged_fault,
}  # fmt: skip


def _faulty(family: str, names: Iterable[str]) -> Callable[[int, np.random.Generator], list[dict]]:
    """A family of faults, every second vehicle with slack."""

    def draw(count: int, rng: np.random.Generator) -> list[dict]:
        slacks = cycle((0.0, SLACK))
        return [
            {"family": family, "fault": name, "effects": (SET_FAULTS[name][0],), "slack": next(slacks)}
            for name in _shuffled(names, count, rng)
        ]

    return draw


_SET_FAMILY = {
    "thruster": _faulty("thruster", THRUSTER), "load": _faulty("load", LOAD),
    "depth_bias": _faulty("depth_bias", [UNSEEN]), "no_gap": _no_gap, "no_gap_slack": _no_gap_slack,
}  # fmt: skip
SET_FAMILIES = tuple(_SET_FAMILY)  # of logs with a set of sensors
