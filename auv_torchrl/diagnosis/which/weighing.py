"""Weigh an explanation at given windows: chi-square, evidence, uncertainty and the step that makes it better."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.motion.force import force_changes, marks, reading_changes
from auv_torchrl.diagnosis.motion.reduce import Parts, Quadratic, bounded_minimum, pooled, reduce
from auv_torchrl.diagnosis.motion.smooth import Smoothed, fields
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.which.evidence import volume
from auv_torchrl.diagnosis.which.explanation import Explanation
from auv_torchrl.diagnosis.which.following import Following
from auv_torchrl.diagnosis.which.ground import Base, Judged
from auv_torchrl.diagnosis.which.hypotheses import batch
from auv_torchrl.effects import EFFECTS

SLACK_LIMIT = 4.0  # standard deviations: more is no slack but a gap; one vehicle in twenty has a coefficient beyond 3
SLACK_STEP = 0.05  # relative step of slack derivatives
SLACK_SHARES = np.geomspace(1.0, 0.05, 13)  # of its width, that slack may have in one vehicle
KNOB_STEP = 0.004  # of the plausible range of a parameter
MARKS_AT_ONCE = 12_000  # windows times changes: 0.1 GB; more does not fit the cache, less prepares vehicles too often


class Weighing(Following):
    """Chi-square of explanations as a quadratic of their values and of slack."""

    def quadratic(
        self,
        base: Base,
        changes: list[Explanation],
        around: Explanation | None = None,
        slack_marks: Floats | None = None,
        chosen: np.ndarray | None = None,
    ) -> Quadratic:
        """Chi-square of slack deviations (first) and of amounts of ``changes`` (each at 1 is that explanation).

        It is taken ``around`` an explanation, by default that of the base; another one acts as the force that it makes
        along the motion of the base. ``slack_marks`` are those of :meth:`slack_marks` if they are known, ``chosen`` is
        a mask (W,) of the windows that count, by default all.
        """
        if slack_marks is None:
            slack_marks = self.slack_marks(base, base.explanation if around is None else around)
        if chosen is None:
            chosen = np.ones(len(self.windows), bool)
        return pooled(self._parts(base, changes, around, slack_marks), chosen)

    def _parts(
        self, base: Base, changes: list[Explanation], around: Explanation | None, slack_marks: Floats
    ) -> Iterator[Parts]:
        """What the windows add to the quadratic, piece by piece: all marks of all of them would fill the memory."""
        freedom = self.freedom(base.state.slope)
        for some, columns, there in self._marks(base, changes, around):
            state = rows_of(base.state, some)
            if there is not None:
                state = replace(state, residual=state.residual - there)
            columns = np.concatenate([slack_marks[some], columns], axis=-1)
            yield reduce(self.windows.subset(some), self.layout, freedom.rows(some), state, columns)

    def slack_marks(self, base: Base, at: Explanation) -> Floats:
        """Marks (W, K, k) of the slack parameters, per unit, around an explanation on the windows of a base."""
        moved, steps = [], np.empty(len(self.slack))
        for column, (effect, member, nominal, _) in enumerate(self.slack):
            key = effect, member
            steps[column] = SLACK_STEP * abs(nominal)
            moved.append(replace(at, slack={**at.slack, key: at.slack.get(key, 0.0) + steps[column]}))
        pieces = self._marks(base, moved, None if at == base.explanation else at)
        return np.concatenate([columns for _, columns, _ in pieces]) / steps

    def _marks(
        self, base: Base, changes: list[Explanation], around: Explanation | None
    ) -> Iterator[tuple[slice, Floats, Floats | None]]:
        """Some windows, marks (w, K, N) of changes beyond ``around``, and the mark (w, K) of that; None is the base."""
        rows = [change.values(self.vehicle) for change in (*changes, *([around] if around else []))]
        vehicles = batch(self.vehicle, rows) if rows else None
        for some in in_pieces(len(self.windows), len(rows)):
            if vehicles is None:
                yield some, np.empty((*base.state.residual[some].shape, 0)), None
                continue
            windows = self.windows.subset(some)
            forces = force_changes(windows, base.vehicle, vehicles, base.motion[some])
            columns = marks(windows, base.vehicle, self.layout, rows_of(base.state, some), forces)
            read = reading_changes(windows, base.vehicle, vehicles, base.states[some])
            columns = columns if read is None else columns + read
            if around is None:
                yield some, columns, None
            else:
                yield some, columns[..., :-1] - columns[..., -1:], columns[..., -1]

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

    def judge(
        self, base: Base, sketched: Explanation | None = None, before: Judged | None = None
    ) -> tuple[Judged, Floats, Floats]:
        """Weigh an explanation as it is, with the Gauss-Newton step of its knobs and of its slack.

        It is that of the base, or one that is ``sketched`` along its motion. The marks of slack are those of the
        explanation ``before`` it, where there is one: they hardly change on the way down.
        """
        explanation = base.explanation if sketched is None else sketched
        changes, steps = self.knob_changes(explanation)
        slack_marks = None if before is None else before.slack_marks
        if slack_marks is None:
            slack_marks = self.slack_marks(base, explanation)
        q = self.quadratic(base, changes, sketched, slack_marks, None if sketched is None else self.followed)
        at = self.slack_now(explanation)
        chi2 = q.constant + float(at @ self.slack_precision @ at)
        if not np.isfinite(chi2):  # the windows diverge under this vehicle
            nothing = np.zeros(len(explanation.fitted))
            return (
                Judged(explanation, np.inf, -np.inf, np.diag(nothing), base, q, steps, slack_marks),
                nothing,
                np.zeros(len(self.slack)),
            )
        _, _, A, _, _ = self.without_slack(q, explanation)
        widths = np.array([self.prior.width(knob.effect, knob.members[0]) for knob in explanation.fitted])
        curvature = A / np.outer(steps, steps)
        covariance = np.linalg.inv(curvature + np.diag(widths**-2.0))
        evidence = self.weigh(chi2, explanation) + volume(curvature, widths)
        judged = Judged(explanation, chi2, evidence, covariance, base, q, steps, slack_marks)
        return judged, *self._step(judged)

    def value_steps(self, explanation: Explanation, steps: Floats) -> tuple[Floats, Floats, Floats]:
        """Prior precision and bounds (m,) of the fitted values, in ``steps`` away from where they are."""
        bounds = [EFFECTS[knob.effect].member_parameters(self.vehicle)[knob.members[0]] for knob in explanation.fitted]
        widths = np.array([self.prior.width(knob.effect, knob.members[0]) for knob in explanation.fitted])
        room = np.array([
            sorted(((p.low - knob.value) / step, (p.high - knob.value) / step))
            for p, knob, step in zip(bounds, explanation.fitted, steps, strict=True)
        ]).reshape(-1, 2)  # fmt: skip
        return (steps / widths) ** 2, room[:, 0], room[:, 1]

    def moved_along(self, judged: Judged, amounts: Mapping[int, float], along: bool = True) -> Explanation:
        """The explanation with some numbers, of slack or fitted knobs, moved by amounts.

        ``amounts`` are by column of the quadratic: slack first, then fitted knobs. The others go ``along`` as fits
        best, or stay.
        """
        units = np.concatenate([np.ones(len(self.slack)), judged.steps])
        held = dict.fromkeys(range(0 if along else len(units)), 0.0)
        held |= {column: amount / units[column] for column, amount in amounts.items()}
        return self.move(judged.explanation, *self._step(judged, held))

    def as_sure(self, judged: Judged) -> tuple[Explanation, Floats]:
        """The explanation with its values, and their covariance (m, m), where slack is as wide as this log shows it.

        Its share of the width that slack may have is the likeliest one (type II maximum likelihood): of a vehicle that
        is as its file says, the log shows that, and tells the values of an effect better.
        """
        q, steps, k = judged.quadratic, judged.steps, len(self.slack)
        at = np.concatenate([self.slack_now(judged.explanation), np.zeros(len(steps))])
        stiffness = self.value_steps(judged.explanation, steps)[0]
        likeliest, sure = -np.inf, (judged.explanation, judged.covariance)
        for share in SLACK_SHARES:
            pull = joint_precision(self.slack_precision / share**2, stiffness)
            curvature, slope = q.A + pull, q.b - pull @ at
            step = np.linalg.solve(curvature, slope)
            log_likelihood = 0.5 * (slope @ step - at @ pull @ at - np.linalg.slogdet(curvature)[1]) - k * np.log(share)
            if log_likelihood > likeliest and share < 1:
                moved = self.move(judged.explanation, step[k:] * steps, step[:k])
                sure = moved, np.linalg.inv(curvature)[k:, k:] * np.outer(steps, steps)
            likeliest = max(likeliest, log_likelihood)
        return sure

    def even_step(self, judged: Judged) -> tuple[Floats, Floats]:
        """Gauss-Newton step of knobs and slack in which no slack of a threshold moves."""
        return self._step(judged, dict.fromkeys(np.flatnonzero(~self.even).tolist(), 0.0))

    def _step(self, judged: Judged, held: Mapping[int, float] | None = None) -> tuple[Floats, Floats]:
        """Gauss-Newton step of knobs and slack, all within their bounds: slack goes no further than slack does.

        Some columns may be ``held`` at an amount.
        """
        q, steps = judged.quadratic, judged.steps
        k, at = len(self.slack), self.slack_now(judged.explanation)
        stiffness, least, most = self.value_steps(judged.explanation, steps)
        pull = joint_precision(self.slack_precision, stiffness)
        toward = np.concatenate([-self.slack_precision @ at, np.zeros(len(steps))])
        reach = SLACK_LIMIT * np.array([width for *_, width in self.slack])
        low, high = np.concatenate([-reach - at, least]), np.concatenate([reach - at, most])
        x, free = np.zeros(len(low)), np.ones(len(low), bool)
        for column, amount in (held or {}).items():
            x[column], free[column] = amount, False
        step = bounded_minimum(q.A + pull, q.b + toward, low, high, x, free)
        return step[k:] * steps, step[:k]

    def move(self, explanation: Explanation, step: Floats, slack_step: Floats) -> Explanation:
        """The explanation after a step of its knobs and of its slack, within bounds."""
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


def joint_precision(slack: Floats, values: Floats) -> Floats:
    """Prior precision (k + m, k + m) of slack, (k, k), and of independent values, (m,)."""
    k = len(slack)
    joint = np.zeros((k + len(values), k + len(values)))
    joint[:k, :k] = slack
    joint[k:, k:] = np.diag(values)
    return joint


def in_pieces(windows: int, changes: int) -> Iterator[slice]:
    """Slices of windows, all about as long, of which ``changes`` make no more than :data:`MARKS_AT_ONCE` at once."""
    pieces = min(windows, -(-windows * changes // MARKS_AT_ONCE)) or 1
    edges = np.linspace(0, windows, pieces + 1).astype(int).tolist()
    return (slice(first, behind) for first, behind in zip(edges, edges[1:], strict=False))


def rows_of(state: Smoothed, some: slice) -> Smoothed:
    """The state of some windows."""
    return Smoothed(*(field[some] for field in fields(state)))
