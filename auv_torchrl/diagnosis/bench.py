"""The two ways to judge explanations of one log.

Screening looks along the measured motion, where effects are nearly linear, and judges all of them at once. Polishing
simulates one explanation and fits its values, its slack, the starts and the disturbance until nothing moves.
"""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.evidence import volume
from auv_torchrl.diagnosis.explanation import Explanation
from auv_torchrl.diagnosis.following import Following
from auv_torchrl.diagnosis.force import force_changes, marks
from auv_torchrl.diagnosis.ground import Base, Judged
from auv_torchrl.diagnosis.hypotheses import Values, batch
from auv_torchrl.diagnosis.reduce import Quadratic, reduce
from auv_torchrl.diagnosis.smooth import (
    sensor_noise,
)
from auv_torchrl.diagnosis.windows import Floats
from auv_torchrl.effects import EFFECTS

SLACK_LIMIT = 3.0  # standard deviations: more is no slack but a gap
THRESHOLD_REACH = (0.05, 0.015, 0.004)  # of the plausible range
NOISE_MATTERS = 0.02  # relative
REPEATS = 3  # of linearising windows again
FAR = 0.3  # of chi-square, that a descent gains where slopes need to be taken again
GAINS = 0.02  # of chi-square, below which doing so is not worth it
SLACK_STEP = 0.05  # relative step of slack derivatives
KNOB_STEP = 0.004  # of the plausible range of a parameter


class Bench(Following):
    """A log, a vehicle and settings, with all that is needed to fit and weigh explanations."""

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
