"""The two ways to judge explanations of one log.

Sketching looks along the measured motion, where effects are nearly linear, and takes no simulation. Polishing simulates
one explanation and fits its values, its slack, the starts and the disturbance until nothing moves.
"""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.motion.smooth import sensor_noise
from auv_torchrl.diagnosis.which.explanation import Explanation
from auv_torchrl.diagnosis.which.ground import Base, Judged
from auv_torchrl.diagnosis.which.weighing import Weighing
from auv_torchrl.effects.effect import mean
from auv_torchrl.physics import prepare

THRESHOLD_REACH = (0.05, 0.015, 0.004)  # of the plausible range
TRIED = np.linspace(-1.0, 1.0, 9)  # of each reach
WALKS = 3  # at most, over exponents of the thrust curve
EXPONENT, ASYMMETRY = ("thrust_curve", ("exponent",)), ("thrust_curve", ("asymmetry",))
DEAD_BAND = ("dead_band", ("width",))
SLACK_REACH = 2.0  # standard deviations, within which thresholds are tried, ...
SLACK_MOVED = 0.2  # ... where they moved by this much; "no gap" also within ...
SLACK_NEAR = 0.4  # ... of the best of them
NOISE_MATTERS = 0.02  # relative
REPEATS = 3  # of linearising windows again
FAR = 0.3  # of chi-square, that a descent gains where slopes need to be taken again
GAINS = 0.02  # of chi-square, below which doing so is not worth it
SKETCHED = 0.02  # of chi-square: a sketch that gains less is done


class Bench(Weighing):
    """A log, a vehicle and settings, with all that is needed to fit and weigh explanations."""

    def polish(self, explanation: Explanation, start: Base, rounds: int = 4, enough: float = np.inf) -> Judged:
        """Fit all values of an explanation by simulating it, and weigh it.

        One that is still beyond a chi-square of ``enough`` when it was fitted once is left at that.
        """
        best, moving = self._descend(self.rebase(explanation, start), rounds)
        if not rounds:
            return best
        searched = self._search_thresholds(best)
        if searched is not best:
            best, moving = self._descend(searched.base, rounds)
        moving |= self.layout.moves_unseen  # a tilt that nobody measured bends the windows
        for _ in range(REPEATS):  # slopes are out of date where the fit went far
            if not moving or best.nothing_left or not np.isfinite(best.chi2) or best.chi2 > enough:
                break
            again, _ = self._descend(self.rebase(best.explanation, best.base), rounds)
            if not again.chi2 < best.chi2:
                break
            moving = best.chi2 - again.chi2 > GAINS * again.chi2
            best = again
        return replace(best, slack_marks=None)

    def sketch(self, explanation: Explanation, follow: Base, rounds: int = 6) -> Judged:
        """Fit all values of an explanation along the measured motion, and weigh it: a quick look before polishing.

        Its forces are exact there, however wrong a simulation that lacks some other effect would go.
        """
        best, step, slack_step = self.judge(follow, explanation)
        stride = 1.0
        for _ in range(rounds):
            moved = self.move(best.explanation, stride * step, stride * slack_step)
            trial, trial_step, trial_slack_step = self.judge(follow, moved, best)
            if not trial.chi2 < best.chi2:
                stride *= 0.3
                continue
            settled = best.chi2 - trial.chi2 < SKETCHED * trial.chi2
            best, step, slack_step = trial, trial_step, trial_slack_step
            if settled:
                break
        return replace(best, slack_marks=None)

    def _descend(self, base: Base, rounds: int) -> tuple[Judged, bool]:
        """Gauss-Newton with a shrinking stride; tells whether it went far.

        Where a step fails, the slack of thresholds stays from there on. Where it does because single windows diverge,
        they begin anew behind it.
        """
        best, *step = self.judge(base)
        began = best.chi2
        stride, even = 1.0, bool(self.even.all())
        for turn in range(rounds):
            if not np.isfinite(best.chi2):
                break
            knobs, slack = self.even_step(best) if even else step
            moved = self.move(best.explanation, stride * knobs, stride * slack)
            trial, *trial_step = self.judge(self.nudge(moved, best.base), before=best)
            if turn == 0 and not trial.chi2 <= best.chi2 and self.some_diverged(best.base, trial.base):
                trial, *trial_step = self.judge(self.rebase(moved, best.base))
            if not trial.chi2 <= best.chi2 + 0.1:  # NaN where it diverges
                stride, even = (0.3 * stride if even else stride), True
                continue
            settled = best.chi2 - trial.chi2 < 0.5
            best, step = trial, trial_step
            if settled:
                break
        return best, not began < (1 + FAR) * best.chi2

    def _search_thresholds(self, best: Judged) -> Judged:
        """Try values near by for effects that switch single samples, because there chi-square is rough.

        The smooth numbers go along with each.
        """
        for order, knob in enumerate(best.explanation.fitted):
            if knob.effect in self.settings.thresholds:
                for reach in THRESHOLD_REACH:
                    width = reach * self.prior.width(knob.effect, knob.members[0])
                    best = self._best_along(best, [{len(self.slack) + order: width * u} for u in TRIED])
        for column, (effect, _, _, width) in enumerate(self.slack):
            now = self.slack_now(best.explanation)[column]
            alone = not best.explanation.effects  # "no gap" has no knob by which a threshold would be tried
            moved = abs(now) > SLACK_MOVED * width or not best.nothing_left
            if effect in self.settings.thresholds and (moved or alone):
                best = self._best_along(best, [{column: SLACK_REACH * width * u - now} for u in TRIED])
                if alone:
                    best = self._best_along(best, [{column: SLACK_NEAR * width * u} for u in TRIED])
        return best if self.leaves_much(best) else self._search_curve(best)

    def _search_curve(self, best: Judged) -> Judged:
        """Try exponents of the thrust curve near by, with a dead band that lets the same commands through.

        Either alone lets others through, so that chi-square is a narrow valley along the two, which slopes do not show.
        """
        column = {(effect, (member,)): order for order, (effect, member, _, _) in enumerate(self.slack)}
        column |= {knob.key: len(self.slack) + order for order, knob in enumerate(best.explanation.fitted)}
        exponent, band, asymmetry = (column.get(key) for key in (EXPONENT, DEAD_BAND, ASYMMETRY))
        if exponent is None or band is None:
            return best
        for _ in range(WALKS):
            before = best
            for reach in THRESHOLD_REACH[1:]:
                best = self._best_along(best, self._same_commands(best, reach, exponent, band, asymmetry))
            if best is before:
                break
        return best

    def _same_commands(
        self, best: Judged, reach: float, exponent: int, band: int, asymmetry: int | None
    ) -> list[dict[int, float]]:
        """Moves of the columns of an exponent, a dead band and an asymmetry that keep the commands that get through."""
        c = prepare(best.base.vehicle)  # both effects move the means, and thrusters that differ in proportion
        now, width, full, weaker = (float(mean(x[0])) for x in (c.exponent, c.dead_band, c.full_thrust, c.asymmetry))
        moves = []
        for step in reach * self.prior.width("thrust_curve", "exponent") * TRIED:
            power = (now + step) / now  # the same commands have their thrust, over the full one, to this power
            move = {exponent: step, band: full * (width / full) ** power - width}
            if asymmetry is not None:
                move[asymmetry] = (1 - weaker) - (1 - weaker) ** power
            moves.append(move)
        return moves

    def _best_along(self, best: Judged, amounts: list[dict[int, float]]) -> Judged:
        """The best of an explanation and of those with some numbers moved by amounts, alone or the others along."""
        if not np.isfinite(best.chi2):
            return best
        trials = [self.moved_along(best, some, along) for along in (True, False) for some in amounts]
        chi2 = self.nudged_chi2(trials, best.base)
        return (
            self.judge(self.nudge(trials[int(chi2.argmin())], best.base), before=best)[0]
            if chi2.min() < best.chi2 - 0.1
            else best
        )

    def measure_noise(self, judged: Judged) -> bool:
        """Measure the sensor noise again under a better vehicle; tells whether it is another."""
        state = judged.base.state
        free, _ = self._settle(judged.base.vehicle, state, self.freedom(state.slope, self.wide))
        measured = sensor_noise(self.windows, free, self.sigma, self.wide)
        if len(measured) < len(self.sigma):  # too few samples for a free force: the disturbance leaves more of them
            measured = sensor_noise(self.windows, state, self.sigma, self.floor) | measured
        sigma = self._noise({n: min(measured.get(n, size), self.rough_noise[n]) for n, size in self.sigma.items()})
        changed = any(abs(sigma[name] / self.sigma[name] - 1) > NOISE_MATTERS for name in sigma)
        if changed:
            self.sigma = sigma
        return changed

    def again(self, judged: Judged) -> Judged:
        """Weigh an explanation again, after the noise was measured anew."""
        return self.judge(self.nudge(judged.explanation, judged.base))[0]
