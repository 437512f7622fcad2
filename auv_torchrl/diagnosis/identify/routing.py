"""Which command drives which thruster, with sign: the routing estimated whole, and rounded to plugs.

Along the measured motion the force of a vehicle is linear in its routing matrix: thruster i gives what command j would
have made it give, times an entry. All entries are fitted at once by least squares, and rounded to a permutation with
signs by assignment. Where several thrusters get the same commands, least squares leave entries open, and rounding alone
may miss: exchanges of two commands, and other signs, are tried on the same quadratic until none is better.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from auv_torchrl.diagnosis.identify.assess import log_evidence
from auv_torchrl.diagnosis.identify.evidence import exchanges, volume
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term
from auv_torchrl.diagnosis.identify.paths import WindowPath, nuisance_now
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.quadratics import quadratic, without_nuisance
from auv_torchrl.diagnosis.identify.screen import Screened
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import ONE_MORE_VALUE
from auv_torchrl.effects.actuation import thruster_gain, thruster_swap

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
        """(n * n,) its matrix less the identity, row by row."""
        n = len(self.giver)
        matrix = np.zeros((n, n))
        matrix[np.arange(n), self.giver] = self.sign
        return (matrix - np.eye(n)).ravel()

    @property
    def plugs(self) -> int:
        """How many exchanges of two plugs it takes, and how many that are reversed or dead."""
        return exchanges(dict(enumerate(self.giver.tolist()))) + int((self.sign != 1.0).sum())

    def terms(self) -> tuple[Term, ...]:
        """The values that it sets."""
        (command,), (gain,) = thruster_swap.parameters, thruster_gain.parameters
        moved = [i for i, j in enumerate(self.giver) if i != j]
        swapped = [
            Term(thruster_swap.name, (f"{command.name}_{i + 1}",), float(self.giver[i] + 1), True) for i in moved
        ]
        other = np.flatnonzero(self.sign != 1.0).tolist()
        members = tuple(f"{gain.name}_{i + 1}" for i in other)
        if len(other) == len(self.giver) and (self.sign == self.sign[0]).all():
            return *swapped, Term(thruster_gain.name, members, float(self.sign[0]))
        scaled = [
            Term(thruster_gain.name, (member,), float(self.sign[i])) for member, i in zip(members, other, strict=True)
        ]
        return *swapped, *scaled

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
    mine = (thruster_swap.name, thruster_gain.name)
    rest = Explanation(tuple(term for term in around.terms if term.effect not in mine))
    n = problem.vehicle.thrusters
    if n < 2 or not set(mine) <= {candidate.effect for candidate in problem.candidates}:
        return None
    constant, g, H = _of_entries(problem, follow, rest, n)
    if not np.isfinite(H).all() or not np.isfinite(g).all():
        return None
    best = _likeliest(g, H, n)
    if not best.plugs:
        return None
    terms, d = best.terms(), best.departure
    explanation = Explanation((*rest.terms, *terms))
    chi2 = constant - 2 * float(g @ d) + float(d @ H @ d)
    gains = [i for i in range(n) if best.sign[i] != 1.0]
    curvature, widths = H[np.ix_(*2 * [[n * i + best.giver[i] for i in gains]])], []
    if gains:
        widths = [problem.prior.width(thruster_gain.name, f"{thruster_gain.parameters[0].name}_{i + 1}") for i in gains]
    evidence = log_evidence(problem, chi2, explanation) + volume(curvature, np.array(widths))
    return Screened(explanation, chi2, evidence)


def _of_entries(problem: Problem, follow: WindowPath, rest: Explanation, n: int) -> tuple[float, Floats, Floats]:
    """Chi-square ``constant - 2 g d + d H d`` of entries ``d`` (n * n,) of the routing less the identity."""
    (command,), (gain,) = thruster_swap.parameters, thruster_gain.parameters
    changes = []
    for i, j in product(range(1, n + 1), repeat=2):
        other = Term(thruster_swap.name, (f"{command.name}_{i}",), float(j), True)
        none = Term(thruster_gain.name, (f"{gain.name}_{i}",), 0.0)
        changes.append(Explanation((*rest.terms, none if i == j else other)))
    around = None if rest == follow.explanation else rest
    q = quadratic(problem, follow, changes, around, chosen=problem.followed)
    b, A = without_nuisance(problem, q, rest)
    k, precision = len(problem.nuisance), problem.nuisance_precision
    at = nuisance_now(problem, rest)
    pull = q.b[:k] - precision @ at
    constant = q.constant + float(at @ precision @ at) - float(pull @ np.linalg.solve(q.A[:k, :k] + precision, pull))
    # A thruster that gets another command does no longer what its own would make it do; a dead one does neither.
    amounts = np.eye(n * n)
    for i in range(n):
        amounts[n * i + i, n * i : n * i + n] = -1.0
    return constant, amounts.T @ b, amounts.T @ A @ amounts


def _likeliest(g: Floats, H: Floats, n: int) -> Routing:
    """The permutation with signs that has the least chi-square, what each plug costs included."""
    from scipy.optimize import linear_sum_assignment  # here: few logs come to it, and it takes long to import

    entries = np.linalg.solve(H + np.eye(n * n), g).reshape(n, n) + np.eye(n)
    _, giver = linear_sum_assignment(-np.abs(entries))
    rounded = Routing(giver, np.where(entries[np.arange(n), giver] < 0, -1.0, 1.0))
    rng = np.random.default_rng(0)
    starts = [rounded, Routing(np.arange(n), np.ones(n))]
    starts += [Routing(rng.permutation(n), np.ones(n)) for _ in range(STARTS)]
    return min((_descend(g, H, start) for start in starts), key=lambda one: _cost(g, H, [one])[0])


def _descend(g: Floats, H: Floats, routing: Routing) -> Routing:
    (cost,) = _cost(g, H, [routing])
    while True:
        around = list(routing.neighbours())
        costs = _cost(g, H, around)
        if not costs.min() < cost:
            return routing
        routing, cost = around[int(costs.argmin())], costs.min()


def _cost(g: Floats, H: Floats, routings: Sequence[Routing]) -> Floats:
    """(R,) chi-square less a constant."""
    d = np.stack([one.departure for one in routings])
    return ((d @ H) * d).sum(-1) - 2 * d @ g + A_PLUG * np.array([one.plugs for one in routings])


def _replaced(values: np.ndarray, places: list[int], new: Sequence[float] | np.ndarray) -> np.ndarray:
    copy = values.copy()
    copy[places] = new
    return copy
