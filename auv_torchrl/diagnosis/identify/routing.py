"""Which command drives which thruster, with sign: the routing estimated whole, and rounded to plugs.

Along the measured motion the force of a vehicle is linear in what its thrusters get: a thruster gives what a command
would have made it give, times an entry, and what the opposite of that command would have, times another. All entries
are fitted at once by least squares, and rounded to a permutation with signs by assignment. Where several thrusters get
the same commands, least squares leave entries open, and rounding alone may miss: exchanges of two commands, and other
signs, are tried on the same quadratic until none is better.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, product

import numpy as np

from auv_torchrl.diagnosis.identify.assess import log_evidence
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term, exchanges, volume
from auv_torchrl.diagnosis.identify.paths import WindowPath, nuisance_now, quadratic, without_nuisance
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Screened
from auv_torchrl.diagnosis.motion.reduce import Quadratic
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import ONE_MORE_VALUE
from auv_torchrl.effects.actuation import thruster_gain, thruster_swap
from auv_torchrl.vehicle import Vehicle

SIGNS = (1.0, -1.0, 0.0)  # as it should be, reversed, dead
STARTS = 12  # of the search for the best permutation: a fifth as many missed one of eight plugs in fifty
A_PLUG = -2 * np.log(ONE_MORE_VALUE)  # chi-square that one more exchanged or reversed plug costs


@dataclass(frozen=True)
class Routing:
    """A permutation of commands with a sign for each thruster."""

    giver: np.ndarray  # (n,) whose command each thruster gets, from 0
    sign: Floats  # (n,) one of SIGNS

    @property
    def departure(self) -> Floats:
        """(2 n n,) its entries less those of a sound vehicle, of commands and then of their opposites."""
        n = len(self.giver)
        entries, thrusters = np.zeros((2, n, n)), np.arange(n)
        entries[0, thrusters, self.giver] = self.sign > 0
        entries[1, thrusters, self.giver] = self.sign < 0
        entries[0] -= np.eye(n)
        return entries.ravel()

    @property
    def plugs(self) -> int:
        """How many exchanges of two plugs it takes, and how many that are reversed or dead."""
        return exchanges(dict(enumerate(self.giver.tolist()))) + int((self.sign != 1.0).sum())

    def terms(self, even: Sequence[bool]) -> tuple[Term, ...]:
        """The values that it sets; a thruster that is ``even`` has a gain of -1 where it is reversed."""
        swapped: list[Term] = []
        gains: dict[str, float] = {}
        for i, (j, sign) in enumerate(zip(self.giver.tolist(), self.sign.tolist(), strict=True), start=1):
            has_gain = sign == 0.0 or (sign < 0 and even[i - 1])
            number = j + 1 if has_gain else int(sign) * (j + 1)
            if number != i:
                swapped.append(_gets(i, number))
            if has_gain:
                gains[_gain(i)] = sign
        if len(gains) == len(self.giver) and len({*gains.values()}) == 1:
            return *swapped, Term(thruster_gain.name, tuple(gains), float(self.sign[0]))
        return *swapped, *(Term(thruster_gain.name, (member,), sign) for member, sign in gains.items())

    def neighbours(self) -> Iterator["Routing"]:
        """With two commands exchanged, whatever the signs of both then, or with another sign of one thruster."""
        for i, sign in product(range(len(self.giver)), SIGNS):
            yield Routing(self.giver, _replaced(self.sign, [i], [sign]))
        for pair in combinations(range(len(self.giver)), 2):
            giver = _replaced(self.giver, list(pair), self.giver[list(pair[::-1])])
            for signs in product(SIGNS[:2], repeat=2):
                yield Routing(giver, _replaced(self.sign, list(pair), signs))


def propose_routing(problem: Problem, follow: WindowPath, around: Explanation) -> Screened | None:
    """``around`` with the likeliest plugs in place of those that it has; None where all are where they belong."""
    solved = _solve(problem, follow, around)
    if solved is None:
        return None
    rest, entries, best = solved
    n = problem.vehicle.thrusters
    terms, chi2, H = best.terms(_even(problem.vehicle)), entries.chi2(best.departure), entries.H
    explanation = Explanation((*rest.terms, *terms))
    gains = [int(member.rsplit("_", 1)[1]) for term in terms if not term.discrete for member in term.members]
    places = [n * (i - 1) + int(best.giver[i - 1]) for i in gains]
    widths = np.array([problem.prior.width(thruster_gain.name, _gain(i)) for i in gains])
    evidence = log_evidence(problem, chi2, explanation) + volume(H[np.ix_(places, places)], widths)
    return Screened(explanation, chi2, evidence)


def left_by_plugs(problem: Problem, follow: WindowPath) -> float:
    """The likeliest plugs' chi-square, as a share of that of thrusters that do nothing; 1 where all are in place."""
    solved = _solve(problem, follow, follow.explanation)
    if solved is None:
        return 1.0
    _, entries, best = solved
    dead = Routing(best.giver, np.zeros(len(best.giver)))
    return entries.chi2(best.departure) / entries.chi2(dead.departure)


def _solve(problem: Problem, follow: WindowPath, around: Explanation) -> tuple[Explanation, "_Entries", Routing] | None:
    """What ``around`` has beside plugs, chi-square by routing, and the likeliest one; None where plugs are in place."""
    mine = (thruster_swap.name, thruster_gain.name)
    rest = Explanation(tuple(term for term in around.terms if term.effect not in mine))
    n = problem.vehicle.thrusters
    if n < 2 or not set(mine) <= {candidate.effect for candidate in problem.candidates}:
        return None
    changes, amounts = _changes(_even(problem.vehicle))
    changed = [Explanation((*rest.terms, change)) for change in changes]
    elsewhere = None if rest == follow.explanation else rest
    q = quadratic(problem, follow, changed, elsewhere, chosen=problem.followed)
    entries = _of_entries(problem, q, rest, amounts)
    if not np.isfinite(entries.H).all() or not np.isfinite(entries.g).all():
        return None
    error = max(1.0, entries.chi2(entries.least) / max(q.numbers, 1))
    best = _likeliest(_of_entries(problem, q, rest, amounts, error), n)
    return (rest, entries, best) if best.plugs else None


def _even(vehicle: Vehicle) -> list[bool]:
    """Of each thruster, whether the opposite of a command gives the opposite thrust."""
    same_as = thruster_swap.trial.same_as
    numbers = range(1, vehicle.thrusters + 1)
    return [same_as is not None and same_as(vehicle, _gets(i, -i).members[0], -float(i)) is not None for i in numbers]


def _gets(thruster: int, command: int) -> Term:
    return Term(thruster_swap.name, (f"{thruster_swap.parameters[0].name}_{thruster}",), float(command), True)


def _gain(thruster: int) -> str:
    return f"{thruster_gain.parameters[0].name}_{thruster}"


@dataclass(frozen=True)
class _Entries:
    """Chi-square ``constant - 2 g d + d H d`` of the departure ``d`` (2 n n,) of a routing."""

    constant: float
    g: Floats
    H: Floats
    a_plug: float  # chi-square that one more exchanged or reversed plug costs

    def chi2(self, d: Floats) -> float:
        """Chi-square of a departure (2 n n,)."""
        return self.constant - 2 * float(self.g @ d) + float(d @ self.H @ d)

    def cost(self, routings: Sequence[Routing]) -> Floats:
        """(R,) chi-square less a constant, with what plugs cost."""
        d = np.stack([one.departure for one in routings])
        return ((d @ self.H) * d).sum(-1) - 2 * d @ self.g + self.a_plug * np.array([one.plugs for one in routings])

    @cached_property
    def least(self) -> Floats:
        """The departure (2 n n,) that least squares find, held a little so that all is determined."""
        return np.linalg.solve(self.H + np.eye(len(self.g)), self.g)


def _of_entries(problem: Problem, q: Quadratic, rest: Explanation, amounts: Floats, error: float = 1.0) -> _Entries:
    """Chi-square of entries, by the quadratic of changes and their ``amounts``.

    All errors, those of the simulator too, have ``error`` times the variance of the noise. What the simulator misses
    must not count as noise: nuisance parameters would make up for it, and plugs would be told that are not there.
    Chi-square stays in units of the noise, so what it is weighed against counts ``error`` times.
    """
    k, precision = len(problem.nuisance), error * problem.nuisance_precision
    b, A = without_nuisance(replace(problem, nuisance_precision=precision), q, rest)
    at = nuisance_now(problem, rest)
    pull = q.b[:k] - precision @ at
    constant = q.constant + float(at @ precision @ at) - float(pull @ np.linalg.solve(q.A[:k, :k] + precision, pull))
    return _Entries(constant, amounts.T @ b, amounts.T @ A @ amounts, error * A_PLUG)


def _changes(even: Sequence[bool]) -> tuple[list[Term], Floats]:
    """Changes of a vehicle (C,), and how much of each (C, 2 n n) an entry of the routing takes.

    A thruster that gets another command does no longer what its own would make it do; a dead one does neither.
    """
    n = len(even)
    changes = [Term(thruster_gain.name, (_gain(i + 1),), 0.0) for i in range(n)]
    columns = np.zeros((n + 2 * n * n, 2, n, n))
    for sign, i, j in product((0, 1), range(n), range(n)):
        if sign and even[i]:
            columns[:, 1, i, j] = -columns[:, 0, i, j]
            continue
        columns[i, sign, i, j] = -1.0
        if sign or i != j:
            columns[len(changes), sign, i, j] = 1.0
            changes.append(_gets(i + 1, -(j + 1) if sign else j + 1))
    return changes, columns[: len(changes)].reshape(len(changes), -1)


def _likeliest(entries: _Entries, n: int) -> Routing:
    """The permutation with signs that has the least chi-square, what each plug costs included."""
    from scipy.optimize import linear_sum_assignment  # here: few logs come to it, and it takes long to import

    ahead, opposite = entries.least.reshape(2, n, n)
    matrix = np.eye(n) + ahead - opposite
    _, giver = linear_sum_assignment(-np.abs(matrix))
    rounded = Routing(giver, np.where(matrix[np.arange(n), giver] < 0, -1.0, 1.0))
    rng = np.random.default_rng(0)
    starts = [rounded, Routing(np.arange(n), np.ones(n))]
    starts += [Routing(rng.permutation(n), np.ones(n)) for _ in range(STARTS)]
    return min((_descend(entries, start) for start in starts), key=lambda one: entries.cost([one])[0])


def _descend(entries: _Entries, routing: Routing) -> Routing:
    (cost,) = entries.cost([routing])
    while True:
        around = list(routing.neighbours())
        costs = entries.cost(around)
        if not costs.min() < cost:
            return routing
        routing, cost = around[int(costs.argmin())], costs.min()


def _replaced(values: np.ndarray, places: list[int], new: Sequence[float] | np.ndarray) -> np.ndarray:
    copy = values.copy()
    copy[places] = new
    return copy
