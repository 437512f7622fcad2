"""What judging explanations of one log rests on: windows, vehicle, settings, noise, disturbance and slack."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from auv_torchrl.diagnosis.motion.force import force_changes, middles
from auv_torchrl.diagnosis.motion.reduce import Freedom, Quadratic
from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.motion.smooth import Layout, Smoothed, first_noise
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.which.evidence import Prior
from auv_torchrl.diagnosis.which.explanation import Explanation
from auv_torchrl.diagnosis.which.hypotheses import Settings, batch, make_atoms, slack_parameters
from auv_torchrl.physics import prepare
from auv_torchrl.vehicle import Vehicle

WIDE_SHARE = 0.6  # of the full thrust in a degree of freedom: prior of the force while a wrong model follows the log
NOISIER = 1.3  # times the noise of the healthy log, from which its noise says nothing about this log
MINOR = 0.5  # of the force that slack makes: an effect below it is no finding
STRAINED = 2.5  # standard deviations of slack, beyond which it may stand in for an effect
SATISFIED = 2.0  # standard deviations of chi-square above its mean, below which nothing more is looked for


@dataclass(frozen=True)
class Base:
    """Windows that follow the log under one explanation."""

    explanation: Explanation
    vehicle: Vehicle  # (1,) with the explanation, slack included
    state: Smoothed
    states: Floats  # (W, S + 1, 13) on the grid

    @cached_property
    def motion(self) -> Floats:
        """(W, S, 13) in the middle of each grid step."""
        return middles(self.states)

    def without_slopes(self) -> "Base":
        """The motion alone, in a fifteenth of the memory: to compare with or to begin from, not to linearise about."""
        nothing = np.empty(0)
        return replace(self, state=replace(self.state, slope=nothing, transition=nothing, push=nothing))


@dataclass(frozen=True)
class Known:
    """What a healthy log has shown."""

    floor: Floats  # (6,) N, N m
    noise: dict[str, float]  # by channel
    rough_noise: dict[str, float]  # by channel, from third differences, to compare another log with
    slack_covariance: Floats  # (k, k) of the deviations that are left, in the order of the slack parameters


@dataclass(frozen=True)
class Judged:
    """An explanation with its values fitted."""

    explanation: Explanation
    chi2: float  # with the cost of slack
    evidence: float
    covariance: Floats  # (k, k) of the fitted knobs, slack included
    base: Base
    quadratic: Quadratic  # of slack, then fitted knobs, at the base
    steps: Floats  # (k,) one unit of the quadratic, of each fitted knob
    slack_marks: Floats | None  # (W, K, k) that it was made of, while its values are being fitted

    @property
    def nothing_left(self) -> bool:
        """Whether nothing is left beyond the noise."""
        numbers = self.quadratic.numbers
        return self.chi2 < numbers * (1 + SATISFIED * np.sqrt(2 / numbers))


class Ground:
    """A log cut into windows, a vehicle and the settings to judge with."""

    def __init__(self, windows: Windows, vehicle: Vehicle, settings: Settings, known: Known | None = None):
        self.given = windows
        self.windows = windows  # with less trust in outliers, once they were followed
        self.vehicle = vehicle
        self.settings = settings
        self.known = known
        self.layout = Layout.of(windows, vehicle, settings.bin_s)
        self.floor = (np.array(settings.floor_force) if known is None else known.floor)[self.layout.dof]
        self.reach = self._reach()
        self.wide = self.reach[self.layout.dof]
        self.atoms = make_atoms(vehicle, settings)
        self.slack = slack_parameters(vehicle, settings)
        if known is None:
            self.slack_covariance = np.diag(np.array([deviation for *_, deviation in self.slack]) ** 2)
        else:
            self.slack_covariance = known.slack_covariance
            widths = np.sqrt(np.diag(known.slack_covariance))
            self.slack = [(*slack[:3], float(width)) for slack, width in zip(self.slack, widths, strict=True)]
        self.slack_precision = np.linalg.inv(self.slack_covariance)
        self.prior = Prior(vehicle, len({atom.effect for atom in self.atoms}), settings.prior_none)
        self.rough_noise = first_noise(windows)
        self.noisier = {} if known is None else _noisier(self.rough_noise, known.rough_noise)
        # frozen: noise that is fitted on a log hides what its simulator misses; but sensors may have become worse
        self.frozen = {} if known is None else {n: size for n, size in known.noise.items() if n not in self.noisier}
        self.sigma = self._noise(self.rough_noise)
        self.slack_size = 0.0
        self.slack_suffices = True  # to explain the log; where it does not, a small effect is a finding
        self._freedoms: list[tuple[Floats, dict[str, float], Floats, Freedom]] = []  # latest, with what they are for
        self.followed = np.ones(len(windows), bool)  # windows in which the motion is known
        self.outlying: dict[str, int] = {}  # samples by channel that no force could have reached
        self.seen_start = windows.guess  # (W, 12) where they begin, whatever the vehicle

    def _noise(self, measured: dict[str, float]) -> dict[str, float]:
        return {name: self.frozen.get(name, size) for name, size in measured.items()}

    def _reach(self) -> Floats:
        """Force (6,) that the thrusters can make in each degree of freedom, N and N m, or most of it."""
        push = np.abs(_allocation(batch(self.vehicle, [{}]))).sum(-1)
        return np.maximum(WIDE_SHARE * push, 0.1)

    def freedom(self, slope: Floats, prior: Floats | None = None) -> Freedom:
        """What the free numbers of windows with these slopes absorb; kept, because many explanations share slopes."""
        prior = self.floor if prior is None else prior
        for known, with_noise, with_prior, freedom in self._freedoms:
            if known is slope and with_noise is self.sigma and with_prior is prior:
                return freedom
        freedom = Freedom.of(self.windows, self.layout, slope, self.sigma, prior)
        self._freedoms = [*self._freedoms[-3:], (slope, self.sigma, prior, freedom)]
        return freedom

    def forget(self) -> None:
        """Give back the memory of what was kept for speed alone."""
        self._freedoms = []

    def slack_now(self, explanation: Explanation) -> Floats:
        """Slack deviations of an explanation, in the order of the slack parameters."""
        return np.array([explanation.slack.get((effect, member), 0.0) for effect, member, _, _ in self.slack])

    def leaves_much(self, judged: Judged) -> bool:
        """Whether an explanation leaves more than the physics may be wrong by."""
        return judged.chi2 > self.settings.excess * judged.quadratic.numbers

    def is_strained(self, judged: Judged) -> bool:
        """Whether an explanation stretches its slack further than calibration is likely to be off."""
        widths = np.array([width for *_, width in self.slack])
        return bool((np.abs(self.slack_now(judged.explanation)) > STRAINED * widths).any())

    @property
    def even(self) -> np.ndarray:
        """Slack parameters in which chi-square is smooth: moving a threshold flips single samples."""
        return np.array([effect not in self.settings.thresholds for effect, *_ in self.slack])

    def measure_slack(self, base: Base) -> None:
        """Size of the force that slack alone makes on this log."""
        size, direction = np.linalg.eigh(self.slack_covariance)
        keys = [(effect, member) for effect, member, _, _ in self.slack]
        each = [
            Explanation(slack=dict(zip(keys, (np.sqrt(max(s, 0.0)) * d).tolist(), strict=True)))
            for s, d in zip(size, direction.T, strict=True)
        ]
        self.slack_size = float(np.sqrt((self._sizes(each, base) ** 2).sum()))

    @DIVERGING
    def _sizes(self, explanations: list[Explanation], base: Base) -> Floats:
        """Root mean square force of explanations beyond the nominal vehicle, in units of the thrusters' reach."""
        if not self.followed.any():
            return np.zeros(len(explanations))
        rows = batch(self.vehicle, [explanation.values(self.vehicle) for explanation in explanations])
        moves = self.layout.start[: len(self.layout.start) // 2]  # unseen ones too: some effects act through a tilt
        forces = force_changes(self.windows, batch(self.vehicle, [{}]), rows, base.motion)[..., moves]
        scaled = (forces / self.reach[moves])[self.followed]
        return np.sqrt((scaled**2).mean((0, 2)).sum(-1))

    def minor(self, judged: Judged) -> bool:
        """Whether some effect of an explanation does no more than slack does anyway, and slack explains the log."""
        explanation = judged.explanation
        if not self.slack_suffices or not explanation.effects or not np.isfinite(judged.chi2):
            return False
        alone = [
            Explanation(tuple(knob for knob in explanation.knobs if knob.effect == effect))
            for effect in explanation.effects
        ]
        return bool((self._sizes(alone, judged.base) < MINOR * self.slack_size).any())


def _noisier(now: dict[str, float], then: dict[str, float]) -> dict[str, float]:
    """By channel, how many times noisier a log is, where it is so."""
    ratio = {name: size / then[name] for name, size in now.items() if name in then}
    return {name: times for name, times in ratio.items() if times > NOISIER}


def _allocation(vehicle: Vehicle) -> Floats:
    """Wrench (6, n) of each thruster at full command."""
    c = prepare(vehicle).numpy()
    return (c.allocation * c.full_thrust[..., None, :])[0]
