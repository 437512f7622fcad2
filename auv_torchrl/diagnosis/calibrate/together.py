"""A vehicle as several flights show it together, and as all of them but one do."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.calibrate.approach import settled
from auv_torchrl.diagnosis.calibrate.flights import Told, share
from auv_torchrl.diagnosis.calibrate.floor import disturbance_floor
from auv_torchrl.diagnosis.calibrate.gauge import hold_scale
from auv_torchrl.diagnosis.calibrate.nuisance import Centred
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation, fitted_on, rescued
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.paths import Fit, leaves_much, log_likelihood, nuisance_now
from auv_torchrl.diagnosis.identify.problem import Known, Problem
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import MOSTLY_LOST, NEAR
from auv_torchrl.vehicle import Vehicle

PASSES = 4  # coefficients and floor in turn, the last one under the floor that the one before has shown; fewer ...
STANDS = 0.5  # ... where no coefficient moved by more of its standard deviation, or a file that is right left nothing
FlightFit = tuple[Problem, Fit]


@dataclass(frozen=True)
class Together:
    """The vehicle with what its flights tell of it."""

    centred: Centred
    known: Known
    about: Centred  # about which the flights were followed last
    whole: Centred  # the vehicle before what it is for good was settled, that among its numbers
    misfits: tuple[tuple[float, float], ...]  # of each flight under the floor to begin from: chi-square, numbers
    fits: tuple[FlightFit, ...] = ()  # about there under the floor before,
    told: tuple[Told, ...] = ()  # and what they tell under the one that they show
    at_once: float = np.inf  # the excess before any flight has told the others anything

    @property
    def excess(self) -> float:
        """Chi-square per number under the floor to begin from."""
        return _per_number(self.misfits)

    @property
    def likelihood(self) -> float:
        """Log evidence of all flights, to compare vehicles that have other degrees of freedom."""
        return sum(log_likelihood(*one) for one in self.fits) if self.fits else -np.inf

    @property
    def hides(self) -> bool:
        """Whether the vehicle tilts and nobody measured that."""
        return bool(self.fits) and self.fits[0][0].layout.moves_unseen

    def without(self, place: int) -> "Together":
        """As all flights but one show it, linearised about what all of them show.

        What a flight tells does not depend on the others, but for the vehicle about which it is linearised: what the
        one that is left out has told is gone. The prior is the file's, and the floor that of the others.
        """
        first, behind = slice(place), slice(place + 1, None)
        fits, told = self.fits[first] + self.fits[behind], self.told[first] + self.told[behind]
        centred, sizes, _ = _shown(self.about, told, self.hides)
        known = _knows(replace(self.known, floor=_floor(self.known.floor, fits)), centred, sizes, len(told))
        misfits = self.misfits[first] + self.misfits[behind]
        return Together(centred, known, self.about, self.whole, misfits, fits, told, self.at_once)


def follow_all(
    flights: Sequence[Windows],
    centred: Centred,
    known: Known,
    settings: Settings,
    most: float = np.inf,
    passes: int = PASSES,
) -> Together:
    """What flights share, how they differ, the floor (6,), and the excess under the one to begin from.

    Of an excess of more than ``most``, or of flights that nothing follows, no more: then another vehicle is needed.
    What a vehicle is for good, as where its thrusters sit, is settled before the last pass: until then flights that
    differ in their trims tell of it.
    """
    misfits, about, whole, fits, told, is_last, at_once = (), centred, centred, (), (), False, np.inf
    known = knew = replace(known, shrinks=None)  # what was learnt of a vehicle with other numbers
    for turn in range(passes):
        known = replace(known, nuisance=centred.nuisance.entries, nuisance_covariance=centred.covariance)
        followed = tuple(follow_flight(own, centred.vehicle, settings, known) for own in flights)
        left = tuple((fit.chi2, fit.quadratic.numbers) for _, fit in followed)
        at_once = at_once if turn else _per_number(left)
        if not misfits or not is_last and _per_number(left) < _per_number(misfits):
            misfits = left
        excess = _per_number(misfits)
        are_lost = any(problem.followed.mean() <= MOSTLY_LOST for problem, _ in followed)
        if excess > most or are_lost:  # what lost flights tell is not of the vehicle, and may be no number
            return Together(centred, known, centred, centred, misfits)
        if is_last and _per_number(left) > max(NEAR, excess):  # windows were lost: the vehicle before did better
            centred = whole = about
            known = replace(knew, floor=known.floor)
            break
        about, knew, fits, floor = centred, known, followed, _floor(known.floor, followed)
        told = tuple(_tells(*one, floor) for one in fits)
        hides = fits[0][0].layout.moves_unseen
        centred, sizes, moved = _shown(about, told, hides)
        stands = not centred.nuisance.is_guess and _per_number(left) <= 1 or moved < STANDS or turn == passes - 2
        whole = whole if is_last else centred
        if stands and not is_last:
            centred = settled(centred)
        known = _knows(known, centred, sizes, len(told))
        known = replace(known, floor=floor) if is_last or stands else known
        if is_last:
            break
        is_last = stands
    return Together(centred, known, about, whole, misfits, fits, told, at_once)


def follow_flight(windows: Windows, own: Vehicle, settings: Settings, known: Known) -> FlightFit:
    """One flight under a vehicle that differs in it as flights do: by the slack of ``known``.

    A window that flew off under another flight's trim comes back once that of this flight is fitted. Lost windows
    would look like a disturbance that acts on a sound vehicle.
    """
    problem, follow = follow_windows(Problem.of(windows, own, settings, known))
    fit = rescued(problem, fit_by_simulation(problem, Explanation(), follow), follow)
    return problem, fitted_on(problem, fit) if leaves_much(problem, fit) else fit


def _shown(about: Centred, told: Sequence[Told], hides: bool) -> tuple[Centred, tuple[float, ...], float]:
    """The vehicle that flights show, of what each tells of numbers ``about`` one, and how far they differ.

    ``hides`` is whether it tilts and nobody measures that.

    Also by how many of its standard deviations the number moved that moved most.
    """
    shared = share(told, about)
    open_still = hold_scale(shared.covariance, about, hides) if about.nuisance.is_guess else shared.covariance
    moved = float(np.max(np.abs(shared.mean) / np.sqrt(np.diag(open_still)), initial=0.0))
    return about.moved(shared.mean, open_still, shared.sizes), shared.sizes, moved


def _knows(known: Known, centred: Centred, sizes: Sequence[float], flights: int) -> Known:
    """With the slack of a vehicle that some flights have shown, which differ by ``sizes`` of what is stated."""
    shrinks = centred.covariance - centred.nuisance.between_flights(sizes)
    nuisance = {"nuisance": centred.nuisance.entries, "nuisance_covariance": centred.covariance}
    return replace(known, **nuisance, flights=flights, shrinks=shrinks)


def _floor(before: Floats, fits: Sequence[FlightFit]) -> Floats:
    """The disturbance (6,) that flights show; as before where they cannot."""
    floor = before.copy()
    floor[fits[0][0].layout.dof] = disturbance_floor(fits)
    return floor


def _tells(problem: Problem, fit: Fit, floor: Floats) -> Told:
    """What a flight tells under another disturbance (6,), weighed where it was fitted: it has its slopes there."""
    problem = replace(problem, floor=floor[problem.layout.dof])
    fit = fit_by_simulation(problem, fit.explanation, fit.path, rounds=0)
    return Told.of(fit.quadratic, nuisance_now(problem, fit.explanation))


def _per_number(misfits: Sequence[tuple[float, float]]) -> float:
    chi2, numbers = np.sum(misfits, axis=0).tolist()
    return chi2 / numbers
