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
from auv_torchrl.effects import EFFECTS

THRESHOLD_REACH = (0.05, 0.015, 0.004)  # of the plausible range
SLACK_REACH = 2.0  # standard deviations, within which thresholds are tried ...
SLACK_MOVED = 0.2  # ... where they moved by this much
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
        return best

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
        return best

    def _descend(self, base: Base, rounds: int) -> tuple[Judged, bool]:
        """Gauss-Newton with a shrinking stride; tells whether it went far."""
        best, step, slack_step = self.judge(base)
        began = best.chi2
        stride, even = 1.0, np.ones(len(self.slack), bool)
        for _ in range(rounds):
            moved = self.move(best.explanation, stride * step, stride * slack_step * even)
            trial, trial_step, trial_slack_step = self.judge(self.nudge(moved, best.base), before=best)
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
            if knob.effect not in self.settings.thresholds:
                continue
            p = EFFECTS[knob.effect].member_parameters(self.vehicle)[knob.members[0]]
            for reach in THRESHOLD_REACH:
                width = reach * self.prior.width(knob.effect, knob.members[0])
                values = np.clip(best.explanation.knobs[place].value + width * np.linspace(-1, 1, 9), p.low, p.high)
                best = self._best_of(best, [best.explanation.moved({place: float(value)}) for value in values])
        for effect, member, _, width in self.slack:
            moved = abs(best.explanation.slack.get((effect, member), 0.0)) > SLACK_MOVED * width
            if effect in self.settings.thresholds and (moved or not best.nothing_left):
                values = SLACK_REACH * width * np.linspace(-1, 1, 9)
                slacks = [{**best.explanation.slack, (effect, member): float(value)} for value in values]
                best = self._best_of(best, [replace(best.explanation, slack=slack) for slack in slacks])
        return best

    def _best_of(self, best: Judged, trials: list[Explanation]) -> Judged:
        """The best of explanations that differ a little."""
        if not np.isfinite(best.chi2):
            return best
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
        sigma = self._noise({name: min(measured[name], self.rough_noise[name]) for name in measured})
        changed = any(abs(sigma[name] / self.sigma[name] - 1) > NOISE_MATTERS for name in sigma)
        if changed:
            self.sigma = sigma
        return changed

    def again(self, judged: Judged) -> Judged:
        """Weigh an explanation again, after the noise was measured anew."""
        return self.judge(self.nudge(judged.explanation, judged.base))[0]
