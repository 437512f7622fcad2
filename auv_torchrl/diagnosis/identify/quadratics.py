"""Chi-square near an explanation, as a quadratic of nuisance parameters and changes, by their responses."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.hypotheses import batch
from auv_torchrl.diagnosis.identify.paths import WindowPath, nuisance_now
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.force import reading_changes, responses
from auv_torchrl.diagnosis.motion.reduce import NuisanceResponses, Parts, Quadratic, pooled, reduce
from auv_torchrl.diagnosis.motion.windows import Floats, chunks
from auv_torchrl.physics import prepare

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
    along the motion of the path. ``slack_marks`` are those of :func:`mark_slack` if they are known, ``chosen`` is
    a mask (W,) of the windows that count, by default all.
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
