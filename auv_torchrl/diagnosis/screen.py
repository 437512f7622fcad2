"""Which effects could explain a log: all atoms and all pairs of them judged at once on one quadratic."""

from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.bench import Base, Bench
from auv_torchrl.diagnosis.evidence import volume
from auv_torchrl.diagnosis.explanation import Explanation
from auv_torchrl.diagnosis.hypotheses import Atom
from auv_torchrl.diagnosis.windows import Floats
from auv_torchrl.effects import EFFECTS

ELASTIC = 0.4  # a scanned value may act by 1 +- 0.4 of itself, then a neighbour takes over
FIXED = 1e-5  # a discrete change acts wholly
SEEN = 1e-6  # chi-square of a whole atom
PAIRS_KEPT = 12
MOST_KNOBS = 6  # of one family


@dataclass(frozen=True)
class Screened:
    """An explanation as the screening sees it."""

    explanation: Explanation
    chi2: float
    evidence: float


@dataclass(frozen=True)
class Field:
    """The quadratic of all atoms at a base, slack fitted."""

    bench: Bench
    base: Base
    constant: float
    b: Floats  # (N,)
    A: Floats  # (N, N)
    pull: Floats  # (N,) prior precision of each amount, about 1 for scanned atoms, else about 0
    centre: Floats  # (N,)

    @property
    def seen(self) -> np.ndarray:
        """(N,) atoms that leave any mark on this log."""
        return np.diag(self.A) > SEEN

    @staticmethod
    def of(bench: Bench, base: Base) -> "Field":
        """Mark every atom on the windows of ``base``."""
        changes = [base.explanation.with_atom(atom, bench.vehicle) for atom in bench.atoms]
        q = bench.quadratic(base, changes).windows(bench.followed)
        constant, b, A, _, _ = bench.without_slack(q, base.explanation)
        width = [FIXED if a.discrete else ELASTIC if a.elastic else 1e3 for a in bench.atoms]
        centre = np.array([1.0 if a.discrete or a.elastic else 0.0 for a in bench.atoms])
        return Field(bench, base, constant, b, A, np.array(width) ** -2.0, centre)

    def fit(self, chosen: list[int]) -> tuple[float, Floats]:
        """Chi-square and amounts of some atoms together."""
        A = self.A[np.ix_(chosen, chosen)] + np.diag(self.pull[chosen])
        b = self.b[chosen] + self.pull[chosen] * self.centre[chosen]
        amounts = np.linalg.lstsq(A, b, rcond=1e-13)[0]
        offset = float((self.pull[chosen] * self.centre[chosen] ** 2).sum())
        return self.constant + offset - float(b @ amounts), amounts

    def judge(self, chosen: list[int]) -> Screened:
        """Weigh some atoms together, on top of the explanation of the base."""
        amounts = self.fit(chosen)[1]
        bench, explanation = self.bench, self.base.explanation
        units, widths, fitted, reached = [], [], [], []
        for i, amount in zip(chosen, amounts, strict=True):
            atom = bench.atoms[i]
            before = explanation
            explanation = explanation.with_atom(atom, bench.vehicle, float(amount))
            if not atom.discrete:
                unit, width = self._unit(atom)
                units.append(unit)
                widths.append(width)
                fitted.append(i)
                reached.append(self._reached(atom, before, explanation, float(amount)))
            else:
                reached.append(1.0)
        curvature = self.A[np.ix_(fitted, fitted)] / np.outer(units, units)
        a = np.array(reached)
        chi2 = self.constant - float(2 * self.b[chosen] @ a - a @ self.A[np.ix_(chosen, chosen)] @ a)
        evidence = bench.weigh(chi2, explanation) + volume(curvature, np.array(widths))
        return Screened(explanation, chi2, evidence)

    def _unit(self, atom: Atom) -> tuple[float, float]:
        """Change of the parameter that an atom moves most, and the plausible range of that parameter."""
        most = self._moved_most(atom)
        nominal = EFFECTS[atom.effect].nominal(self.bench.vehicle)[most]
        return atom.values[most] - nominal, self.bench.prior.width(atom.effect, most)

    def _moved_most(self, atom: Atom) -> str:
        nominal = EFFECTS[atom.effect].nominal(self.bench.vehicle)
        width = self.bench.prior.width
        return max(atom.values, key=lambda name: abs(atom.values[name] - nominal[name]) / width(atom.effect, name))

    def _reached(self, atom: Atom, before: Explanation, after: Explanation, amount: float) -> float:
        """The amount that the bounds of the parameters leave, of the ``amount`` asked for."""
        unbound = amount * self._unit(atom)[0]
        name = self._moved_most(atom)
        moved = _value(after, atom.effect, name, self.bench) - _value(before, atom.effect, name, self.bench)
        return amount * moved / unbound if unbound else 0.0

    def none(self) -> Screened:
        """The explanation of the base alone."""
        return Screened(self.base.explanation, self.constant, self.bench.weigh(self.constant, self.base.explanation))

    def families(self) -> list[Screened]:
        """The best explanation of each family alone, members added while that pays."""
        names = list(dict.fromkeys(self.bench.atoms[i].effect for i in np.flatnonzero(self.seen)))
        return sorted((self._grow(name) for name in names), key=lambda s: -s.evidence)

    def _grow(self, family: str) -> Screened:
        inside = [i for i, atom in enumerate(self.bench.atoms) if atom.effect == family and self.seen[i]]
        chosen: list[int] = []
        best: Screened | None = None
        while len(chosen) < MOST_KNOBS:
            free = [i for i in inside if not self._overlaps(i, chosen)]
            if not free:
                break
            trial = min(free, key=lambda i: self.fit([*chosen, i])[0])
            judged = self.judge([*chosen, trial])
            if best is not None and judged.evidence <= best.evidence:
                break
            chosen, best = [*chosen, trial], judged
        assert best is not None
        return best

    def _overlaps(self, i: int, chosen: list[int]) -> bool:
        mine = self.bench.atoms[i]
        return any(set(mine.values) & set(self.bench.atoms[j].values) or mine.discrete for j in chosen)

    def pairs(self) -> list[Screened]:
        """The best pairs of atoms of different families."""
        d = np.diag(self.A) + self.pull
        b = self.b + self.pull * self.centre
        offset = self.pull * self.centre**2
        det = d[:, None] * d - self.A**2
        safe = (det > 1e-9 * d[:, None] * d) & self.seen[:, None] & self.seen
        gain = (d[None] * b[:, None] ** 2 + d[:, None] * b[None] ** 2 - 2 * self.A * b[:, None] * b[None]) / np.where(
            safe, det, 1.0
        )
        gain = np.where(safe, gain - offset[:, None] - offset, -np.inf)
        family = np.array([atom.effect for atom in self.bench.atoms])
        gain[family[:, None] == family] = -np.inf
        gain[np.tril_indices(len(gain))] = -np.inf
        found: dict[tuple[str, str], Screened] = {}
        for flat in np.argsort(-gain, axis=None)[:400]:
            i, j = divmod(int(flat), len(gain))
            key = (family[i], family[j])
            if key not in found and np.isfinite(gain[i, j]):
                found[key] = self.judge([i, j])
            if len(found) >= PAIRS_KEPT:
                break
        return sorted(found.values(), key=lambda s: -s.evidence)


def _value(explanation: Explanation, effect: str, member: str, bench: Bench) -> float:
    values = explanation.values(bench.vehicle, slack=False).get(effect, {})
    return values.get(member, EFFECTS[effect].nominal(bench.vehicle)[member])
