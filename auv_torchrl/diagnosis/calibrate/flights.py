"""Several flights of one vehicle: what they share, how they differ, and which disturbance they show.

Each flight is fitted by itself, with the nuisance parameters free. A mean and a spread between flights are then fitted
to all of them (random effects), and the disturbance is measured under that vehicle. Both are repeated a few times.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.calibrate.parameters import VehicleEstimate
from auv_torchrl.diagnosis.calibrate.scale_ambiguity import hold_scale
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation, fitted_on
from auv_torchrl.diagnosis.identify.following import follow_windows, followed_as_before
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.paths import Fit, leaves_much, log_likelihood, nuisance_now
from auv_torchrl.diagnosis.identify.problem import HealthyPrior, Problem
from auv_torchrl.diagnosis.motion.reduce import Quadratic, disturbance_precision, local_precision
from auv_torchrl.diagnosis.motion.smooth import Layout, noise_per_sample
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import MOSTLY_LOST, NEAR, PRIOR_NUMBERS
from auv_torchrl.diagnosis.verdict import FLOOR_ASSUMED
from auv_torchrl.flightlog import Finding, Severity
from auv_torchrl.sysid.bounded import least_within
from auv_torchrl.vehicle import DEGREES_OF_FREEDOM, Vehicle

ROUNDS = 30  # of both fixed points, at most
STATED_FLIGHTS = 2.0  # flights that the stated spread counts for, against those of the logs
PASSES = 4  # coefficients and floor in turn; the last pass is under the floor that the pass before has shown
STANDS = 0.5  # standard deviations: a vehicle whose coefficients all moved by less needs no further pass
FlightFit = tuple[Problem, Fit]


def disturbance_floor(flights: Sequence[FlightFit]) -> Floats:
    """Standard deviation (D,) in N and N m of the force that acts on a healthy vehicle.

    The size makes the samples of all windows most likely (MacKay 1992, fixed point of the evidence). The floor of the
    settings counts as a few forces more: a log that determines no force cannot claim a floor of zero.
    """
    problem, _ = flights[0]
    stated = np.array(problem.settings.floor_force)[problem.layout.dof]
    floor, each = stated.copy(), [_start_and_force_quadratics(*flight) for flight in flights]
    for _ in range(ROUNDS):
        counted = [
            _force_squares(flight.layout, flight.windows.dt, floor, *quadratics)
            for (flight, _), quadratics in zip(flights, each, strict=True)
        ]
        squares, seen = np.sum(counted, axis=0)
        floor = np.sqrt((squares + PRIOR_NUMBERS * stated**2) / (seen + PRIOR_NUMBERS))
    return floor


def _force_squares(
    layout: Layout, dt: float, floor: Floats, gram: Floats, pull: Floats, away: Floats
) -> tuple[Floats, Floats]:
    """Squares (D,) of the forces that one flight shows under a floor (D,), and how many forces these are.

    A flight that moves faster than another has shorter bins, and more of them.
    """
    count, starts, (bins, dofs) = len(gram), len(layout.start), (layout.bins, len(layout.dof))
    unit = disturbance_precision(layout, dt, np.ones(1))  # (B, B)
    precision = local_precision(layout, dt, floor)
    covariance = np.linalg.inv(gram + precision)
    mean = away + np.einsum("wlm,wm->wl", covariance, pull - away @ precision)
    force = mean[:, starts:].reshape(count, bins, dofs)
    spread = covariance[:, starts:, starts:].reshape(count, bins, dofs, bins, dofs)
    squares: Floats = np.einsum("wbd,bc,wcd->d", force, unit, force)
    return squares, count * bins - np.einsum("bc,wbdcd->d", unit, spread) / floor**2


def _start_and_force_quadratics(problem: Problem, fit: Fit) -> tuple[Floats, Floats, Floats]:
    """Curvature (w, L, L) and slope (w, L) in starts and forces (w, L), and these, of the windows that are followed."""
    windows, state = problem.windows, fit.path.state
    used = np.isfinite(state.slope).all((1, 2)) & np.isfinite(state.residual).all(1) & problem.followed
    weight = 1.0 / noise_per_sample(windows, problem.sigma)
    slope, residual = state.slope[used] * weight[:, None], state.residual[used] * weight
    away = problem.layout.away(windows, state.start, state.bins)[used]
    return slope.swapaxes(1, 2) @ slope, np.einsum("wkl,wk->wl", slope, residual), away


def floor_findings(problem: Problem) -> tuple[Finding, ...]:
    """What the verdict rests on where there is no healthy flight: an assumed floor, or that of the corrected file."""
    sizes = sizes_by_axis(np.array(problem.settings.floor_force), problem.layout.dof)
    sentence = (
        "no healthy log: the verdict rests on an assumed disturbance of "
        f"{sizes} and on coefficients within a few per cent"
    )
    remedy = "Give healthy=LOG, a flight of the sound vehicle, to measure both"
    assumed = Finding(Severity.INFO, FLOOR_ASSUMED, sentence, remedy)
    if problem.known is None or not problem.known.of_itself:
        return (assumed,)
    sizes = sizes_by_axis(problem.known.floor, problem.layout.dof)
    sentence = (
        f"effects are looked for beside a disturbance of {sizes}, which is what this log leaves of the corrected file: "
        "smaller ones cannot be seen"
    )
    return Finding(Severity.INFO, "floor_of_this_log", sentence), assumed


def sizes_by_axis(floor: Floats, dof: Iterable[int]) -> str:
    """Sizes of a disturbance (6,) in N and N m, of the degrees of freedom ``dof``, in words."""
    return ", ".join(f"{floor[d]:.2g} {'N' if d < 3 else 'N m'} in {DEGREES_OF_FREEDOM[d]}" for d in dof)


@dataclass(frozen=True)
class FlightInformation:
    """What one flight tells of the numbers (k,): its chi-square is ``a A a - 2 h a`` and a constant."""

    A: Floats  # (k, k)
    h: Floats  # (k,)

    @staticmethod
    def of(quadratic: Quadratic, at: Floats) -> "FlightInformation":
        """The information in a quadratic in the amounts beyond deviations ``at`` (k,)."""
        k = len(at)
        return FlightInformation(quadratic.A[:k, :k], quadratic.b[:k] + quadratic.A[:k, :k] @ at)


@dataclass(frozen=True)
class RandomEffects:
    """The numbers (k,) of a vehicle over its flights."""

    mean: Floats  # (k,) deviations that all flights share
    covariance: Floats  # (k, k) of the mean
    sizes: tuple[float, ...]  # of each spread between flights, over what is stated


def fit_random_effects(flights: Sequence[FlightInformation], estimate: VehicleEstimate) -> RandomEffects:
    """The mean over flights and the spread between them, by expectation-maximization (Dempster, Laird, Rubin 1977).

    The mean keeps within bounds, and what a number at its bound leaves goes to the others: a file that is wrong by
    factors has added masses which end at nothing. One flight shows no spread, so the spread is as stated. Otherwise the
    file's error would count as a difference between flights, and the mean would go back to the file.

    Args:
        flights: what each flight tells.
        estimate: the vehicle from which the numbers count, with the priors of the file's error and of the spread.
    """
    (prior_mean, prior), nuisance, bounds = estimate.file_prior, estimate.nuisance, estimate.bounds
    stated_size = np.array([np.linalg.matrix_rank(part) for part in nuisance.spread])
    inverse = [np.linalg.pinv(part, hermitian=True) for part in nuisance.spread]
    sizes, mean, covariance = np.ones(len(nuisance.spread)), prior_mean, prior
    for _ in range(ROUNDS):
        between = nuisance.between_flights(sizes.tolist())
        reduced = [np.linalg.inv(np.eye(len(prior)) + flight.A @ between) for flight in flights]
        informed = sum((r @ flight.A for r, flight in zip(reduced, flights, strict=True)), prior)
        pull = sum((r @ flight.h for r, flight in zip(reduced, flights, strict=True)), prior @ prior_mean)
        covariance = np.linalg.inv(0.5 * (informed + informed.T))
        mean = least_within(informed, pull, bounds, np.eye(len(prior)))
        if len(flights) == 1:
            break
        squares = np.zeros_like(between)
        for r, flight in zip(reduced, flights, strict=True):
            gain = between @ r
            own = gain @ (flight.h - flight.A @ mean)
            along = gain @ flight.A
            squares += np.outer(own, own) + gain + along @ covariance @ along.T
        seen = np.array([float((part * squares).sum()) for part in inverse])
        fresh = np.sqrt((STATED_FLIGHTS * stated_size + seen) / (stated_size * (STATED_FLIGHTS + len(flights))))
        settled = np.allclose(fresh, sizes, rtol=1e-3)
        sizes = fresh
        if settled:
            break
    return RandomEffects(mean, covariance, tuple(sizes.tolist()))


@dataclass(frozen=True)
class FlightsFit:
    """A vehicle fitted to its flights, with what each flight tells."""

    estimate: VehicleEstimate
    prior: HealthyPrior
    linearised: VehicleEstimate  # about which the flights were fitted last
    with_fixed: VehicleEstimate  # the vehicle before its fixed properties left the nuisance parameters
    misfits: tuple[tuple[float, float], ...]  # of each flight under the first floor: chi-square, numbers
    fits: tuple[FlightFit, ...] = ()  # about ``linearised``, under the floor of the pass before
    information: tuple[FlightInformation, ...] = ()  # of each flight, under the floor that the flights show
    first_excess: float = np.inf  # chi-square per number of the first pass, before flights share anything

    @property
    def excess(self) -> float:
        """Chi-square per number under the first floor."""
        return _per_number(self.misfits)

    @property
    def log_likelihood(self) -> float:
        """Log evidence of all flights, to compare vehicles that have other degrees of freedom."""
        return sum(log_likelihood(*one) for one in self.fits) if self.fits else -np.inf

    @property
    def hides_tilts(self) -> bool:
        """Whether the vehicle tilts and nobody measured that."""
        return bool(self.fits) and self.fits[0][0].layout.moves_unseen

    def without_flight(self, place: int) -> "FlightsFit":
        """The vehicle as all flights but one show it, linearised about what all of them show.

        What a flight tells depends on the others only through the vehicle about which it is linearised. The prior is
        the file's, and the floor that of the other flights.
        """
        first, behind = slice(place), slice(place + 1, None)
        fits = self.fits[first] + self.fits[behind]
        information = self.information[first] + self.information[behind]
        estimate, sizes, _ = _update(self.linearised, information, self.hides_tilts)
        floor = _measure_floor(self.prior.floor, fits)
        prior = _with_nuisance(replace(self.prior, floor=floor), estimate, sizes, len(information))
        misfits = self.misfits[first] + self.misfits[behind]
        return replace(self, estimate=estimate, prior=prior, misfits=misfits, fits=fits, information=information)


def fit_flights(
    flights: Sequence[Windows],
    estimate: VehicleEstimate,
    prior: HealthyPrior,
    settings: Settings,
    most: float = np.inf,
    passes: int = PASSES,
) -> FlightsFit:
    """What flights share, how they differ, and their floor.

    Fixed properties of the vehicle, such as the places of its thrusters, leave the nuisance parameters before the last
    pass: until then flights that differ in their trims tell of them.

    Args:
        flights: the windows of each flight.
        estimate: the vehicle to begin from.
        prior: with the floor and the noise to begin from.
        settings: of the diagnosis.
        most: excess above which another vehicle is needed: the fit then ends, as it does where no flight is followed.
        passes: of fitting and measuring, at most.
    """
    misfits, linearised, with_fixed, fits, information = (), estimate, estimate, (), ()
    is_last, first_excess = False, np.inf
    prior = fitted_under = replace(prior, shrinks=None)  # of a vehicle with other numbers
    for turn in range(passes):
        prior = replace(prior, nuisance=estimate.nuisance.entries, nuisance_covariance=estimate.covariance)
        before = fits or [None] * len(flights)
        now = tuple(
            fit_flight(own, estimate.vehicle, settings, prior, then) for own, then in zip(flights, before, strict=True)
        )
        own_misfits = tuple((fit.chi2, fit.quadratic.numbers) for _, fit in now)
        first_excess = first_excess if turn else _per_number(own_misfits)
        if not misfits or not is_last and _per_number(own_misfits) < _per_number(misfits):
            misfits = own_misfits
        excess = _per_number(misfits)
        are_lost = any(problem.followed.mean() <= MOSTLY_LOST for problem, _ in now)
        if excess > most or are_lost:  # lost flights tell of no vehicle, and their information may be no number
            return FlightsFit(estimate, prior, estimate, estimate, misfits)
        if is_last and _per_number(own_misfits) > max(NEAR, excess):  # windows were lost: the vehicle before is better
            estimate = with_fixed = linearised
            prior = replace(fitted_under, floor=prior.floor)
            break
        linearised, fitted_under, fits, floor = estimate, prior, now, _measure_floor(prior.floor, now)
        information = tuple(_inform(*one, floor) for one in fits)
        estimate, sizes, moved = _update(linearised, information, fits[0][0].layout.moves_unseen)
        is_right = not estimate.nuisance.is_guess and _per_number(own_misfits) <= 1
        stands = is_right or moved < STANDS or turn == passes - 2
        with_fixed = with_fixed if is_last else estimate
        if stands and not is_last:
            estimate = estimate.without_fixed_properties()
        prior = _with_nuisance(prior, estimate, sizes, len(information))
        prior = replace(prior, floor=floor) if is_last or stands else prior
        if is_last:
            break
        is_last = stands
    for problem, _ in fits:
        problem.freedoms.clear()  # the flights stay beside the log that is explained
    return FlightsFit(estimate, prior, linearised, with_fixed, misfits, fits, information, first_excess)


def fit_flight(
    windows: Windows, own: Vehicle, settings: Settings, prior: HealthyPrior, before: FlightFit | None = None
) -> FlightFit:
    """One flight under a vehicle that differs from it as flights do, by the nuisance parameters of ``prior``.

    A window that flew off under another flight's trim comes back once the trim of this flight is fitted. A lost window
    would look like a disturbance that acts on a healthy vehicle. ``before`` is the fit under another vehicle, for which
    the motion of the flight was measured.
    """
    problem = Problem.of(windows, own, settings, prior)
    if before is None:
        problem, path = follow_windows(problem)
    else:
        path = before[1].path
        problem = followed_as_before(problem, before[0], path)
    fit = fit_by_simulation(problem, Explanation(), path)
    return problem, fitted_on(problem, fit) if leaves_much(problem, fit) else fit


def _update(
    linearised: VehicleEstimate, information: Sequence[FlightInformation], hides_tilts: bool
) -> tuple[VehicleEstimate, tuple[float, ...], float]:
    """The vehicle that flights show, the sizes of their spreads, and the largest move in standard deviations.

    ``hides_tilts`` is whether the vehicle tilts and nobody measures that.
    """
    effects = fit_random_effects(information, linearised)
    covariance = effects.covariance
    if linearised.nuisance.is_guess:
        covariance = hold_scale(covariance, linearised, hides_tilts)
    moved = float(np.max(np.abs(effects.mean) / np.sqrt(np.diag(covariance)), initial=0.0))
    return linearised.updated(effects.mean, covariance, effects.sizes), effects.sizes, moved


def _with_nuisance(
    prior: HealthyPrior, estimate: VehicleEstimate, sizes: Sequence[float], flights: int
) -> HealthyPrior:
    """The prior with the nuisance parameters of a vehicle whose flights differ by ``sizes`` of what is stated."""
    shrinks = estimate.covariance - estimate.nuisance.between_flights(sizes)
    nuisance = {"nuisance": estimate.nuisance.entries, "nuisance_covariance": estimate.covariance}
    return replace(prior, **nuisance, flights=flights, shrinks=shrinks)


def _measure_floor(before: Floats, fits: Sequence[FlightFit]) -> Floats:
    """The disturbance (6,) that flights show; ``before`` in degrees of freedom that they do not measure."""
    floor = before.copy()
    floor[fits[0][0].layout.dof] = disturbance_floor(fits)
    return floor


def _inform(problem: Problem, fit: Fit, floor: Floats) -> FlightInformation:
    """What a flight tells under another disturbance (6,), at the point of its fit, whose slopes are at hand."""
    problem = replace(problem, floor=floor[problem.layout.dof])
    fit = fit_by_simulation(problem, fit.explanation, fit.path, rounds=0)
    return FlightInformation.of(fit.quadratic, nuisance_now(problem, fit.explanation))


def _per_number(misfits: Sequence[tuple[float, float]]) -> float:
    chi2, numbers = np.sum(misfits, axis=0).tolist()
    return chi2 / numbers
