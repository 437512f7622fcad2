"""Which effects could explain a log, or what an explanation leaves: all candidates fit at once on one quadratic."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from auv_torchrl.diagnosis.identify.assess import joint_precision, log_evidence, term_changes, value_steps
from auv_torchrl.diagnosis.identify.explanation import Explanation, volume
from auv_torchrl.diagnosis.identify.hypotheses import Candidate, declared
from auv_torchrl.diagnosis.identify.paths import WindowPath, nuisance_now, quadratic, without_nuisance
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.reduce import Quadratic
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import (
    ELASTIC_WIDTH,
    FIXED_WIDTH,
    MOST_TERMS,
    NUISANCE_LIMIT,
    SAME_RESPONSE,
    SEEN_AT_ALL,
)
from auv_torchrl.sysid.bounded import SINGULAR, bounded_minimum, solve_semidefinite


@dataclass(frozen=True)
class Screened:
    """An explanation as the screening sees it."""

    explanation: Explanation
    chi2: float
    evidence: float


@dataclass(frozen=True)
class Field:
    """The quadratic of all candidates at a path, nuisance parameters and the values of its explanation fitted."""

    problem: Problem
    explanation: Explanation  # on top of which the candidates act
    quadratic: Quadratic  # of nuisance parameters, the values of the explanation, and candidates
    values: tuple[Floats, Floats, Floats]  # (m,) prior precision of steps of these values, and their bounds in steps
    b: Floats  # (N,) nuisance parameters fitted
    A: Floats  # (N, N) nuisance parameters fitted
    pull: Floats  # (N,) prior precision of each amount, about 1 for scanned candidates, else about 0
    centre: Floats  # (N,)

    @property
    def seen(self) -> np.ndarray:
        """(N,) candidates that leave any response on this log."""
        return np.diag(self.A) > SEEN_AT_ALL

    @staticmethod
    def of(problem: Problem, path: WindowPath, around: Explanation | None = None) -> "Field":
        """The response of every candidate on the windows of ``path``, on top of its explanation or of another one."""
        explanation = path.explanation if around is None else around
        moved, steps = term_changes(problem, explanation)
        candidates = [explanation.with_candidate(candidate, problem.vehicle) for candidate in problem.candidates]
        q = quadratic(problem, path, [*moved, *candidates], around, chosen=problem.followed)
        b, A = without_nuisance(problem, q, explanation)
        b, A = b[len(moved) :], A[len(moved) :, len(moved) :]
        values = value_steps(problem, explanation, steps)
        width = [FIXED_WIDTH if a.discrete else ELASTIC_WIDTH if a.elastic else 1e3 for a in problem.candidates]
        centre = np.array([1.0 if a.discrete or a.elastic else 0.0 for a in problem.candidates])
        return Field(problem, explanation, q, values, b, A, np.array(width) ** -2.0, centre)

    @property
    def constant(self) -> float:
        """Chi-square of the explanation of the path, nuisance parameters and values fitted."""
        return self.fit([])[0]

    def fit(self, chosen: list[int], amounts: Floats | None = None) -> tuple[float, Floats]:
        """Chi-square and amounts of some candidates together, or chi-square at given amounts.

        Nuisance parameters are fitted too, within their bounds: what lies beyond must be an effect. The values that the
        explanation has already are fitted as well, because a candidate may take over a part of what they do.
        """
        H, g, low, high, paid = self._pulled
        first = len(low)
        columns = [*range(first), *(first + i for i in chosen)]
        H, g = H[columns][:, columns], g[columns]
        open_ended = np.full(len(chosen), np.inf)
        low, high = np.concatenate([low, -open_ended]), np.concatenate([high, open_ended])
        x, free = np.zeros(len(columns)), None
        pull, centre = self.pull[chosen], self.centre[chosen]
        if amounts is None:
            at = np.arange(first, len(columns))
            H[at, at] += pull
            g[first:] += pull * centre
            paid += float(pull @ centre**2)
        else:
            x[first:], free = amounts, np.arange(len(columns)) < first
        x = bounded_minimum(H, g, low, high, x, free)
        return self.quadratic.constant + paid + float(x @ (H @ x - 2 * g)), x[first:]

    @cached_property
    def _pulled(self) -> tuple[Floats, Floats, Floats, Floats, float]:
        """The quadratic with the prior of nuisance parameters and values: matrix, vector, bounds and cost."""
        problem, q = self.problem, self.quadratic
        stiffness, least, most = self.values
        at, first = nuisance_now(problem, self.explanation), len(problem.nuisance) + len(stiffness)
        toward = np.concatenate([-at, np.zeros(len(stiffness))])
        pull = joint_precision(problem.nuisance_precision, stiffness)
        H, g = q.A.copy(), q.b.copy()
        H[:first, :first] += pull
        g[:first] += pull @ toward
        reach = NUISANCE_LIMIT * np.sqrt(np.diag(problem.nuisance_covariance))
        low, high = np.concatenate([-reach - at, least]), np.concatenate([reach - at, most])
        return H, g, low, high, float(toward @ pull @ toward)

    def judge(self, chosen: list[int]) -> Screened:
        """Weigh some candidates together, on top of the explanation of the path."""
        amounts = self.fit(chosen)[1]
        problem, explanation = self.problem, self.explanation
        units, widths, fitted, reached = [], [], [], []
        for i, amount in zip(chosen, amounts, strict=True):
            candidate = problem.candidates[i]
            before = explanation
            explanation = explanation.with_candidate(candidate, problem.vehicle, float(amount))
            if not candidate.discrete:
                unit, width = self._unit(candidate)
                units.append(unit)
                widths.append(width)
                fitted.append(i)
                reached.append(self._reached(candidate, before, explanation, float(amount)))
            else:
                reached.append(1.0)
        curvature = self.A[np.ix_(fitted, fitted)] / np.outer(units, units)
        chi2 = self.fit(chosen, np.array(reached))[0]
        evidence = log_evidence(problem, chi2, explanation) + volume(curvature, np.array(widths))
        return Screened(explanation, chi2, evidence)

    def _unit(self, candidate: Candidate) -> tuple[float, float]:
        """Change of the parameter that a candidate moves most, and the plausible range of that parameter."""
        most = self.moved_most(candidate)
        nominal = declared(candidate.effect, self.problem.vehicle).nominal[most]
        return candidate.values[most] - nominal, self.problem.prior.width(candidate.effect, most)

    def moved_most(self, candidate: Candidate) -> str:
        """The parameter that a candidate moves most, for its plausible range."""
        nominal = declared(candidate.effect, self.problem.vehicle).nominal
        width = self.problem.prior.width
        return max(
            candidate.values,
            key=lambda name: abs(candidate.values[name] - nominal[name]) / width(candidate.effect, name),
        )

    def _reached(self, candidate: Candidate, before: Explanation, after: Explanation, amount: float) -> float:
        """The amount that the bounds of the parameters leave, of the ``amount`` asked for."""
        unbound = amount * self._unit(candidate)[0]
        name = self.moved_most(candidate)
        moved = _value(after, candidate.effect, name, self.problem) - _value(
            before, candidate.effect, name, self.problem
        )
        return amount * moved / unbound if unbound else 0.0

    def none(self) -> Screened:
        """The explanation of the path alone."""
        constant = self.constant
        return Screened(self.explanation, constant, log_evidence(self.problem, constant, self.explanation))

    def families(self) -> list[Screened]:
        """The best explanation of each family alone, members added while that pays."""
        return sorted((self._family(name) for name in self._names), key=lambda s: -s.evidence)

    @property
    def _names(self) -> list[str]:
        return list(dict.fromkeys(self.problem.candidates[i].effect for i in np.flatnonzero(self.seen)))

    def _family(self, name: str) -> Screened:
        """The best explanation by members of a family."""
        inside = [i for i, candidate in enumerate(self.problem.candidates) if candidate.effect == name and self.seen[i]]
        # once all members are moved, none is added
        alone = [i for i in inside if not moves_all(self.problem, self.problem.candidates[i])]
        ways = [inside, alone] if 0 < len(alone) < len(inside) else [inside]
        return max((self._grown(way) for way in ways), key=lambda grown: grown.evidence)

    def _grown(self, inside: list[int]) -> Screened:
        """The best explanation by the first candidate of some, and by further ones while that pays."""
        chosen = [inside[int(with_each(self, [], inside).argmin())]]
        best = self.judge(chosen)
        while len(chosen) < MOST_TERMS and (free := [i for i in inside if not _overlaps(self, i, chosen)]):
            chosen = [*chosen, free[int(with_each(self, chosen, free).argmin())]]
            fit = self.judge(chosen)
            if fit.evidence <= best.evidence:
                break
            best = fit
        return best


def with_each(field: Field, chosen: list[int], others: list[int]) -> Floats:
    """Chi-square (N,) of chosen candidates and one of ``N`` others, as :meth:`Field.fit` has it, by one solution."""
    H, g, low, high, paid = field._pulled
    first = len(low)
    inside, beside = [*range(first), *(first + i for i in chosen)], [first + i for i in others]
    corner, across = H[inside][:, inside], H[inside][:, beside]
    at, pull = np.arange(first, len(inside)), field.pull
    corner[at, at] += pull[chosen]
    right, its = g[inside], g[beside] + pull[others] * field.centre[others]
    right[first:] += pull[chosen] * field.centre[chosen]
    solved = solve_semidefinite(corner, np.column_stack([right, across]))
    alone, response = solved[:, 0], solved[:, 1:]
    own = H[beside, beside] + pull[others]
    curvature, left = own - (across * response).sum(0), its - across.T @ alone
    nearly_none = SINGULAR**0.5 * own
    amounts = left / np.maximum(curvature, nearly_none)
    x = alone[:first, None] - response[:first] * amounts
    paid += float(pull[chosen] @ field.centre[chosen] ** 2)
    chi2 = field.quadratic.constant + paid + pull[others] * field.centre[others] ** 2 - right @ alone - left * amounts
    bound = (x < low[:, None]) | (x > high[:, None])
    for order in np.flatnonzero(bound.any(0) | (curvature < nearly_none)):
        chi2[order] = field.fit([*chosen, others[order]])[0]
    return chi2


def _overlaps(field: Field, i: int, chosen: list[int]) -> bool:
    """Whether a candidate says the same as chosen ones, or moves what they move."""
    mine = field.problem.candidates[i]
    for j in chosen:
        other = field.problem.candidates[j]
        if abs(field.A[i, j]) > SAME_RESPONSE * np.sqrt(field.A[i, i] * field.A[j, j]):
            return True
        if other.effect == mine.effect and (mine.discrete or set(mine.values) & set(other.values)):
            return True
    return False


def moves_all(problem: Problem, candidate: Candidate) -> bool:
    """Whether a candidate moves all members of a family of parameters by one value."""
    parameters = declared(candidate.effect, problem.vehicle).parameters
    return (
        len(candidate.values) > 1
        and not candidate.discrete
        and len({parameters[name].name for name in candidate.values}) == 1
    )


def _value(explanation: Explanation, effect: str, member: str, problem: Problem) -> float:
    values = explanation.values(problem.vehicle, nuisance=False).get(effect, {})
    return values.get(member, declared(effect, problem.vehicle).nominal[member])
