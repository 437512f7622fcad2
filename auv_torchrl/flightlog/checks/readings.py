"""Other units in which a log may have been written: the one in which the vehicle obeys its thrusters is the right one.

The equations of motion have no free scale: lengths that are 3.28 times too large make every force wrong. So each
reading of the log is put to the balance of forces, and one that closes it where the log as it stands does not is
taken, with a finding. A fault leaves most of the balance in order, so that no reading mends it.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from auv_torchrl.flightlog.checks.motion import Blocks, blocks, force_balance
from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.log import POSE, VELOCITY, Episode
from auv_torchrl.quantities import percent
from auv_torchrl.vehicle import Vehicle

IN_ORDER = 0.6  # balance of forces from which a log is read as it stands
CLOSED = 0.7  # balance that another reading must reach,
BETTER = 0.35  # and at most this share of what the log as it stands leaves open
FACTORS = np.geomspace(1 / 300, 300, 115)  # ten per cent apart
LEAST_FACTOR = 1.6  # a smaller one is a sensor's scale, or a fault of the vehicle: the diagnosis weighs it
NAMED_WITHIN = 0.15  # relative, of the estimate of a factor
ONE_SIDED = 0.02  # below 0 or above 1 that rounding may go
TIMES = {"a clock at double speed": 2.0, "a clock at half speed": 0.5}
OPEN = "; nothing was changed, because thrust that is weaker or stronger everywhere would look the same"
LENGTHS = {"feet": 1 / 0.3048, "inches": 1 / 0.0254, "centimetres": 100.0, "millimetres": 1000.0}  # per metre
TIME = "time_unit"
GAINS = np.geomspace(1 / 16, 16, 41)
SAME = 0.03  # of the balance of forces: two readings that close it as well
SPEEDS = {"knots": 1 / 0.514444, "km/h": 3.6, "feet per second": 1 / 0.3048, "cm/s": 100.0}  # per m/s


class Reading(NamedTuple):
    """Columns in another unit, by a factor that is looked for."""

    code: str  # of its finding
    columns: tuple[str, ...]
    units: dict[str, float]
    what: str


def convert_units(
    episodes: tuple[Episode, ...], axes: tuple[str, ...], vehicle: Vehicle
) -> tuple[tuple[Episode, ...], list[Finding]]:
    """The episodes in the units of the format, converted where the balance of forces shows another one."""
    b = blocks(episodes, vehicle)
    now = force_balance(b)
    if not -np.inf < now <= IN_ORDER:
        return episodes, []
    if _one_sided(episodes):
        both = tuple(replace(e, commands=2 * e.commands - 1) for e in episodes)
        if _closes(force_balance(blocks(both, vehicle)), now):
            sentence = "commands lie within 0 and 1, and the vehicle answers them as if 0.5 were rest; taken as 2 c - 1"
            columns = tuple(f"cmd_{i + 1}" for i in range(both[0].commands.shape[1]))
            remedy = "Give commands in [-1, 1]"
            return both, [Finding(Severity.WARNING, "one_sided_commands", sentence, remedy, columns)]
    tried = [(*_best_factor(b, reading), reading) for reading in _readings(axes)]
    likely = [(balance, factor, reading) for factor, balance, reading in tried if _is_unit(factor, balance, now)]
    if not likely:
        return episodes, []
    balance, factor, reading = max(likely, key=lambda entry: entry[0])
    unit = next((u for u, f in reading.units.items() if abs(np.log(factor / f)) < NAMED_WITHIN), "")
    factor = reading.units.get(unit, factor)
    open_ = reading.code == TIME and _weaker_thrusters(b) > balance - SAME
    sentence = _sentence(reading, factor, unit, balance, now) + (OPEN if open_ else "")
    remedy = f"Give {reading.what}"
    finding = Finding(Severity.WARNING, reading.code, sentence, remedy, reading.columns, limits=open_)
    return episodes if open_ else tuple(_divided(e, reading.columns, factor) for e in episodes), [finding]


def _sentence(reading: Reading, factor: float, unit: str, balance: float, now: float) -> str:
    verb = "is" if len(reading.columns) == 1 else "are"
    looks = f", as {unit} would be" if unit else ""
    return (
        f"{', '.join(reading.columns)} {verb} {factor:.3g} times what fits the thrusters{looks}; divided by that, the "
        f"forces balance to {percent(balance)}, as logged to {percent(max(now, 0))}"
    )


def _is_unit(factor: float, balance: float, now: float) -> bool:
    return _closes(balance, now) and abs(np.log(factor)) > np.log(LEAST_FACTOR)


def _weaker_thrusters(b: Blocks) -> float:
    """How well the forces balance if all thrusters give the same share of their thrust."""
    return max(force_balance(b._replace(thrust=g * b.thrust)) for g in GAINS.tolist())


def _one_sided(episodes: tuple[Episode, ...]) -> bool:
    """Whether no command goes below 0."""
    low = min(float(e.commands.min()) for e in episodes)
    return low > -ONE_SIDED and max(float(np.ptp(e.commands)) for e in episodes) > ONE_SIDED


def _closes(balance: float, now: float) -> bool:
    return balance > CLOSED and 1 - balance < BETTER * (1 - now)


def _readings(axes: tuple[str, ...]) -> list[Reading]:
    lengths = tuple(axis for axis in POSE[:3] if axis in axes)
    speeds = tuple(axis for axis in VELOCITY[:3] if axis in axes)
    found = []
    if lengths and not speeds:
        found.append(Reading("length_unit", lengths, LENGTHS, "x, y, z in metres"))
    if speeds and not {"x", "y"} <= set(lengths):
        found.append(Reading("speed_unit", speeds, SPEEDS, "u, v, w in m/s"))
    if speeds and {"x", "y"} <= set(lengths):  # they agree with each other, else one of them was left out
        found.append(Reading("length_unit", (*lengths, *speeds), LENGTHS, "metres and m/s"))
    found.append(Reading(TIME, ("t",), TIMES, "t in seconds"))
    return found


def _best_factor(b: Blocks, reading: Reading) -> tuple[float, float]:
    """The factor under which the forces balance best, and how well they do."""

    def balance(factor: float) -> float:
        return force_balance(_scaled(b, reading.columns, factor))

    coarse = max(FACTORS, key=balance)
    fine = max(coarse * np.geomspace(0.92, 1.08, 17), key=balance)
    return float(fine), balance(fine)


def _scaled(b: Blocks, columns: tuple[str, ...], factor: float) -> Blocks:
    if columns == ("t",):
        return b._replace(rate=b.rate * factor, length=b.length / factor)
    rate, velocity = b.rate.copy(), b.velocity.copy()
    for name in columns:
        if name in POSE:
            rate[:, POSE.index(name)] /= factor
        else:
            velocity[:, VELOCITY.index(name)] /= factor
    return b._replace(rate=rate, velocity=velocity)


def _divided(episode: Episode, columns: tuple[str, ...], factor: float) -> Episode:
    if columns == ("t",):
        return replace(episode, t=episode.t / factor)
    pose, velocity = (np.where([name in columns for name in names], factor, 1.0) for names in (POSE, VELOCITY))
    return replace(episode, pose=episode.pose / pose, velocity=episode.velocity / velocity)
