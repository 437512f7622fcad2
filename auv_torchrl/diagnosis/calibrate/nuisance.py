"""What may differ although nothing is wrong: coefficients that a file has wrong, and what differs between flights."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient, shared_covariance
from auv_torchrl.diagnosis.identify.hypotheses import (
    Entry,
    Settings,
    Values,
    apply_values,
    nuisance_parameters,
    sensor_nuisance,
    that_matter,
)
from auv_torchrl.diagnosis.identify.problem import NuisanceEntry
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import MENDED_REPEATS, REPEATS
from auv_torchrl.effects import EFFECTS
from auv_torchrl.vehicle import Vehicle

WARMTH = 0.4  # of what sound sensors are off by, that comes and goes with their temperature
SURELY = 1e-9  # of a total variance, that a number without a width may be off by: inverses need one
NOTHING = 0.01  # of a corrected number: a file that said less said nothing
# Of what a number was: no factor brings back what is gone, and the largest ones, of 10, bring this back.
SMALLEST_FACTOR = 0.1


@dataclass(frozen=True)
class Nuisance:
    """Numbers (k,) of a vehicle that no explanation is to be made of."""

    entries: tuple[NuisanceEntry, ...]  # of the vehicle's file; widths of the file and of flights together
    width: Floats  # (k,) standard deviation of the file; 0 where it is right
    spread: tuple[Floats, ...]  # (k, k) covariances between flights, each with a size of its own that can be learnt
    repeats: Floats  # (k,) standard deviation within which every sound vehicle repeats itself
    repeating: float = REPEATS  # relative, how well
    is_guess: bool = False  # the file: what it has wrong of thrusters, it has wrong of all of them

    def between_flights(self, sizes: Sequence[float] | None = None) -> Floats:
        """Covariance (k, k) between flights; ``sizes`` are times what is stated of each spread."""
        sizes = [1.0] * len(self.spread) if sizes is None else sizes
        parts = (size**2 * part for size, part in zip(sizes, self.spread, strict=True))
        return sum(parts, np.diag(self.repeats**2))

    def only(self, places: Sequence[int]) -> "Nuisance":
        """Some of the numbers."""
        spread = tuple(part[np.ix_(places, places)] for part in self.spread)
        entries = tuple(self.entries[i] for i in places)
        return replace(self, entries=entries, width=self.width[places], spread=spread, repeats=self.repeats[places])

    def precision(self, width: Floats) -> Floats:
        """Precision (k, k) of a file that is right within ``width`` (k,)."""
        total = np.array([entry[3] for entry in self.entries])
        width = np.maximum(width, SURELY**0.5 * total)
        members = [entry[:2] for entry in self.entries]
        return np.linalg.inv(shared_covariance(members, width) if self.is_guess else np.diag(width**2))


def nuisance(vehicle: Vehicle, widths: Sequence[tuple[str, str, float, float]]) -> Nuisance:
    """The numbers with these ``widths``, (effect, parameter, nominal, deviation), and all that flights differ in."""
    width = {(effect, member): (nominal, size) for effect, member, nominal, size in widths}
    varying: dict[str, list[tuple[tuple[str, str], float]]] = {}
    for name, effect in EFFECTS.items():
        for member, p in effect.member_parameters(vehicle).items():
            if p.varies and (not effect.shown_by or (name, member) in width):
                varying.setdefault(f"{name}.{p.name}", []).append(((name, member), p.varies))
                width.setdefault((name, member), (p.nominal_value(vehicle, member), 0.0))
    keys, spread = list(width), []
    for members in varying.values():
        column = np.zeros(len(keys))
        for key, size in members:
            column[keys.index(key)] = size
        spread.append(np.outer(column, column))
    repeats = _repeats(vehicle, keys, [nominal for nominal, _ in width.values()])
    own = np.array([size for _, size in width.values()])
    total = np.sqrt(own**2 + repeats**2 + sum(np.diag(part) for part in spread)).tolist()
    nuisance = tuple((*key, width[key][0], size) for key, size in zip(keys, total, strict=True))
    return Nuisance(nuisance, own, tuple(spread), repeats)


def _repeats(
    vehicle: Vehicle, keys: Sequence[tuple[str, str]], nominal: Sequence[float], share: float = REPEATS
) -> Floats:
    """Standard deviations (k,) within which sound vehicles repeat the numbers ``keys``, about ``nominal`` (k,)."""
    loose = [EFFECTS[effect].member_parameters(vehicle)[member].loose for effect, member in keys]
    return np.array([share * abs(value) or WARMTH * size for value, size in zip(nominal, loose, strict=True)])


def stated(vehicle: Vehicle, settings: Settings, channels: Collection[str] = ()) -> Nuisance:
    """Of a vehicle whose file is right within the slack of the settings, in logs with these ``channels``."""
    return nuisance(vehicle, nuisance_parameters(vehicle, settings, channels))


def guessed(vehicle: Vehicle, settings: Settings, coefficients: Sequence[Coefficient], windows: Windows) -> Nuisance:
    """Of a vehicle whose file is a guess: its own ``coefficients``, and guesses of what it does not state.

    An effect that says what others say, in other numbers, is guessed at where the file states some of these numbers.
    What smooths commands is left as it is where windows have snapshots of them, which are noisy: smoothed, they predict
    better, whatever the thrusters do. A delay stands for it.
    """
    effects = {c.effect for c in coefficients}
    members = {(c.effect, c.member) for c in coefficients}
    covered = {name for effect in effects for name in EFFECTS[effect].covers}
    left = {name for name, effect in EFFECTS.items() if name in effects or not effect.covers} - covered
    given = [(c.effect, c.member, c.nominal, c.width) for c in coefficients]
    given += [entry for entry in guesses(vehicle) if entry[0] in left and entry[:2] not in members]
    if windows.errors.snapshot_s:
        given = [entry for entry in given if not EFFECTS[entry[0]].smooths]
    found = nuisance(vehicle, [*given, *sensor_nuisance(vehicle, settings, windows.channels)])
    return replace(found, repeating=MENDED_REPEATS, is_guess=True)


def guesses(vehicle: Vehicle) -> list[Entry]:
    """Every number that a file may have wrong."""
    found: list[Entry] = []
    for name, effect in EFFECTS.items():
        for member, p in effect.member_parameters(vehicle).items():
            width = p.guessed_within(vehicle, member)
            nominal = p.nominal_value(vehicle, member)
            if width:
                found.append((name, member, nominal, width))
    return that_matter(vehicle, found)


@dataclass(frozen=True)
class Centred:
    """A vehicle with what may differ from it, as far as flights have told."""

    vehicle: Vehicle  # empty batch
    nuisance: Nuisance  # about that vehicle
    file: Floats  # (k,) where the vehicle's file is from there
    covariance: Floats  # (k, k) of what another flight will show

    @staticmethod
    def at(file: Vehicle, nuisance: Nuisance) -> "Centred":
        """About the vehicle as its file says, before any flight."""
        covariance = np.diag(nuisance.width**2) + nuisance.between_flights()
        return Centred(file, nuisance, np.zeros(len(nuisance.entries)), covariance)

    @property
    def corrections(self) -> dict[tuple[str, str], float]:
        """By effect and parameter, by which share of what its file says a number was corrected.

        Of an offset, which counts from nothing, there is no share.
        """
        there = [(entry, entry[2] + away, away) for entry, away in zip(self.nuisance.entries, self.file, strict=True)]
        return {
            (effect, member): float(-away / abs(value))
            for (effect, member, nominal, _), value, away in there
            if abs(value) > NOTHING * abs(nominal) > 0
        }

    @property
    def prior(self) -> tuple[Floats, Floats]:
        """Where the file lets expect the numbers (k,), and its precision (k, k).

        Factors are as likely to be wrong by 2 as by a half: they are off by their logarithms. Squares of what they are
        off would take a vehicle of which no log tells the scale for too small a one.
        """
        width, nominal = self.nuisance.width, np.array([entry[2] for entry in self.nuisance.entries])
        is_factor = self._is_factor
        by = np.where(is_factor, nominal, 1.0)
        times = np.where(is_factor, np.maximum(1 + self.file / by, SMALLEST_FACTOR), 1.0)  # the file, of what it is
        away = np.where(is_factor, nominal * np.log(times), self.file)
        # The width of a factor is that of its logarithm: of what the file says, not of what the vehicle is.
        return away, self.nuisance.precision(width / times)

    @property
    def _is_factor(self) -> np.ndarray:
        """(k,) whether each number is a factor."""
        members = (entry[:2] for entry in self.nuisance.entries)
        return np.array(
            [EFFECTS[effect].member_parameters(self.vehicle)[name].is_factor for effect, name in members], bool
        )

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Least and most (k,) that each number may deviate by."""
        room = []
        for effect, member, nominal, _ in self.nuisance.entries:
            p = EFFECTS[effect].member_parameters(self.vehicle)[member]
            room.append((p.low - nominal, p.high - nominal))
        low, high = np.array(room).T
        return low, high

    def moved(self, deviation: Floats, covariance: Floats, sizes: Sequence[float] | None = None) -> "Centred":
        """About the vehicle with a deviation (k,), which flights leave open by ``covariance`` (k, k).

        ``sizes`` are how far flights differ, times what is stated of each spread.
        """
        there = replace(self, covariance=covariance).shifted(deviation)
        return there.sure(there.covariance + there.nuisance.between_flights(sizes))

    def shifted(self, deviation: Floats) -> "Centred":
        """About the vehicle with a deviation (k,), as unsure as before.

        A factor counts from the vehicle that it changes: a gain of 0.8 that became 1 is as unsure as 0.8, over 0.8.
        """
        own = apply_values(self.vehicle, self._values(deviation))
        nominal = [EFFECTS[effect].nominal(own)[member] for effect, member, *_ in self.nuisance.entries]
        before = np.array([entry[2] for entry in self.nuisance.entries])
        is_factor = self._is_factor
        gone = is_factor & (np.abs(before + deviation) < SMALLEST_FACTOR * np.abs(before))
        if gone.any():
            deviation = np.where(gone, (SMALLEST_FACTOR - 1) * before, deviation)
            own = apply_values(self.vehicle, self._values(deviation))
        factor = np.where(is_factor, before / np.where(is_factor, before + deviation, 1.0), 1.0)
        entries = tuple((*s[:2], new, s[3]) for s, new in zip(self.nuisance.entries, nominal, strict=True))
        keys = [(effect, member) for effect, member, *_ in entries]
        repeats = _repeats(own, keys, nominal, self.nuisance.repeating)
        width = self.nuisance.width * np.abs(factor)
        nuisance = replace(self.nuisance, entries=entries, width=width, repeats=repeats)
        there = Centred(own, nuisance, (self.file - deviation) * factor, self.covariance)
        return there.sure(self.covariance * np.outer(factor, factor))

    def sure(self, covariance: Floats) -> "Centred":
        """The same, as sure as a covariance (k, k) says."""
        size = np.sqrt(np.diag(covariance)).tolist()
        entries = tuple((*entry[:3], s) for entry, s in zip(self.nuisance.entries, size, strict=True))
        return replace(self, nuisance=replace(self.nuisance, entries=entries), covariance=covariance)

    def _values(self, deviation: Floats) -> Values:
        """Effect values within their bounds: a mean over flights knows of none."""
        values: Values = {}
        for (effect, member, nominal, _), by in zip(self.nuisance.entries, deviation.tolist(), strict=True):
            p = EFFECTS[effect].member_parameters(self.vehicle)[member]
            values.setdefault(effect, {})[member] = min(max(nominal + by, p.low), p.high)
        return values
