"""Which thruster pushes otherwise than commanded, from moment to moment, and for which share of the time it fails.

The gain of a thruster may depart from that of the explanation by an amount of its own in every piece of half a second.
The amounts are normal about zero, with one standard deviation for a thruster; they are integrated out as starts and
disturbances are. The log evidence that a thruster gains so, whatever it does, tells which one pushes otherwise than
commanded: one that sticks, stalls or wanders has no constant gain, and no other thruster stands in for it.
"""

from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.identify.paths import WindowPath
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.localize.attribute import in_pieces
from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import LARGER, WORTH_AN_EFFECT, Z95
from auv_torchrl.diagnosis.verdict import Intermittence
from auv_torchrl.effects.effect import changed
from auv_torchrl.physics import prepare

PIECE_S = 0.5  # s: a thruster reaches its thrust in 0.1 s, and a loose plug is off for longer than this
SPREADS = (0.25, 0.5, 1.0)  # of the thrust: standard deviations of the amounts that are tried
KNOWN = 0.25  # standard deviation of a gain, below which a piece tells whether the thruster gave anything
NEAR = 0.2  # of the thrust: as much as such a piece is off by, where the thruster gave all of it or nothing
ON_OR_OFF = 0.5  # of the pieces that tell, that must be so: of gains that are spread evenly two in five are
SOMETIMES = 0.05  # of the time, that it must at least be on, and off


@dataclass(frozen=True)
class Moments:
    """Gains of one thruster in ``W`` windows of ``P`` pieces."""

    thruster: int  # from 1
    evidence: float  # log evidence of the log under this, and nothing else that is wrong
    excess: float  # chi-square per number under this
    before: float  # the same without it
    gain: Floats  # (W, P) times what the healthy vehicle gives
    deviation: Floats  # (W, P) standard deviation; where it is not commanded, that of the amounts

    def intermittence(self) -> Intermittence | None:
        """The share of the time in which it gives nothing, where it gives all of its thrust or nothing; else None."""
        tells = self.deviation < KNOWN
        off, on = np.abs(self.gain[tells]) < NEAR, np.abs(self.gain[tells] - 1) < NEAR
        if not tells.any() or min(off.mean(), on.mean()) < SOMETIMES or (off | on).mean() < ON_OR_OFF:
            return None
        lost = np.where(tells, np.clip(1 - self.gain, 0.0, 1.0), 0.0)
        share = float(lost.sum() / tells.sum())
        # Windows by themselves: bouts are longer than pieces, so that those of one window go together.
        half = Z95 * float(np.linalg.norm((lost - share * tells).sum(1))) / float(tells.sum())
        return Intermittence(self.thruster, share, max(0.0, share - half), min(1.0, share + half))


@DIVERGING
def changing_thruster(problem: Problem, path: WindowPath) -> Moments | None:
    """The thruster that pushes otherwise than commanded, where one stands out from all others; else None."""
    left, b, A, known = _quadratics(problem, path)
    evidence = np.array([[_evidence(b[i], A[i], known, spread) for spread in SPREADS] for i in range(len(b))])
    best = evidence.max(1) - np.log(len(b) * len(SPREADS))
    first = int(best.argmax())
    if not best[first] > LARGER or best[first] - np.delete(best, first).max(initial=-np.inf) < WORTH_AN_EFFECT:
        return None
    spread = SPREADS[int(evidence[first].argmax())]
    inverse = np.linalg.inv(A[first] + np.eye(A.shape[-1]) / spread**2)
    amount = (inverse @ b[first][..., None])[..., 0]
    numbers = float(problem.windows.numbers_of_each[known].sum())
    excess = (left - float((b[first] * amount).sum())) / numbers
    nominal = float(problem.vehicle.gain[..., first])
    now = float(path.vehicle.gain[0, first]) / nominal
    deviation = np.where(known[:, None], np.sqrt(np.diagonal(inverse, axis1=1, axis2=2)), np.inf)
    return Moments(first + 1, best[first] - 0.5 * left, excess, left / numbers, now + amount, deviation)


def _evidence(b: Floats, A: Floats, known: np.ndarray, spread: float) -> float:
    """Log evidence of amounts with a standard deviation, over none, of pulls (W, P) and curvatures (W, P, P)."""
    size = np.eye(A.shape[-1])
    volume = np.linalg.slogdet(size + spread**2 * A)[1]
    fit = (b * np.linalg.solve(A + size / spread**2, b[..., None])[..., 0]).sum(1)
    return float((0.5 * (fit - volume))[known].sum())


def _quadratics(problem: Problem, path: WindowPath) -> tuple[float, Floats, Floats, np.ndarray]:
    """Of the gains in each piece the chi-square without them, pulls (n, W, P) and curvatures (n, W, P, P).

    Besides, which windows (W,) are known.
    """
    windows, count = problem.windows, problem.vehicle.thrusters
    gain = path.vehicle.gain + np.diag(np.broadcast_to(problem.vehicle.gain, (count,)))
    more = prepare(changed(path.vehicle.expand(count), gain=gain)).numpy()
    pieces = -(-windows.steps // max(1, round(PIECE_S / windows.dt)))
    within = np.arange(windows.steps) * pieces // windows.steps == np.arange(pieces)[:, None]  # (P, S)
    b, A = np.zeros((count, len(windows), pieces)), np.zeros((count, len(windows), pieces, pieces))
    known, left = problem.followed.copy(), np.zeros(len(windows))

    def cut(some: slice) -> Floats:
        each = path.course.rows(some).forces(more)  # (w, n, S, 6)
        return (each[:, :, None] * within[:, :, None]).reshape(len(each), count * pieces, windows.steps, 6)

    for some, parts in in_pieces(problem, path, count * pieces, cut):
        whole, finite = parts.by_window
        known[some] &= finite
        left[some] = whole[:, 0, 0]
        for i in range(count):
            mine = slice(1 + i * pieces, 1 + (i + 1) * pieces)
            b[i, some], A[i, some] = whole[:, 0, mine], whole[:, mine, mine]
    return float(left[known].sum()), np.where(known[:, None], b, 0.0), np.where(known[:, None, None], A, 0.0), known
