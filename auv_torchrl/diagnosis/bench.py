"""Everything that judging explanations of one log needs, and the two ways to judge them.

Screening looks along the measured motion, where effects are nearly linear, and judges all of them at once. Polishing
simulates one explanation and fits its values, its slack, the starts and the disturbance until nothing moves.
"""

from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.evidence import Prior, volume
from auv_torchrl.diagnosis.explanation import Explanation
from auv_torchrl.diagnosis.force import force_changes, marks, measured_motion
from auv_torchrl.diagnosis.hypotheses import Settings, Values, batch, make_atoms, slack_parameters
from auv_torchrl.diagnosis.reduce import Freedom, Quadratic, chi_square, reduce, settle
from auv_torchrl.diagnosis.rollout import DIVERGING, actuate, path
from auv_torchrl.diagnosis.rough import rough_force
from auv_torchrl.diagnosis.smooth import (
    Layout,
    Smoothed,
    fields,
    first_noise,
    follow,
    local_slopes,
    misfit,
    sensor_noise,
)
from auv_torchrl.diagnosis.windows import Floats, Windows
from auv_torchrl.effects import EFFECTS
from auv_torchrl.physics import prepare
from auv_torchrl.physics.kinematics import euler_angles
from auv_torchrl.vehicle import Vehicle

WIDE_SHARE = 0.6  # of the full thrust in a degree of freedom: prior of the force while a wrong model follows the log
SLACK_LIMIT = 3.0  # standard deviations: more is no slack but a gap
THRESHOLD_REACH = (0.05, 0.015, 0.004)  # of the plausible range
NOISE_MATTERS = 0.02  # relative
NOISIER = 1.3  # times the noise of the healthy log, from which its noise says nothing about this log
FOLLOWED = 1.15  # misfit of a window that a free force follows
LOST = 1.6  # misfit of one that it does not
MOSTLY_LOST = 0.5  # share of lost windows above which an explanation is simply wrong
STUCK = 1.5  # chi-square per number of a window that has not found its start
HEIRS = 3  # rounds in which starts are handed on from window to window
MINOR = 0.5  # of the force that slack makes: an effect below it is no finding
SATISFIED = 2.0  # standard deviations of chi-square above its mean, below which nothing more is looked for
REPEATS = 3  # of linearising windows again
FAR = 0.3  # of chi-square, that a descent gains where slopes need to be taken again
GAINS = 0.02  # of chi-square, below which doing so is not worth it
SLACK_STEP = 0.05  # relative step of slack derivatives
KNOB_STEP = 0.004  # of the plausible range of a parameter


@dataclass(frozen=True)
class Base:
    """Windows that follow the log under one explanation."""

    explanation: Explanation
    vehicle: Vehicle  # (1,) with the explanation, slack included
    state: Smoothed
    motion: Floats  # (W, S, 13)


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

    @property
    def nothing_left(self) -> bool:
        """Whether nothing is left beyond the noise."""
        numbers = self.quadratic.numbers
        return self.chi2 < numbers * (1 + SATISFIED * np.sqrt(2 / numbers))


class Bench:
    """A log cut into windows, a vehicle and the settings to judge with."""

    def __init__(self, windows: Windows, vehicle: Vehicle, settings: Settings, known: Known | None = None):
        self.windows = windows
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
        self._freedoms: list[
            tuple[Floats, dict[str, float], Floats, Freedom]
        ] = []  # the latest, with what they are for
        self.followed = np.ones(len(windows), bool)  # windows in which the motion is known

    def _noise(self, measured: dict[str, float]) -> dict[str, float]:
        return {name: self.frozen.get(name, size) for name, size in measured.items()}

    def _reach(self) -> Floats:
        """Force (6,) that the thrusters can make in each degree of freedom, N and N m, or most of it."""
        push = np.abs(_allocation(batch(self.vehicle, [{}]))).sum(-1)
        return np.maximum(WIDE_SHARE * push, 0.1)

    def follow(self) -> Base:
        """The windows under the nominal vehicle with a wide force; measures the sensor noise on the way.

        The force changes faster where bins of the usual length cannot follow, as under a limit cycle.
        """
        vehicle = batch(self.vehicle, [{}])
        state = self._follow(self.windows, vehicle, self.wide)
        while np.median(misfit(self.windows, state.residual, self.sigma)) > FOLLOWED and self.layout.steps_per_bin > 2:
            self.layout = Layout.of(self.windows, self.vehicle, 0.5 * self.layout.steps_per_bin * self.windows.dt)
            state = self._follow(self.windows, vehicle, self.wide)
        self.followed = misfit(self.windows, state.residual, self.sigma) < LOST
        measured = sensor_noise(self.windows, state, self.sigma, self.wide)
        self.sigma = self._noise({name: min(measured[name], self.sigma[name]) for name in measured})
        base = Base(Explanation(), vehicle, state, measured_motion(self.windows, vehicle, self.layout, state))
        self.measure_slack(base)
        return base

    def _follow(self, windows: Windows, vehicle: Vehicle, prior: Floats) -> Smoothed:
        begin = rough_force(windows, vehicle, self.layout)
        return follow(windows, vehicle, self.layout, self.sigma, prior, begin)

    def rebase(self, explanation: Explanation, start: Base) -> Base:
        """The windows under another explanation, from what is left of the force when the explanation is taken out."""
        vehicle = batch(self.vehicle, [explanation.values(self.vehicle)])
        explained = force_changes(self.windows, start.vehicle, vehicle, start.motion)[:, 0, :, self.layout.dof]
        edges = np.arange(0, self.windows.steps, self.layout.steps_per_bin)
        counts = np.diff(np.append(edges, self.windows.steps))
        explained = np.moveaxis(explained, 0, -1)  # an index array behind a slice puts its axis first
        bins = start.state.bins - np.add.reduceat(explained, edges, axis=1) / counts[:, None]
        state = local_slopes(self.windows, vehicle, self.layout, start.state.start, bins)
        base = self._settled(explanation, vehicle, state)
        lost = misfit(self.windows, base.state.residual, self.sigma) > LOST
        if lost.any() and lost.mean() < MOSTLY_LOST:  # the start was no good; it may be under the right vehicle
            fresh = self._follow(self.windows.subset(lost), vehicle, self.floor)
            merged = [np.copy(field) for field in fields(base.state)]
            for old, new in zip(merged, fields(fresh), strict=True):
                old[lost] = new
            base = self._settled(explanation, vehicle, Smoothed(*merged))
        return self._handed_on(base)

    def _handed_on(self, base: Base) -> Base:
        """Windows that got stuck begin anew where the window before them, which did not, ends under this vehicle."""
        windows, layout = self.windows, self.layout
        follows = (windows.episode[:, None] == windows.episode) & (
            windows.start[:, None] == windows.start + windows.steps
        )
        before = np.where(follows.any(1), follows.argmax(1), -1)
        numbers = windows.present.sum(1) * len(windows.channels)
        for _ in range(HEIRS):
            state = base.state
            parts = chi_square(windows, layout, self.freedom(state.slope), *_one_row(state))[:, 0]
            stuck = ~(parts < STUCK * numbers)
            heirs = np.flatnonzero(stuck & (before >= 0) & ~stuck[before])
            if not len(heirs) or stuck.mean() > MOSTLY_LOST:
                break
            ends = self._ends(base)[before[heirs]]
            some = windows.subset(heirs)
            fresh = local_slopes(some, base.vehicle, layout, ends, np.zeros_like(state.bins[heirs]))
            freedom = Freedom.of(some, layout, fresh.slope, self.sigma, self.floor)
            start, bins, residual = settle(some, base.vehicle, layout, freedom, *_one_row(fresh)[:2])
            better = chi_square(some, layout, freedom, start, bins, residual)[:, 0] < parts[heirs]
            if not better.any():
                break
            fresh = replace(fresh, start=start[:, 0], bins=bins[:, 0], residual=residual[:, 0])
            merged = [np.copy(field) for field in fields(state)]
            for old, new in zip(merged, fields(fresh), strict=True):
                old[heirs[better]] = new[better]
            base = self._settled(base.explanation, base.vehicle, Smoothed(*merged))
        return base

    def _ends(self, base: Base) -> Floats:
        """States (W, 12) in which the windows end, as the start of what follows them."""
        windows, everything = self.windows, slice(0, len(self.windows))
        force = self.layout.force(base.state.bins[:, None], windows.steps)
        actuation = actuate(windows, base.vehicle)
        end = path(windows, everything, actuation, base.state.start[:, None], force, windows.steps, 1)[:, 0, -1]
        angles = np.stack(euler_angles(end[:, 3:7]), axis=-1)
        angles[:, 2] += float(base.vehicle.heading_bias.reshape(-1)[0])  # a start has the measured yaw
        return np.concatenate([end[:, :3], angles, end[:, 7:]], axis=1)

    def nudge(self, explanation: Explanation, start: Base) -> Base:
        """The windows under an explanation that differs a little from that of ``start``."""
        vehicle = batch(self.vehicle, [explanation.values(self.vehicle)])
        return self._settled(explanation, vehicle, start.state)

    def nudged_chi2(self, explanations: list[Explanation], start: Base) -> Floats:
        """Chi-square (R,), slack paid for, of explanations that differ a little from that of ``start``, all at once."""
        vehicles = batch(self.vehicle, [explanation.values(self.vehicle) for explanation in explanations])
        freedom = self.freedom(start.state.slope)
        starts = np.repeat(start.state.start[:, None], len(explanations), axis=1)
        bins = np.repeat(start.state.bins[:, None], len(explanations), axis=1)
        settled = settle(self.windows, vehicles, self.layout, freedom, starts, bins)
        slack = np.stack([self.slack_now(explanation) for explanation in explanations])
        chi2 = chi_square(self.windows, self.layout, freedom, *settled).sum(0)
        return chi2 + ((slack @ self.slack_precision) * slack).sum(-1)

    def freedom(self, slope: Floats, prior: Floats | None = None) -> Freedom:
        """What the free numbers of windows with these slopes absorb; kept, because many explanations share slopes."""
        prior = self.floor if prior is None else prior
        for known, with_noise, with_prior, freedom in self._freedoms:
            if known is slope and with_noise is self.sigma and with_prior is prior:
                return freedom
        freedom = Freedom.of(self.windows, self.layout, slope, self.sigma, prior)
        self._freedoms = [*self._freedoms[-3:], (slope, self.sigma, prior, freedom)]
        return freedom

    def _settled(self, explanation: Explanation, vehicle: Vehicle, state: Smoothed) -> Base:
        settled = self._settle(vehicle, state, self.freedom(state.slope))
        return Base(explanation, vehicle, settled, measured_motion(self.windows, vehicle, self.layout, settled))

    def _settle(self, vehicle: Vehicle, state: Smoothed, freedom: Freedom) -> Smoothed:
        fresh = settle(self.windows, vehicle, self.layout, freedom, state.start[:, None], state.bins[:, None])
        start, bins, residual = (field[:, 0] for field in fresh)
        return replace(state, start=start, bins=bins, residual=residual)

    def quadratic(self, base: Base, changes: list[Explanation]) -> Quadratic:
        """Chi-square of slack deviations (first) and of amounts of ``changes`` (each at 1 is that explanation)."""
        rows: list[Values] = []
        steps = np.ones(len(self.slack) + len(changes))
        for column, (effect, member, nominal, _) in enumerate(self.slack):
            key = effect, member
            steps[column] = SLACK_STEP * abs(nominal)
            slack = {**base.explanation.slack, key: base.explanation.slack.get(key, 0.0) + steps[column]}
            rows.append(replace(base.explanation, slack=slack).values(self.vehicle))
        rows += [change.values(self.vehicle) for change in changes]
        forces = force_changes(self.windows, base.vehicle, batch(self.vehicle, rows), base.motion)
        columns = marks(self.windows, base.vehicle, self.layout, base.state, forces) / steps
        return reduce(self.windows, self.layout, self.freedom(base.state.slope), base.state, columns)

    def without_slack(self, q: Quadratic, explanation: Explanation) -> tuple[float, Floats, Floats, Floats, Floats]:
        """Fit the slack: constant, b and A of the other columns, and slack = offset - response @ amounts."""
        k = len(self.slack)
        at, precision = self.slack_now(explanation), self.slack_precision
        inside = q.A[:k, :k] + precision
        right = np.concatenate([(q.b[:k] - precision @ at)[:, None], q.A[:k, k:]], axis=1)
        solved = np.linalg.solve(inside, right)
        offset, response = solved[:, 0], solved[:, 1:]
        constant = q.constant + float(at @ precision @ at) - float(right[:, 0] @ offset)
        b = q.b[k:] - q.A[k:, :k] @ offset
        A = q.A[k:, k:] - q.A[k:, :k] @ response
        return constant, b, 0.5 * (A + A.T), at + offset, response

    def knob_changes(self, explanation: Explanation) -> tuple[list[Explanation], Floats]:
        """The explanation with each fitted knob moved a little, and by how much."""
        moved, steps = [], []
        at_slack = {(effect, member): SLACK_STEP * abs(nominal) for effect, member, nominal, _ in self.slack}
        for place, knob in enumerate(explanation.knobs):
            if knob.discrete:
                continue
            p = EFFECTS[knob.effect].member_parameters(self.vehicle)[knob.members[0]]
            step = KNOB_STEP * self.prior.width(knob.effect, knob.members[0])
            if (knob.effect, knob.members[0]) in at_slack:  # the same step, so that the two are the same direction
                step = at_slack[knob.effect, knob.members[0]]
            if knob.value + step > p.high:
                step = -step
            moved.append(explanation.moved({place: knob.value + step}))
            steps.append(step)
        return moved, np.array(steps)

    def weigh(self, chi2: float, explanation: Explanation) -> float:
        """Log evidence less the volume of the fitted values."""
        return -0.5 * chi2 + self.prior.structure(explanation)

    def polish(self, explanation: Explanation, start: Base, rounds: int = 4) -> Judged:
        """Fit all values of an explanation by simulating it, and weigh it."""
        best, moving = self._descend(self.rebase(explanation, start), rounds)
        if not rounds:
            return best
        searched = self._search_thresholds(best)
        if searched is not best:
            best, moving = self._descend(searched.base, rounds)
        moving |= self.layout.moves_unseen  # a tilt that nobody measured bends the windows
        for _ in range(REPEATS):  # slopes are out of date where the fit went far
            if not moving or best.nothing_left or not np.isfinite(best.chi2):
                break
            again, _ = self._descend(self.rebase(best.explanation, best.base), rounds)
            if not again.chi2 < best.chi2:
                break
            moving = best.chi2 - again.chi2 > GAINS * again.chi2
            best = again
        return best

    def _descend(self, base: Base, rounds: int) -> tuple[Judged, bool]:
        """Gauss-Newton with a shrinking stride; tells whether it went far."""
        best, step, slack_step = self._judge(base)
        began = best.chi2
        stride, even = 1.0, np.ones(len(self.slack), bool)
        for _ in range(rounds):
            moved = self._move(best.explanation, stride * step, stride * slack_step * even)
            trial, trial_step, trial_slack_step = self._judge(self.nudge(moved, best.base))
            if not trial.chi2 <= best.chi2 + 0.1:  # NaN where it diverges
                stride, even = (stride, self.even) if even.all() else (0.3 * stride, even)
                continue
            settled = best.chi2 - trial.chi2 < 0.5
            best, step, slack_step = trial, trial_step, trial_slack_step
            if settled:
                break
        return best, not began < (1 + FAR) * best.chi2

    def _search_thresholds(self, best: Judged) -> Judged:
        """Try values near by for effects that switch single samples: there chi-square is rough."""
        for place, knob in enumerate(best.explanation.knobs):
            if knob.effect not in self.settings.thresholds or not np.isfinite(best.chi2):
                continue
            p = EFFECTS[knob.effect].member_parameters(self.vehicle)[knob.members[0]]
            for reach in THRESHOLD_REACH:
                width = reach * self.prior.width(knob.effect, knob.members[0])
                values = np.clip(best.explanation.knobs[place].value + width * np.linspace(-1, 1, 9), p.low, p.high)
                trials = [best.explanation.moved({place: float(value)}) for value in values]
                chi2 = self.nudged_chi2(trials, best.base)
                if chi2.min() < best.chi2 - 0.1:
                    best = self._judge(self.nudge(trials[int(chi2.argmin())], best.base))[0]
        return best

    def measure_noise(self, judged: Judged) -> bool:
        """Measure the sensor noise again under a better vehicle; tells whether it is another."""
        state = judged.base.state
        free = self._settle(judged.base.vehicle, state, self.freedom(state.slope, self.wide))
        measured = sensor_noise(self.windows, free, self.sigma, self.wide)
        sigma = self._noise({name: min(measured[name], self.rough_noise[name]) for name in measured})
        changed = any(abs(sigma[name] / self.sigma[name] - 1) > NOISE_MATTERS for name in sigma)
        if changed:
            self.sigma = sigma
        return changed

    def again(self, judged: Judged) -> Judged:
        """Weigh an explanation again, after the noise was measured anew."""
        return self._judge(self.nudge(judged.explanation, judged.base))[0]

    def _judge(self, base: Base) -> tuple[Judged, Floats, Floats]:
        """Weigh an explanation as it is, with the Gauss-Newton step of its knobs and of its slack."""
        explanation = base.explanation
        changes, steps = self.knob_changes(explanation)
        q = self.quadratic(base, changes)
        at = self.slack_now(explanation)
        chi2 = q.constant + float(at @ self.slack_precision @ at)
        if not np.isfinite(chi2):  # the windows diverge under this vehicle
            nothing = np.zeros(len(explanation.fitted))
            return Judged(explanation, np.inf, -np.inf, np.diag(nothing), base, q), nothing, np.zeros(len(self.slack))
        _, b, A, slack, response = self.without_slack(q, explanation)
        widths = np.array([self.prior.width(knob.effect, knob.members[0]) for knob in explanation.fitted])
        curvature = A / np.outer(steps, steps)
        covariance = np.linalg.inv(curvature + np.diag(widths**-2.0))
        amounts = covariance @ (b / steps)
        evidence = self.weigh(chi2, explanation) + volume(curvature, widths)
        judged = Judged(explanation, chi2, evidence, covariance, base, q)
        return judged, amounts, slack - response @ (amounts / steps) - at

    def slack_now(self, explanation: Explanation) -> Floats:
        """Slack deviations of an explanation, in the order of the slack parameters."""
        return np.array([explanation.slack.get((effect, member), 0.0) for effect, member, _, _ in self.slack])

    @property
    def even(self) -> np.ndarray:
        """Slack parameters in which chi-square is smooth: moving a threshold flips single samples."""
        return np.array([effect not in self.settings.thresholds for effect, *_ in self.slack])

    def measure_slack(self, base: Base) -> None:
        """Size of the force that slack alone makes on this log."""
        size, direction = np.linalg.eigh(self.slack_covariance)
        keys = [(effect, member) for effect, member, _, _ in self.slack]
        each = [
            replace(base.explanation, slack=dict(zip(keys, (np.sqrt(max(s, 0.0)) * d).tolist(), strict=True)))
            for s, d in zip(size, direction.T, strict=True)
        ]
        self.slack_size = float(np.sqrt((self._sizes(each, base) ** 2).sum()))

    @DIVERGING
    def _sizes(self, explanations: list[Explanation], base: Base) -> Floats:
        """Root mean square force of explanations beyond the nominal vehicle, in units of the thrusters' reach."""
        rows = batch(self.vehicle, [explanation.values(self.vehicle) for explanation in explanations])
        moves = self.layout.start[: len(self.layout.start) // 2]  # unseen ones too: some effects act through a tilt
        forces = force_changes(self.windows, batch(self.vehicle, [{}]), rows, base.motion)[..., moves]
        scaled = (forces / self.reach[moves])[self.followed]
        return np.sqrt((scaled**2).mean((0, 2)).sum(-1))

    def minor(self, judged: Judged) -> bool:
        """Whether some effect of an explanation does no more than slack does anyway."""
        explanation = judged.explanation
        if not explanation.effects or not np.isfinite(judged.chi2):
            return False
        alone = [
            Explanation(tuple(knob for knob in explanation.knobs if knob.effect == effect))
            for effect in explanation.effects
        ]
        return bool((self._sizes(alone, judged.base) < MINOR * self.slack_size).any())

    def _move(self, explanation: Explanation, step: Floats, slack_step: Floats) -> Explanation:
        amounts, order = {}, 0
        for place, knob in enumerate(explanation.knobs):
            if knob.discrete:
                continue
            p = EFFECTS[knob.effect].member_parameters(self.vehicle)[knob.members[0]]
            amounts[place] = float(np.clip(knob.value + step[order], p.low, p.high))
            order += 1
        slack = {
            (e, m): float(np.clip(explanation.slack.get((e, m), 0.0) + move, -SLACK_LIMIT * width, SLACK_LIMIT * width))
            for (e, m, _, width), move in zip(self.slack, slack_step, strict=True)
        }
        return replace(explanation.moved(amounts), slack=slack)


def _one_row(state: Smoothed) -> tuple[Floats, Floats, Floats]:
    return state.start[:, None], state.bins[:, None], state.residual[:, None]


def _noisier(now: dict[str, float], then: dict[str, float]) -> dict[str, float]:
    """By channel, how many times noisier a log is, where it is so."""
    ratio = {name: size / then[name] for name, size in now.items() if name in then}
    return {name: times for name, times in ratio.items() if times > NOISIER}


def _allocation(vehicle: Vehicle) -> Floats:
    """Wrench (6, n) of each thruster at full command."""
    c = prepare(vehicle).numpy()
    return (c.allocation * c.full_thrust[..., None, :])[0]
