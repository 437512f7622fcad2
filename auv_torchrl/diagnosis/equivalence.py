"""What this log cannot tell apart: changes that leave the same mark on it."""

import numpy as np

from auv_torchrl.diagnosis.bench import Bench
from auv_torchrl.diagnosis.explanation import Explanation
from auv_torchrl.diagnosis.hypotheses import Atom
from auv_torchrl.diagnosis.screen import SAME_MARK, Field
from auv_torchrl.diagnosis.search import Found

AS_GOOD = 9.0  # chi-square by which an explanation may be worse and still cannot be excluded


def indistinguishable(bench: Bench, found: Found) -> tuple[tuple[str, ...], ...]:
    """Sets of effects, or of parameters of one effect, of which the log cannot tell which one acts.

    They come from two sides: explanations that fit as well as the best one, and changes whose mark is the same.
    """
    sets = {frozenset(pair) for pair in _rivals(found)} | {
        frozenset(pair) for pair in _same_marks(bench, found, found.field)
    }
    return tuple(sorted(tuple(sorted(names)) for names in sets))


def _rivals(found: Found) -> list[tuple[str, str]]:
    best = set(found.best.explanation.effects)
    pairs = []
    for judged in found.polished:
        other = set(judged.explanation.effects)
        mine, theirs = best - other, other - best
        if len(mine) == len(theirs) == 1 and judged.chi2 < found.best.chi2 + AS_GOOD:
            pairs.append((mine.pop(), theirs.pop()))
    return pairs


def _same_marks(bench: Bench, found: Found, field: Field) -> list[tuple[str, str]]:
    size = np.sqrt(np.maximum(np.diag(field.A), 0.0))
    rows = np.flatnonzero(field.seen)
    cosine = field.A[np.ix_(rows, rows)] / np.outer(size[rows], size[rows])
    pairs = []
    for a, b in zip(*np.nonzero(np.abs(np.triu(cosine, 1)) > SAME_MARK), strict=True):
        one, other = bench.atoms[rows[a]], bench.atoms[rows[b]]
        if _name(one, other) != _name(other, one) and (
            _acts(one, found.best.explanation) or _acts(other, found.best.explanation)
        ):
            pairs.append((_name(one, other), _name(other, one)))
    return pairs


def _name(atom: Atom, other: Atom) -> str:
    """The effect, or its parameters where the two are of the same effect."""
    return atom.effect if atom.effect != other.effect else ", ".join(atom.values)


def _acts(atom: Atom, explanation: Explanation) -> bool:
    return any(knob.effect == atom.effect and set(knob.members) <= set(atom.values) for knob in explanation.knobs)
