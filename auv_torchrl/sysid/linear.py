"""How the samples change with small changes: of a start, of a disturbance, of a parameter.

The step of the model is linearised along the states of a path. A parameter then is a change of each step and of each
report, worked out at states that are known, however far a simulation with another value would drift from them: its
response in the samples is its sensitivity. With starts and disturbances integrated out, all windows together become one
small quadratic, the reduced quadratic.
"""

from dataclasses import dataclass

import numpy as np

from auv_torchrl.sysid.model import Floats, wrapped
from auv_torchrl.sysid.path import STEP, Path, Problem


@dataclass(frozen=True)
class Tangent:
    """The steps of a path, linearised."""

    transition: Floats  # (W, S, n, n) of a state in the one before
    push: Floats  # (W, S, n, f) of a state in the force of the step before it
    reading: Floats  # (W, S + 1, C, n) of the reports in the state


@dataclass(frozen=True)
class Linearised:
    """A path, its tangent, and what its free numbers do to the samples."""

    path: Path
    tangent: Tangent
    slope: Floats  # (W, K, L) change of the prediction, in units of the noise


@dataclass(frozen=True)
class Quadratic:
    """Chi-square of changes ``a`` (N,): ``constant - 2 b a + a A a``, starts and disturbances at their best."""

    constant: float
    b: Floats  # (N,)
    A: Floats  # (N, N)


def linearise(problem: Problem, path: Path) -> Linearised:
    """The path with its tangent and the slopes of its free numbers."""
    model, n, f = problem.model, problem.states, len(problem.model.force_width)
    values, before, inputs, force = (
        path.values[None],
        path.states[:, :-1],
        problem.windows.inputs,
        problem.held(path.bins),
    )
    with np.errstate(over="ignore", invalid="ignore"):
        after = model.advance(values, before, inputs, force)[:, 0]
        transition, push = np.empty((*after.shape, n)), np.empty((*after.shape, f))
        here = model.observe(values, path.states[:, None])[:, 0]
        reading = np.empty((*here.shape, n))
        for entry in range(n):
            size = STEP * model.start_width[entry]
            moved = path.states.copy()
            moved[..., entry] += size
            beyond = model.advance(values, moved[:, :-1], inputs, force)[:, 0]
            transition[..., entry] = model.difference(beyond, after) / size
            reading[..., entry] = _report_change(problem, model.observe(values, moved[:, None])[:, 0], here) / size
        for entry in range(f):
            size = STEP * model.force_width[entry]
            pushed = force.copy()
            pushed[..., entry] += size
            push[..., entry] = model.difference(model.advance(values, before, inputs, pushed)[:, 0], after) / size
        tangent = Tangent(transition, push, reading)
        return Linearised(path, tangent, _slope(problem, tangent))


def _slope(problem: Problem, tangent: Tangent) -> Floats:
    """Change (W, K, L) of the prediction with each free number."""
    windows, steps, n, f = *tangent.push.shape[:3], tangent.push.shape[3]
    start = np.zeros((n, n + problem.bins * f))
    start[:, :n] = np.eye(n)
    pushes = np.zeros((windows, steps, n, n + problem.bins * f))
    for step in range(steps):
        first = n + f * (step // problem.steps_per_bin)
        pushes[:, step, :, first : first + f] = tangent.push[:, step]
    return respond(problem, tangent, start, pushes)


def respond(problem: Problem, tangent: Tangent, start: Floats, steps: Floats, direct: Floats | None = None) -> Floats:
    """Change (W, K, N) of the prediction under ``N`` small changes at once, in units of the noise.

    Args:
        problem: whose windows they are.
        tangent: of a path.
        start: (n, N) change of the start.
        steps: (W, S, n, N) change of the state at the end of each step.
        direct: (W, S + 1, C, N) change of the reports beside that of the states.
    """
    count, length, n, columns = steps.shape
    history = np.empty((count, length + 1, n, columns))
    history[:, 0] = start
    for k in range(length):
        history[:, k + 1] = tangent.transition[:, k] @ history[:, k] + steps[:, k]
    reported = tangent.reading @ history
    if direct is not None:
        reported += direct
    sampled = problem.windows.at_samples(np.moveaxis(reported, -1, 1))
    return problem.windows.weighed(np.moveaxis(sampled, 1, -1))


def sensitivities(problem: Problem, linear: Linearised, rows: Floats) -> Floats:
    """Change (W, K, R) of the prediction where parameters are ``rows`` (R, P) in place of those of the path."""
    model, path = problem.model, linear.path
    inputs, force, values = problem.windows.inputs, problem.held(path.bins), path.values[None]
    with np.errstate(over="ignore", invalid="ignore"):
        changed = model.advance(rows, path.states[:, :-1], inputs, force)
        beyond = model.difference(changed, model.advance(values, path.states[:, :-1], inputs, force))
        seen = np.broadcast_to(path.states[:, None], (len(path.states), len(rows), *path.states.shape[1:]))
        direct = _report_change(problem, model.observe(rows, seen), model.observe(values, path.states[:, None]))
        start = np.zeros((problem.states, len(rows)))
        return respond(problem, linear.tangent, start, np.moveaxis(beyond, 1, -1), np.moveaxis(direct, 1, -1))


def reduced_quadratic(problem: Problem, linear: Linearised, columns: Floats, precision: Floats) -> Quadratic:
    """The reduced quadratic in the amounts of ``columns`` (W, K, N), about a path.

    ``precision`` (L, L) is that of the free numbers. Windows whose simulation diverged say nothing.
    """
    away = problem.away(linear.path.start, linear.path.bins)
    both = np.concatenate([linear.path.residual[..., None], columns], axis=2)
    finite = np.isfinite(linear.slope).all((1, 2)) & np.isfinite(both).all((1, 2))
    both, slope, away = both[finite], linear.slope[finite], away[finite]
    pull = slope.swapaxes(1, 2) @ both
    pull[..., 0] -= away @ precision
    moved = np.linalg.solve(slope.swapaxes(1, 2) @ slope + precision, pull)
    # Products of what is left are positive whatever is rounded; products less what was absorbed may not be.
    left = both - slope @ moved
    moved[..., 0] += away
    paid = np.linalg.cholesky(precision).T @ moved  # by the free numbers, to their prior
    flat = np.concatenate([left, paid], axis=1).reshape(-1, both.shape[-1])
    whole = flat.T @ flat
    return Quadratic(whole[0, 0], whole[0, 1:], whole[1:, 1:])


def best_free_numbers(
    problem: Problem, linear: Linearised, changed: Floats, precision: Floats, damping: Floats | float = 0.0
) -> tuple[Floats, Floats]:
    """Starts (W, n) and bins (W, B, f) that fit best where the prediction changes by ``changed`` (W, K).

    ``damping`` (W,) multiplies the diagonal, as Levenberg and Marquardt have it.
    """
    path, slope = linear.path, linear.slope
    held = problem.away(path.start, path.bins) @ precision
    pull = (slope.swapaxes(1, 2) @ (path.residual - changed)[..., None])[..., 0] - held
    gram = slope.swapaxes(1, 2) @ slope + precision
    diagonal = np.einsum("wll->wl", gram) * np.reshape(damping, (-1, 1))
    gram = gram + diagonal[..., None] * np.eye(gram.shape[-1])
    finite = np.isfinite(gram).all((1, 2)) & np.isfinite(pull).all(1)
    move = np.zeros_like(pull)
    move[finite] = np.linalg.solve(gram[finite], pull[finite][..., None])[..., 0]
    start, bins = move[:, : problem.states], move[:, problem.states :]
    return path.start + start, path.bins + bins.reshape(path.bins.shape)


def _report_change(problem: Problem, after: Floats, before: Floats) -> Floats:
    change = after - before
    for column, channel in enumerate(problem.windows.channels):
        if channel.angular:
            change[..., column] = wrapped(change[..., column])
    return change
