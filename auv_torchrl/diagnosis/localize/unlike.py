"""One thruster that does what no known effect does, as a hypothesis: it has a map of its own, or changes by itself.

Whichever of the two has the higher evidence is told. The hypothesis is weighed against effects as these are against
each other; effects that stand in for such a thruster would blame others beside it.

A map is measured along the motion: the thrust is cut into slices by the size of its command, each way by itself. Each
slice is there by a share of its own, 1 where the thruster gives what it should, and besides the thruster may push at
rest. The shares have a normal prior about what the explanation has of the thruster, which gives all of it, a part or
nothing, and are integrated out as the moments of a thruster are.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.hypotheses import Values, batch
from auv_torchrl.diagnosis.identify.paths import WindowPath
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.search import Found, Unknown, outdoes
from auv_torchrl.diagnosis.localize.attribute import on_grid, quadratics
from auv_torchrl.diagnosis.localize.moments import Moments, changing_thruster
from auv_torchrl.diagnosis.motion.actuation import coefficients
from auv_torchrl.diagnosis.motion.force import MeasuredMotion
from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import CLOSES, Z95
from auv_torchrl.diagnosis.verdict import Intermittence, Slice, ThrustMap
from auv_torchrl.effects import EFFECTS
from auv_torchrl.physics import ActiveTerms, Coefficients
from auv_torchrl.physics.pushes import wrench_per_share
from auv_torchrl.sysid.trace import Outcome

SLICE = 0.1  # of the full command: finer ones are too short to be told
SPREAD = 1.0  # standard deviation of the share of a slice, before anything was seen: it may as well be dead
AT_REST = 0.3  # likewise of the thrust at rest, of the full thrust
# Of the chi-square beyond noise, what one thruster leaves at most that is to be blamed: beside files that are wrong by
# factors a sound one left 0.56 to 0.76, and one that was at fault 0.18 or less.
MOST = 0.5


@dataclass(frozen=True)
class Mapped:
    """A thruster with a map of its own, and what that is worth."""

    measured: ThrustMap
    evidence: float  # log evidence of the log under the map, and nothing else that is wrong
    excess: float  # chi-square per number under the map


@DIVERGING
def measure_map(problem: Problem, path: WindowPath, thruster: int) -> Mapped | None:
    """The map of a thruster, from 1; None of a servo."""
    own = thruster - 1
    if own in (*problem.vehicle.fins, *problem.vehicle.azimuths):
        return None
    commands = on_grid(problem.windows, problem.windows.commands)[problem.followed][..., own]
    edges = sorted({_slice_of(command) for command in np.unique(np.round(commands, 3)).tolist() if command})
    sound = coefficients(batch(problem.vehicle, [_values_beside(problem, path.explanation, thruster)]))
    forces = np.stack([*_of_slices(path, sound, own, edges), _at_rest(path, sound, own)], axis=1)
    (q,) = quadratics(problem, path, forces, [problem.followed])
    spread = np.array([SPREAD] * len(edges) + [AT_REST])
    inverse = np.linalg.inv(q.A + np.diag(spread**-2.0))
    amount = inverse @ q.b
    volume = float(np.linalg.slogdet(np.eye(len(spread)) + spread[:, None] * q.A * spread)[1])
    closed = float(q.b @ amount)
    excess = (q.constant - closed) / max(q.numbers, 1)
    half = Z95 * np.sqrt(max(1.0, excess) * np.diag(inverse))  # what no map explains makes it as unsure
    there = zip(_of_slices(path, path.coefficients, own, edges), np.moveaxis(forces, 1, 0), strict=False)
    now = [_share(its[problem.followed], whole[problem.followed]) for its, whole in there]
    slices = (
        Slice(low, high, n + a, n + a - h, n + a + h)
        for (low, high), n, a, h in zip(edges, now, amount.tolist(), half.tolist(), strict=False)
    )
    push, band = float(amount[-1]), float(half[-1])
    measured = ThrustMap(thruster, tuple(slices), push, push - band, push + band)
    return Mapped(measured, 0.5 * (closed - volume - q.constant), excess)


def _share(its: Floats, whole: Floats) -> float:
    """How much of one force another one is; all of it where there is none, as within a dead band."""
    square = float((whole**2).sum())
    return float((its * whole).sum()) / square if square else 1.0


def _slice_of(command: float) -> tuple[float, float]:
    """From and to which command the slice goes that holds one; backwards both are negative."""
    k, way = min(int(abs(command) / SLICE + 1e-9), round(1 / SLICE) - 1), 1 if command > 0 else -1
    near, far = round(way * SLICE * k, 6), round(way * SLICE * (k + 1), 6)
    return min(near, far), max(near, far)


def _values_beside(problem: Problem, explanation: Explanation, thruster: int) -> Values:
    """The values of an explanation, but for those of one thruster: it gives what it should."""
    return {
        effect: {member: value for member, value in row.items() if EFFECTS[effect].thruster_of(member) != thruster}
        for effect, row in explanation.values(problem.vehicle).items()
    }


def _of_slices(path: WindowPath, c: Coefficients, own: int, edges: list[tuple[float, float]]) -> Iterator[Floats]:
    """Forces (W, S, 6) that a thruster of a vehicle (1,) makes by its commands within each pair of edges."""
    windows, whole = path.windows, path.windows.held[..., own]

    def course(kept: np.ndarray) -> MeasuredMotion:
        held = windows.held.copy()
        held[..., own] = np.where(kept, whole, 0.0)
        parts = None if windows.parts is None else held
        masked = replace(windows, commands=held.mean(2), parts=parts)
        return MeasuredMotion.of(masked, c, path.motion)

    nothing = course(np.zeros(whole.shape, bool))
    for low, high in edges:
        size, (near, far) = np.abs(whole), sorted((abs(low), abs(high)))
        within = (np.sign(whole) == np.sign(low + high)) & (size >= near) & ((size < far) | (far >= 1.0))
        shown = course(within)
        yield replace(nothing, windows=shown.windows).forces(c)[:, 0]


def _at_rest(path: WindowPath, c: Coefficients, own: int) -> Floats:
    """Force (W, S, 6) of the full thrust of a thruster of a vehicle (1,), all the time."""
    push = wrench_per_share(c, ActiveTerms.of(c))[0, :, own]
    return np.broadcast_to(push, (len(path.windows), path.windows.steps, 6))


@dataclass(frozen=True)
class Unlike:
    """A thruster that pushes otherwise than commanded, and what that is worth."""

    moments: Moments
    mapped: Mapped | None  # its map, where that has the higher evidence

    @property
    def thruster(self) -> int:
        """Its number, from 1."""
        return self.moments.thruster

    @property
    def evidence(self) -> float:
        """Log evidence of the log under this, and nothing else that is wrong."""
        return (self.mapped or self.moments).evidence

    @property
    def excess(self) -> float:
        """Chi-square per number under this."""
        return (self.mapped or self.moments).excess

    @property
    def intermittence(self) -> Intermittence | None:
        """Where it gives all of its thrust or nothing, from moment to moment."""
        return None if self.mapped else self.moments.intermittence()

    @property
    def thrust_map(self) -> ThrustMap | None:
        """Where it gives the same at one command."""
        return self.mapped and self.mapped.measured

    @property
    def explains(self) -> bool:
        """Whether it leaves too little for any effect beside it."""
        return self._leaves_less_than(CLOSES)

    @property
    def is_most(self) -> bool:
        """Whether this thruster is most of what the simulator misses; else something other than it must be wrong."""
        return self._leaves_less_than(MOST)

    def _leaves_less_than(self, share: float) -> bool:
        """Whether less than a share of the chi-square beyond noise remains."""
        return self.excess - 1 < share * (self.moments.before - 1)


def unlike_thruster(problem: Problem, path: WindowPath) -> Unlike | None:
    """The thruster that pushes otherwise than commanded, where one stands out from all others; else None."""
    moments = changing_thruster(problem, path)
    if moments is None:
        return None
    mapped = measure_map(problem, path, moments.thruster)
    return Unlike(moments, mapped if mapped is not None and mapped.evidence > moments.evidence else None)


def evidence_of_unlike(problem: Problem, path: WindowPath) -> Unknown:
    """What such a thruster is worth.

    Its gains take up some of any error of the motion that was measured. So one that leaves much is held against effects
    once some have been simulated.
    """
    unlike = unlike_thruster(problem, path)
    if unlike is None:
        return Unknown()
    return Unknown(unlike.evidence if unlike.explains else -np.inf, unlike.evidence)


def unless_unlike(found: Found) -> Found | None:
    """Without effects, where such a thruster is likelier than all of them; None where it is not."""
    if not found.best.explanation.effects or _likelier(found) is None:
        return None
    return replace(found, best=found.none, trace=found.trace.instead((), Outcome.CHANGING))


def is_unlike(found: Found) -> bool:
    """Whether such a thruster leaves too little for any other cause, and is likelier than all effects."""
    return _explaining(found) is not None


def left_at_best(found: Found) -> float:
    """Chi-square per number that such a thruster leaves where it explains a log, and else what effects leave."""
    return (_explaining(found) or found).excess


def _explaining(found: Found) -> Unlike | None:
    """Such a thruster, where it is likelier than all effects and leaves too little for any other cause."""
    unlike = _likelier(found)
    return unlike if unlike is not None and unlike.explains else None


def _likelier(found: Found) -> Unlike | None:
    """Such a thruster, where it closes as much more of what effects leave as one more effect had to."""
    unlike = unlike_thruster(found.problem, found.follow)
    return unlike if unlike is not None and outdoes(unlike.evidence, found.best) else None
