"""Windows that follow the log under an explanation, each from a start and with a disturbance of its own."""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.motion.force import force_changes
from auv_torchrl.diagnosis.motion.reduce import DIVERGED, Freedom, chi_square, settle
from auv_torchrl.diagnosis.motion.rollout import actuate
from auv_torchrl.diagnosis.motion.rough import rough_force
from auv_torchrl.diagnosis.motion.smooth import (
    Layout,
    Smoothed,
    fields,
    flown,
    follow,
    local_slopes,
    misfit,
    noise_per_sample,
    sensor_noise,
)
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.which.explanation import Explanation
from auv_torchrl.diagnosis.which.ground import Base, Ground
from auv_torchrl.diagnosis.which.hypotheses import batch
from auv_torchrl.physics import prepare
from auv_torchrl.sensors import Inverse
from auv_torchrl.vehicle import Vehicle

FOLLOWED = 1.15  # misfit of a window that a free force follows
LOST = 1.6  # misfit of one that it does not
MOSTLY_LOST = 0.5  # share of lost windows above which an explanation is simply wrong
FEW_LOST = 0.1  # share of diverged windows below which each is an accident
OUTLIER = 5.0  # standard deviations from which a sample counts less: of noise alone, one in a million does,
MANY_OUTLIERS = 0.2  # if less than this share of a window is so: else it is the window that was not followed
STUCK = 1.5  # chi-square per number of a window that has not found its start
ASTRAY = 4.0  # times the median chi-square of a window: it has lost its start, whatever the vehicle
SETTLING = 2  # steps of the free numbers where windows begin; a small change of the vehicle needs one
NOTHING = Explanation()
HEIRS = 3  # rounds in which starts are handed on from window to window


class Following(Ground):
    """Settle windows under the nominal vehicle and under explanations."""

    def follow(self, explanation: Explanation = NOTHING) -> Base:
        """The windows under an explanation, by default none, with a wide force; measures the noise on the way.

        The force changes faster where bins of the usual length cannot follow, as under a limit cycle.
        """
        self.windows = self.given
        self.layout = Layout.of(self.windows, self.vehicle, self.settings.bin_s)
        self.sigma = self._noise(self.rough_noise)
        vehicle = batch(self.vehicle, [explanation.values(self.vehicle)])
        state = self._weigh_outliers(vehicle, self._follow(self.windows, vehicle, self.wide))
        while np.median(misfit(self.windows, state.residual, self.sigma)) > FOLLOWED and self.layout.steps_per_bin > 2:
            steps = self.layout.steps_per_bin  # windows are whole numbers of bins: half as long, or the next divisor
            finer = max(k for k in range(1, steps // 2 + 1) if steps % k == 0)
            self.layout = Layout.of(self.windows, self.vehicle, finer * self.windows.dt)
            state = self._follow(self.windows, vehicle, self.wide)
        self.followed = misfit(self.windows, state.residual, self.sigma) < LOST
        self.seen_start = state.start
        measured = sensor_noise(self.windows, state, self.sigma, self.wide)
        self.sigma = self._noise({n: min(measured.get(n, size), size) for n, size in self.sigma.items()})
        states = flown(actuate(self.windows, vehicle), self.layout, *_one_row(state)[:2])[1]
        base = Base(explanation, vehicle, state, states[:, 0])
        self.measure_slack(base)
        return base

    def _weigh_outliers(self, vehicle: Vehicle, state: Smoothed) -> Smoothed:
        """Take weight from samples that no force could have reached, and follow their windows again.

        The loss is redescending: beyond the threshold a sample counts the less the farther it is off, so that what is
        left of chi-square is about the rest. Samples are judged where the simulator's error plays no part; later, a
        large residual may be the simulator's.
        """
        windows = self.windows
        far = np.abs(state.residual) / noise_per_sample(windows, self.sigma)
        far = np.where(np.isfinite(far), far, 0.0)
        some = (far > OUTLIER).any(1) & ((far > OUTLIER).mean(1) < MANY_OUTLIERS)
        if not some.any():
            return state
        factor = (OUTLIER / np.maximum(far, OUTLIER)) ** 2
        factor = np.where(some[:, None], factor, 1.0).reshape(windows.trust.shape)
        self.windows = replace(windows, trust=windows.trust * factor)
        counts = (factor < 1).sum((0, 1))
        self.outlying = {name: int(count) for name, count in zip(windows.channels, counts, strict=True) if count}
        return _replaced(state, some, self._follow(self.windows.subset(some), vehicle, self.wide))

    def followed_freely(self, windows: Windows, vehicle: Vehicle) -> Smoothed:
        """Some windows under a vehicle (1,), with a wide force."""
        return self._follow(windows, vehicle, self.wide)

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
        base = self.settled(explanation, vehicle, state)
        lost = misfit(self.windows, base.state.residual, self.sigma) > LOST
        if lost.any() and lost.mean() < MOSTLY_LOST:  # the start was no good; it may be under the right vehicle
            fresh = self._follow(self.windows.subset(lost), vehicle, self.floor)
            base = self.settled(explanation, vehicle, _replaced(base.state, lost, fresh))
        return self.handed_on(base)

    def handed_on(self, base: Base) -> Base:
        """Windows that got stuck begin anew: where a free force had them begin, or where the one before them ends."""
        windows = self.windows
        follows = (windows.episode[:, None] == windows.episode) & (
            windows.start[:, None] == windows.start + windows.steps
        )
        before = np.where(follows.any(1), follows.argmax(1), -1)
        chi2 = self._chi2_by_window(base.state)
        astray = np.flatnonzero(~(chi2 < ASTRAY * np.median(chi2)))
        if len(astray) and self._stuck(base).mean() <= MOSTLY_LOST:
            base = self._begun_anew(base, astray, self.seen_start[astray])
        for _ in range(HEIRS):
            stuck = self._stuck(base)
            heirs = np.flatnonzero(stuck & (before >= 0) & ~stuck[before])
            if not len(heirs) or stuck.mean() > MOSTLY_LOST:
                break
            fresh = self._begun_anew(base, heirs, self._ends(base)[before[heirs]])
            if fresh is base:
                break
            base = fresh
        return base

    def _stuck(self, base: Base) -> np.ndarray:
        """(W,) windows that leave more than an explanation that is about right would."""
        numbers = (self.windows.trust**2).sum((1, 2))
        return ~(self._chi2_by_window(base.state) < STUCK * numbers)

    def some_diverged(self, *bases: Base) -> bool:
        """Whether some windows, but few, diverge in one of these."""
        astray = [self._chi2_by_window(base.state) >= DIVERGED for base in bases]
        return any(lost.any() for lost in astray) and all(lost.mean() < FEW_LOST for lost in astray)

    def _chi2_by_window(self, state: Smoothed) -> Floats:
        return chi_square(self.windows, self.layout, self.freedom(state.slope), *_one_row(state))[:, 0]

    def _begun_anew(self, base: Base, rows: np.ndarray, starts: Floats) -> Base:
        """The base with some windows settled from other starts (rows, 12), where that is better."""
        layout, state = self.layout, base.state
        some = self.windows.subset(rows)
        fresh = local_slopes(some, base.vehicle, layout, starts, np.zeros_like(state.bins[rows]))
        freedom = Freedom.of(some, layout, fresh.slope, self.sigma, self.floor)
        start, bins, residual, _ = settle(some, base.vehicle, layout, freedom, *_one_row(fresh), SETTLING)
        chi2 = chi_square(some, layout, freedom, start, bins, residual)[:, 0]
        better = chi2 < self._chi2_by_window(state)[rows]
        if not better.any():
            return base
        fresh = replace(fresh, start=start[:, 0], bins=bins[:, 0], residual=residual[:, 0])
        found = Smoothed(*(field[better] for field in fields(fresh)))
        return self.settled(base.explanation, base.vehicle, _replaced(state, rows[better], found))

    def _ends(self, base: Base) -> Floats:
        """States (W, 12) in which the windows end, as the start of what follows them."""
        sensors = Inverse.of(prepare(base.vehicle).numpy(), self.windows.channels)
        return sensors.reported_start(base.states[:, -1])

    def nudge(self, explanation: Explanation, start: Base) -> Base:
        """The windows under an explanation that differs a little from that of ``start``."""
        vehicle, state = batch(self.vehicle, [explanation.values(self.vehicle)]), start.state
        fresh = settle(self.windows, vehicle, self.layout, self.freedom(state.slope), *_one_row(state)[:2])
        return Base(explanation, vehicle, *_taken_on(state, fresh))

    def nudged_chi2(self, explanations: list[Explanation], start: Base) -> Floats:
        """Chi-square (R,), slack paid for, of explanations that differ a little from that of ``start``, all at once."""
        vehicles = batch(self.vehicle, [explanation.values(self.vehicle) for explanation in explanations])
        freedom = self.freedom(start.state.slope)
        starts = np.repeat(start.state.start[:, None], len(explanations), axis=1)
        bins = np.repeat(start.state.bins[:, None], len(explanations), axis=1)
        *settled, _ = settle(self.windows, vehicles, self.layout, freedom, starts, bins)
        slack = np.stack([self.slack_now(explanation) for explanation in explanations])
        chi2 = chi_square(self.windows, self.layout, freedom, *settled).sum(0)
        return chi2 + ((slack @ self.slack_precision) * slack).sum(-1)

    def settled(self, explanation: Explanation, vehicle: Vehicle, state: Smoothed) -> Base:
        """The windows under an explanation, settled from a state near by whose residual is that of the vehicle."""
        return Base(explanation, vehicle, *self._settle(vehicle, state, self.freedom(state.slope)))

    def _settle(self, vehicle: Vehicle, state: Smoothed, freedom: Freedom) -> tuple[Smoothed, Floats]:
        """The state after steps of its free numbers, and the motion (W, S + 1, 13) that it goes through."""
        return _taken_on(state, settle(self.windows, vehicle, self.layout, freedom, *_one_row(state), SETTLING))


def _taken_on(state: Smoothed, settled: tuple[Floats, ...]) -> tuple[Smoothed, Floats]:
    """The state with what :func:`settle` found for it, and the motion."""
    start, bins, residual, states = (field[:, 0] for field in settled)
    return replace(state, start=start, bins=bins, residual=residual), states


def _replaced(state: Smoothed, rows: np.ndarray, by: Smoothed) -> Smoothed:
    """The state with some of its windows, by mask or number, from another one."""
    merged = [np.copy(field) for field in fields(state)]
    for old, new in zip(merged, fields(by), strict=True):
        old[rows] = new
    return Smoothed(*merged)


def _one_row(state: Smoothed) -> tuple[Floats, Floats, Floats]:
    return state.start[:, None], state.bins[:, None], state.residual[:, None]
