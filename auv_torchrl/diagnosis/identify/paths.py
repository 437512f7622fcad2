"""Explanations on windows: the motion under one, chi-square near it as a quadratic, and how large it is."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.hypotheses import batch
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.actuation import coefficients
from auv_torchrl.diagnosis.motion.force import MeasuredMotion, middles, reading_changes, responses
from auv_torchrl.diagnosis.motion.reduce import NuisanceResponses, Parts, Quadratic, local_precision, pooled, reduce
from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.motion.smooth import TANGENT, Smoothed, noise_per_sample
from auv_torchrl.diagnosis.motion.tangent import Slopes
from auv_torchrl.diagnosis.motion.windows import Floats, Windows, chunks
from auv_torchrl.diagnosis.thresholds import SATISFIED, STRAINED
from auv_torchrl.physics import Coefficients, prepare
from auv_torchrl.vehicle import Vehicle


@dataclass(frozen=True)
class WindowPath:
    """Windows that follow the log under one explanation."""

    explanation: Explanation
    vehicle: Vehicle  # (1,) with the explanation, nuisance parameters included
    state: Smoothed
    states: Floats  # (W, S + 1, 13) on the grid
    windows: Windows

    @cached_property
    def coefficients(self) -> Coefficients:
        """Of the vehicle, (1, ...), in numpy."""
        return coefficients(self.vehicle)

    @cached_property
    def course(self) -> MeasuredMotion:
        """The vehicle along its motion."""
        return MeasuredMotion.of(self.windows, self.coefficients, self.motion)

    @cached_property
    def motion(self) -> Floats:
        """(W, S, 13) in the middle of each grid step."""
        return middles(self.states)

    def without_slopes(self) -> "WindowPath":
        """The motion alone, in a fifteenth of the memory: to compare with or to begin from, not to linearise about."""
        nothing = np.empty(0)
        return replace(
            self, state=replace(self.state, **dict.fromkeys(TANGENT, nothing), slopes=Slopes(lambda: nothing))
        )


@dataclass(frozen=True)
class Fit:
    """An explanation with its values fitted."""

    explanation: Explanation
    chi2: float  # with the cost of nuisance parameters
    evidence: float
    covariance: Floats  # (k, k) of the fitted terms, nuisance parameters included
    path: WindowPath
    quadratic: Quadratic  # of nuisance parameters, then fitted terms, at the path
    steps: Floats  # (k,) one unit of the quadratic, of each fitted term
    nuisance_responses: NuisanceResponses | None  # that it was made of, while its values are being fitted

    @property
    def excess(self) -> float:
        """Chi-square per number."""
        return self.chi2 / self.quadratic.numbers

    def set_aside(self) -> "Fit":
        """A fit that lost: what it is worth and the motion under it, without the slopes that fill the memory."""
        return replace(self, path=self.path.without_slopes(), nuisance_responses=None)

    @property
    def nothing_left(self) -> bool:
        """Whether nothing is left beyond the noise."""
        return self.chi2 < self.quadratic.numbers + spread(self)


def nuisance_now(problem: Problem, explanation: Explanation) -> Floats:
    """Deviations of the nuisance parameters of an explanation, in the order of the nuisance parameters."""
    return np.array([explanation.nuisance.get((effect, member), 0.0) for effect, member, _, _ in problem.nuisance])


def leaves_much(problem: Problem, fit: Fit) -> bool:
    """Whether an explanation leaves more than the physics may be wrong by."""
    return fit.chi2 > problem.settings.excess * fit.quadratic.numbers


def spread(fit: Fit) -> float:
    """By how much chi-square must fall before that is more than chance."""
    return SATISFIED * float(np.sqrt(2 * fit.quadratic.numbers))


def nuisance_does(problem: Problem, fit: Fit) -> bool:
    """Whether nuisance parameters alone explain the log, all together no further off than is likely.

    One by one the deviations may be likely where together they are not: healthy flights that leave the scale of all
    gains open still tell how much one gain differs from the next.
    """
    at = nuisance_now(problem, fit.explanation)
    likely = len(at) + STRAINED * np.sqrt(2 * len(at))
    return not leaves_much(problem, fit) and bool(at @ problem.nuisance_precision @ at < likely)


def log_likelihood(problem: Problem, fit: Fit) -> float:
    """Log evidence of the samples, the free start and the disturbance of every window integrated out.

    Unlike :attr:`Fit.evidence` it pays for the free numbers of the windows and for the sensor noise, so that
    problems with other degrees of freedom can be compared.
    """
    windows, whole = problem.windows, fit.path.state.slope
    noise_of_each, grams = noise_per_sample(windows, problem.sigma)[:, None], []
    precision = local_precision(problem.layout, windows.dt, problem.floor)
    for some in chunks(len(windows), whole[:1].nbytes):
        slope = whole[some] / noise_of_each
        slope = slope[np.isfinite(slope).all((1, 2))]  # a window that diverged has paid by its chi-square
        grams.append(slope.swapaxes(1, 2) @ slope + precision)
    volumes = float((np.linalg.slogdet(np.concatenate(grams))[1] - np.linalg.slogdet(precision)[1]).sum())
    counts = (windows.trust**2).sum((0, 1))
    noise = sum(np.log(problem.sigma[c]) * count for c, count in zip(windows.channels, counts, strict=True))
    return fit.evidence - 0.5 * volumes - float(noise)


def force_of_nuisance(problem: Problem, path: WindowPath) -> float:
    """Size of the force that nuisance parameters alone make on this log, in units of the thrusters' reach."""
    size, direction = np.linalg.eigh(problem.nuisance_covariance)
    keys = [(effect, member) for effect, member, _, _ in problem.nuisance]
    each = [
        Explanation(nuisance=dict(zip(keys, (np.sqrt(max(s, 0.0)) * d).tolist(), strict=True)))
        for s, d in zip(size, direction.T, strict=True)
    ]
    return float(np.sqrt((sizes(problem, each, path) ** 2).sum()))


@DIVERGING
def sizes(problem: Problem, explanations: list[Explanation], path: WindowPath) -> Floats:
    """Root mean square force of explanations beyond the nominal vehicle, in units of the thrusters' reach."""
    if not problem.followed.any() or not explanations:
        return np.zeros(len(explanations))
    values = [{}, *(explanation.values(problem.vehicle) for explanation in explanations)]
    c = prepare(batch(problem.vehicle, values)).numpy()
    moves = problem.layout.start[: len(problem.layout.start) // 2]  # unseen ones too: some effects act through a tilt
    course = MeasuredMotion.of(problem.windows, c.rows(slice(1)), path.motion)
    scaled = (course.forces(c.rows(slice(1, None)))[..., moves] / problem.reach[moves])[problem.followed]
    return np.sqrt((scaled**2).mean((0, 2)).sum(-1))


RESPONSES_AT_ONCE = (
    12_000  # windows times changes: 0.1 GB; more does not fit the cache, less prepares vehicles too often
)
RESPONSES_BYTES = 12 << 20  # of the responses of all changes; up to ten such arrays are in use at once


def quadratic(
    problem: Problem,
    path: WindowPath,
    changes: list[Explanation],
    around: Explanation | None = None,
    nuisance_responses: NuisanceResponses | None = None,
    chosen: np.ndarray | None = None,
) -> Quadratic:
    """Chi-square of deviations of nuisance parameters (first) and of amounts of ``changes``, each whole at 1.

    It is taken ``around`` an explanation, by default that of the path; another one acts as the force that it makes
    along the motion of the path. ``nuisance_responses`` are those of :func:`respond_to_nuisance` if they
    are known, ``chosen`` is a mask (W,) of the windows that count, by default all.
    """
    if nuisance_responses is None:
        nuisance_responses = respond_to_nuisance(problem, path, path.explanation if around is None else around)
    if chosen is None:
        chosen = np.ones(len(problem.windows), bool)
    return pooled(_parts(problem, path, changes, around, nuisance_responses), chosen)


def _parts(
    problem: Problem,
    path: WindowPath,
    changes: list[Explanation],
    around: Explanation | None,
    nuisance_responses: NuisanceResponses,
) -> Iterator[Parts]:
    """What the windows add to the quadratic, piece by piece: all responses of all of them would fill the memory."""
    freedom = problem.freedom(path.state)
    nuisance = nuisance_responses.under(freedom)
    for some, columns, there in _responses_in_pieces(problem, path, changes, around):
        windows, state = path.course.rows(some).windows, path.state.rows(some)
        if there is not None:
            state = replace(state, residual=state.residual - there)
        yield reduce(windows, problem.layout, freedom.rows(some), state, columns, nuisance.rows(some))


def respond_to_nuisance(problem: Problem, path: WindowPath, at: Explanation) -> NuisanceResponses:
    """Responses of the nuisance parameters around an explanation on the windows of a path."""
    moved, steps = [], np.empty(len(problem.nuisance))
    for column, parameter in enumerate(problem.nuisance):
        key = parameter[:2]
        steps[column] = problem.nuisance_step(parameter)
        moved.append(replace(at, nuisance={**at.nuisance, key: at.nuisance.get(key, 0.0) + steps[column]}))
    pieces = _responses_in_pieces(problem, path, moved, None if at == path.explanation else at)
    responded = np.concatenate([columns for _, columns, _ in pieces]) / steps
    freedom = problem.freedom(path.state)
    return NuisanceResponses(freedom, freedom.reduced(responded))


def _responses_in_pieces(
    problem: Problem, path: WindowPath, changes: list[Explanation], around: Explanation | None
) -> Iterator[tuple[slice, Floats, Floats | None]]:
    """Some windows, responses (w, K, N) to changes beyond ``around``, and that to ``around`` (w, K), if any."""
    rows = [change.values(problem.vehicle) for change in (*changes, *([around] if around else []))]
    changed = prepare(batch(problem.vehicle, rows)).numpy() if rows else None
    now = path.coefficients
    for some in in_pieces(len(problem.windows), len(rows), path.state.residual[0].size):
        if changed is None:
            yield some, np.empty((*path.state.residual[some].shape, 0)), None
            continue
        course = path.course.rows(some)
        windows, forces = course.windows, course.forces(changed)
        columns = responses(windows, now, problem.layout, path.state.rows(some), forces)
        read = reading_changes(windows, now, changed, path.states[some])
        columns = columns if read is None else columns + read
        if around is None:
            yield some, columns, None
        else:
            yield some, columns[..., :-1] - columns[..., -1:], columns[..., -1]


def without_nuisance(problem: Problem, q: Quadratic, explanation: Explanation) -> tuple[Floats, Floats]:
    """The vector and the matrix of the other columns, nuisance parameters fitted."""
    k = len(problem.nuisance)
    at, precision = nuisance_now(problem, explanation), problem.nuisance_precision
    inside = q.A[:k, :k] + precision
    right = np.concatenate([(q.b[:k] - precision @ at)[:, None], q.A[:k, k:]], axis=1)
    solved = np.linalg.solve(inside, right)
    offset, response = solved[:, 0], solved[:, 1:]
    b = q.b[k:] - q.A[k:, :k] @ offset
    A = q.A[k:, k:] - q.A[k:, :k] @ response
    return b, 0.5 * (A + A.T)


def in_pieces(windows: int, changes: int, numbers: int = 1) -> Iterator[slice]:
    """Slices of windows of so many ``numbers``, all about as long.

    On none of them ``changes`` make more than :data:`RESPONSES_AT_ONCE`, nor :data:`RESPONSES_BYTES` of numbers.
    """
    return chunks(windows, changes, max(1, min(RESPONSES_AT_ONCE, RESPONSES_BYTES // (8 * numbers))))
