"""What explanations of one log are weighed by: windows, vehicle, noise, disturbance and nuisance parameters."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from auv_torchrl.diagnosis.identify.explanation import Prior
from auv_torchrl.diagnosis.identify.hypotheses import (
    Candidate,
    Settings,
    batch,
    make_candidates,
    nuisance_parameters,
    sensor_nuisance,
)
from auv_torchrl.diagnosis.latest import Latest
from auv_torchrl.diagnosis.motion.actuation import usual_speed
from auv_torchrl.diagnosis.motion.noise import first_noise
from auv_torchrl.diagnosis.motion.reduce import Freedom
from auv_torchrl.diagnosis.motion.smooth import Layout, Smoothed
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import (
    FELT_ALONE,
    LONG_STEP,
    MENDED_REPEATS,
    NOISIER,
    NUISANCE_LIMIT,
    NUISANCE_STEP,
    REPEATS,
    WIDE_SHARE,
)
from auv_torchrl.effects import EFFECTS
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.pushes import wrench_per_share
from auv_torchrl.vehicle import Vehicle

NuisanceEntry = tuple[str, str, float, float]  # effect, parameter, nominal, standard deviation
LEAST_REACH = 0.1  # N, N m, where thrusters make nothing
FREEDOMS_KEPT = 4  # those of the path, of a trial and of their wide force; each holds as much as the slopes,
FREEDOMS_BYTES = 64 << 20  # and no more than this together


@dataclass(frozen=True)
class HealthyPrior:
    """What healthy flights show of a vehicle, or the log itself where the file was corrected on it."""

    floor: Floats  # (6,) N, N m
    noise: dict[str, float]  # by channel
    rough_noise: dict[str, float]  # by channel, from third differences, to compare another log with
    nuisance: tuple[NuisanceEntry, ...]
    nuisance_covariance: Floats  # (k, k), in the order of the nuisance parameters
    scales: Floats | None = None  # (k, g) by how much each number may be off with each of g ambiguous scales
    flights: int = 0  # from which the prior was learnt; 0 where nobody knows
    shrinks: Floats | None = None  # (k, k) part of the covariance that falls with the number of these flights
    of_itself: bool = False  # whether the log that is explained has shown the prior, with a fault if it has one

    def beside(self, own: Sequence[NuisanceEntry]) -> "HealthyPrior":
        """The same prior with nuisance parameters of channels that the healthy flights may not have had."""
        there = {entry[:2] for entry in self.nuisance}
        new = [entry for entry in own if entry[:2] not in there]
        if not new:
            return self
        from scipy.linalg import block_diag  # here: it takes long to import

        return replace(
            self,
            nuisance=(*self.nuisance, *new),
            nuisance_covariance=block_diag(self.nuisance_covariance, np.diag([width**2 for *_, width in new])),
            shrinks=None if self.shrinks is None else np.pad(self.shrinks, (0, len(new))),
            scales=None if self.scales is None else np.pad(self.scales, ((0, len(new)), (0, 0))),
        )


@dataclass(frozen=True)
class Problem:
    """A log cut into windows, the vehicle that should explain it, and all that an explanation is fit by.

    It is never changed: following the log, measuring its noise again or learning what nuisance parameters explain gives
    another one.
    """

    given: Windows  # as they were cut
    windows: Windows  # with less trust in outliers, once they were followed
    vehicle: Vehicle  # nominal, empty batch
    settings: Settings
    known: HealthyPrior | None  # from healthy logs
    layout: Layout
    floor: Floats  # (D,) N, N m: standard deviation of the disturbance in the measured degrees of freedom
    reach: Floats  # (6,) N, N m: most of what the thrusters can make in each degree of freedom, or in one of its kind
    wide: Floats  # (D,) N, N m: prior of the force while a wrong model follows the log
    candidates: tuple[Candidate, ...]  # changes to try
    nuisance: tuple[NuisanceEntry, ...]
    nuisance_covariance: Floats  # (k, k)
    nuisance_precision: Floats  # (k, k)
    prior: Prior
    rough_noise: dict[str, float]  # by channel, from third differences
    noisier: dict[str, float]  # by channel, how many times noisier than the healthy log, where that is much
    sigma: dict[str, float]  # by channel, standard deviation of the sensor noise
    followed: np.ndarray  # (W,) bool: windows in which the motion is known
    seen_start: Floats  # (W, 12) where windows begin, whatever the vehicle
    nuisance_size: float = 0.0  # of the force of nuisance parameters alone, in units of the thrusters' reach
    freedoms: Latest[Freedom] = field(default_factory=lambda: _freedoms(), repr=False, compare=False)

    @staticmethod
    def of(windows: Windows, vehicle: Vehicle, settings: Settings, known: HealthyPrior | None = None) -> "Problem":
        """A log that has not been followed yet.

        Raises:
            FlightLogError: if the log measures no degree of freedom in which the vehicle moves.
        """
        layout = Layout.of(windows, vehicle, settings.bin_s)
        reach = _reach(vehicle, usual_speed(windows))
        rough, noisier, floor = first_noise(windows), {}, np.array(settings.floor_force)
        if known is None:
            nuisance = tuple(nuisance_parameters(vehicle, settings, windows.channels))
            covariance = np.diag(np.array([width for *_, width in nuisance]) ** 2)
        else:
            known = known.beside(sensor_nuisance(vehicle, settings, windows.channels))
            nuisance, covariance = known.nuisance, known.nuisance_covariance
            floor, noisier = known.floor, _noisier(rough, known.rough_noise)
        asked = {name: effect for name, effect in EFFECTS.items() if effect.trial.is_asked(windows.channels)}
        shown = {name: effect for name, effect in asked.items() if effect.trial.shows_in(windows.errors.drift)}
        candidates = tuple(make_candidates(vehicle, settings, shown))
        return Problem(
            given=windows,
            windows=windows,
            vehicle=vehicle,
            settings=settings,
            known=known,
            layout=layout,
            floor=floor[layout.dof],
            reach=_or_of_kind(reach),
            wide=reach[layout.dof] * np.where(layout.by_specific_force, FELT_ALONE, 1.0),
            candidates=candidates,
            nuisance=nuisance,
            nuisance_covariance=covariance,
            nuisance_precision=np.linalg.inv(covariance),
            prior=Prior(vehicle, len({candidate.effect for candidate in candidates}), settings.prior_none),
            rough_noise=rough,
            noisier=noisier,
            sigma=believed_noise(known, noisier, rough),
            followed=np.ones(len(windows), bool),
            seen_start=windows.guess,
        )

    @property
    def outlying(self) -> np.ndarray:
        """(W, m, C) samples that no force could have reached: they count less than they were given to."""
        return self.windows.trust < self.given.trust

    @property
    def even(self) -> np.ndarray:
        """(k,) nuisance parameters in which chi-square is smooth: moving a threshold flips single samples."""
        return np.array([not self.settings.is_rough(effect) for effect, *_ in self.nuisance])

    def nuisance_step(self, nuisance: NuisanceEntry) -> float:
        """By how much a nuisance parameter is moved to see what it does.

        By a share of its size, or of its width where that is more. A share of what its bounds allow would show another
        vehicle of a hundred times the mass, and not how this one changes with its mass.
        """
        effect, member, nominal, width = nuisance
        step = NUISANCE_STEP * max(abs(nominal), width)
        return max(step, LONG_STEP * self.prior.width(effect, member)) if self.settings.is_rough(effect) else step

    @cached_property
    def nuisance_bounds(self) -> tuple[Floats, Floats]:
        """Least and most (k,) that nuisance parameters may deviate by: more is a gap, or impossible."""
        low, high = [], []
        for effect, member, nominal, width in self.nuisance:
            p = EFFECTS[effect].member_parameters(self.vehicle)[member]
            low.append(max(-NUISANCE_LIMIT * width, p.low - nominal))
            high.append(min(NUISANCE_LIMIT * width, p.high - nominal))
        return np.array(low), np.array(high)

    def believed(self, measured: dict[str, float]) -> dict[str, float]:
        """Noise by channel: what was measured, or what a healthy log showed, see :func:`believed_noise`."""
        return believed_noise(self.known, self.noisier, measured)

    @property
    def repeating(self) -> float:
        """How well the vehicle repeats itself, relative: less well where healthy flights have mended its file."""
        return MENDED_REPEATS if self.known is not None and self.known.scales is not None else REPEATS

    def freedom(self, state: Smoothed, prior: Floats | None = None) -> Freedom:
        """What the free numbers of windows with the slopes of a state absorb, the disturbance held by ``prior``."""
        held = self.sigma, self.floor if prior is None else prior
        given = state.slopes, *held
        return self.freedoms.of(lambda: Freedom.of(self.windows, self.layout, state.slope, *held), given)


def _freedoms() -> Latest[Freedom]:
    return Latest(FREEDOMS_KEPT, FREEDOMS_BYTES, _size_of)


def _size_of(freedom: Freedom) -> int:
    """Bytes; a function of the module, so that a problem can be sent to another process."""
    return freedom.size


def believed_noise(
    known: HealthyPrior | None, noisier: dict[str, float], measured: dict[str, float]
) -> dict[str, float]:
    """Noise by channel: that of the healthy log, unless the sensors have become worse since, or what was measured.

    Noise that is fitted on a log hides what its simulator misses.
    """
    frozen = {} if known is None else {name: size for name, size in known.noise.items() if name not in noisier}
    return {name: frozen.get(name, size) for name, size in measured.items()}


def _noisier(now: dict[str, float], then: dict[str, float]) -> dict[str, float]:
    """By channel, how many times noisier a log is, where it is so."""
    ratio = {name: size / then[name] for name, size in now.items() if name in then}
    return {name: times for name, times in ratio.items() if times > NOISIER}


def _reach(vehicle: Vehicle, speed: float) -> Floats:
    """Force (6,) that thrusters, and fins at a speed, can make in each degree of freedom, N and N m, or most of it."""
    c = prepare(batch(vehicle, [{}])).numpy()
    push = np.abs(wrench_per_share(c, ActiveTerms.of(c), speed)[0]).sum(-1)
    return np.maximum(WIDE_SHARE * push, LEAST_REACH)


def _or_of_kind(reach: Floats) -> Floats:
    """The same (6,), with the largest of its kind where thrusters make no force, or no moment."""
    largest = np.repeat(reach.reshape(2, 3).max(1), 3)
    return np.where(reach > LEAST_REACH, reach, largest)
