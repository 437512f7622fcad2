"""The origin of a gap that no effect explains: commands, motion, surroundings, and which thruster.

Forces of many shapes, grouped by origin, are fitted to some windows and predict others. The origin that predicts most
takes its prediction as its share of the gap, the next one takes what it adds, and so on: motion follows the commands,
so that one origin can stand in for another a little. No origin takes more than it predicts alone: commands, velocities
and accelerations together are the equation of motion and would explain any gap.

The share of the gap that a map of the commands could close says whether adapting the controls will help.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from auv_torchrl.diagnosis.identify.paths import WindowPath
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.force import responses
from auv_torchrl.diagnosis.motion.reduce import Parts, Quadratic, reduce
from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.motion.windows import Floats, Windows, chunks
from auv_torchrl.diagnosis.thresholds import LEAST_PREDICTED, NOTHING_TO_MAP, REACH_WIDTH, SAME_COMMANDS, WORTHLESS
from auv_torchrl.effects import Origin
from auv_torchrl.physics import ActiveTerms
from auv_torchrl.physics.kinematics import rotation_matrix
from auv_torchrl.physics.pushes import wrench_per_share

FOLDS = 4
RESPONSES_BYTES = 8 << 20  # of the responses to all forces; five such arrays are in use at once
SOFT = 0.05  # of the full command, over which a sign changes
EARLIER = (1, 2, 4, 8, 16)  # grid steps between a command and a force that it may leave behind
STICTIONS = (0.05, 0.1, 0.2)  # of the full command, by which it must change before a force follows


@DIVERGING
def attribute(problem: Problem, path: WindowPath) -> tuple[dict[str, float], dict[str, float]]:
    """Shares of the gap by origin and by thruster, each summing to 1; both empty where nothing predicts the gap.

    The second is empty too unless most of the gap comes from the thrusters.
    """
    groups = forces(problem, path)
    names = list(groups)
    owner = np.repeat(np.arange(len(names)), [groups[name].shape[1] for name in names])
    columns = np.concatenate([groups.pop(name) for name in names], axis=1)
    known = problem.followed & np.isfinite(columns).all((1, 2, 3))  # a window that diverges shows no force
    if known.sum() < FOLDS:
        return {}, {}
    columns = np.where(known[:, None, None, None], columns, 0.0)
    size = np.sqrt(((columns[..., problem.layout.dof] / problem.wide) ** 2).sum(-1).mean((0, 2)))
    kept = size > 1e-6
    owner, columns = owner[kept], columns[:, kept] / size[kept][None, :, None, None]
    folds = _folds(problem, path, columns, known)

    def predicted(players: Sequence[int]) -> float:
        return _predicted(folds, np.flatnonzero(np.isin(owner, list(players))))

    thrusters = [i for i, name in enumerate(names) if isinstance(name, int)]
    others = [i for i in range(len(names)) if i not in thrusters]
    shares = in_turn(predicted, [thrusters, *([i] for i in others)])
    if not shares.sum() > LEAST_PREDICTED:
        return {}, {}
    origin = {kind.value: 0.0 for kind in Origin}
    origin[Origin.ACTUATION] = float(shares[0])
    origin |= {str(names[i]): float(share) for i, share in zip(others, shares[1:], strict=True)}
    if not shares[0] > shares.sum() / 2:
        return _whole(origin), {}
    by_thruster = in_turn(predicted, [[i] for i in thrusters])
    return _whole(origin), _whole(
        {str(names[i]): float(share) for i, share in zip(thrusters, by_thruster, strict=True)}
    )


def forces(problem: Problem, path: WindowPath) -> dict[int | Origin, Floats]:
    """Forces (W, k, S, 6) in N and N m along the measured motion: by thruster (from 1), and by the other origins."""
    windows, motion = problem.windows, path.motion
    command = on_grid(windows, windows.commands)
    earlier = [on_grid(windows, windows.commands, ago) for ago in EARLIER]
    sticking = [on_grid(windows, stuck(windows.commands, width)) for width in STICTIONS]
    smooth = (command, command * np.abs(command), command / np.hypot(command, SOFT), np.abs(command))
    shapes = (*smooth, *earlier, *sticking)
    c = path.coefficients
    terms = ActiveTerms.of(c)
    each = c.rows((0, None, None)) if terms.servos else c  # at each speed on the way
    push = wrench_per_share(each, terms, motion[..., 7])  # (W, S, 6, n), of thrusters alone (1, 6, n)
    found: dict[int | Origin, Floats] = {}
    for i in range(command.shape[-1]):
        found[i + 1] = np.stack([shape[..., i, None] * push[..., i] for shape in shapes], axis=1)
    velocity = motion[..., 7:]
    rate = np.gradient(velocity, windows.dt, axis=1)
    turning = np.zeros_like(velocity)
    turning[..., 0], turning[..., 1] = -velocity[..., 1] * velocity[..., 5], velocity[..., 0] * velocity[..., 5]
    dof = problem.layout.dof
    found[Origin.BODY] = np.concatenate([_by_dof(rate, dof), _by_dof(turning, np.array([0, 1]))], axis=1)
    to_body = rotation_matrix(motion[..., 3:7]).swapaxes(-1, -2)  # its columns are earth's axes seen from the body
    linear = np.diagonal(c.linear_drag[0])
    drift = np.zeros((len(windows), 3, windows.steps, 6))  # drag on a slow current along each axis of the earth
    drift[..., :3] = np.moveaxis(to_body, -1, 1)
    drift *= (linear + 2 * c.quadratic_drag[0] * np.abs(velocity))[:, None]
    drag = [_by_dof(velocity, dof), _by_dof(velocity * np.abs(velocity), dof)]
    found[Origin.FLOW] = np.concatenate([*drag, drift], axis=1)
    place, time = motion[..., :3], windows.time[:, None] + np.arange(windows.steps) * windows.dt
    pulls = []
    for axis in range(3):
        for growing in (np.ones_like(time), place[..., axis], time / max(float(time.max()), 1.0)):
            pull = np.zeros_like(velocity)
            pull[..., :3] = to_body[..., axis] * growing[..., None]
            pulls.append(pull)
    found[Origin.EXTERNAL] = np.stack(pulls, axis=1)
    return found


def on_grid(windows: Windows, commands: Floats, ago: int = 0) -> Floats:
    """Commands (E, T, n) at the grid steps of each window, or some steps ``ago``, (W, S, n); the last one lasts."""
    grid = np.minimum(windows.start[:, None] + np.arange(windows.steps), commands.shape[1] - 1)
    return commands[windows.episode[:, None], np.maximum(grid - ago, 0)]


def input_mappable(problem: Problem, follow: WindowPath) -> float | None:
    """Share of the gap that a force affine in the commands closes, best fit; None without a gap."""
    windows, layout = problem.windows, problem.layout
    commands = on_grid(windows, windows.commands)
    inputs = np.concatenate([commands, np.ones_like(commands[..., :1])], axis=-1)
    forces = np.zeros((len(windows), inputs.shape[-1] * len(layout.dof), windows.steps, 6))
    for column, (j, d) in enumerate(np.ndindex(inputs.shape[-1], len(layout.dof))):
        forces[:, column, :, layout.dof[d]] = inputs[..., j]
    (q,) = quadratics(problem, follow, forces, [problem.followed])
    if q.constant <= NOTHING_TO_MAP * q.numbers:
        return None
    best = q.constant - float(q.b @ np.linalg.lstsq(q.A, q.b, rcond=1e-10)[0])
    return float(np.clip((q.constant - best) / (q.constant - q.numbers), 0.0, 1.0))


def in_turn(value: Callable[[Sequence[int]], float], teams: Sequence[Sequence[int]]) -> Floats:
    """What each team adds to ``value``, the best first, at most its value alone; equal teams share."""
    shares, inside, left, reached = np.zeros(len(teams)), [], list(range(len(teams))), 0.0
    alone = np.maximum([value(team) for team in teams], 0.0)
    while left:
        added = np.array([value([*inside, *teams[team]]) - reached for team in left])
        if not added.max() > WORTHLESS:
            break
        equal = [team for team, worth in zip(left, added, strict=True) if worth > (1 - SAME_COMMANDS) * added.max()]
        inside += [member for team in equal for member in teams[team]]
        gained = value(inside) - reached
        shares[equal] = np.minimum(gained / len(equal), alone[equal])
        reached += gained
        left = [team for team in left if team not in equal]
    return shares


def stuck(commands: Floats, width: float) -> Floats:
    """Commands (E, T, n) that change only once they differ by more than ``width`` from the one held."""
    held = commands.copy()
    for step in range(1, commands.shape[1]):
        moved = np.abs(commands[:, step] - held[:, step - 1]) > width
        held[:, step] = np.where(moved, commands[:, step], held[:, step - 1])
    return held


def _by_dof(motion: Floats, dof: np.ndarray) -> Floats:
    """Motion (W, S, 6) as one force per degree of freedom (W, D, S, 6)."""
    return np.stack([motion * (np.arange(6) == d) for d in dof], axis=1)


def _folds(
    problem: Problem, path: WindowPath, forces: Floats, followed: np.ndarray
) -> list[tuple[Quadratic, Quadratic]]:
    """Quadratics of forces (W, N, S, 6) on the windows to fit to and on those to predict, for each fold."""
    turn = np.arange(len(followed)) % FOLDS
    tests = quadratics(problem, path, forces, [followed & (turn == k) for k in range(FOLDS)])
    others = [[tests[j] for j in range(FOLDS) if j != k] for k in range(FOLDS)]
    return [(sum(rest[1:], rest[0]), test) for rest, test in zip(others, tests, strict=True)]


def quadratics(problem: Problem, path: WindowPath, forces: Floats, chosen: list[np.ndarray]) -> list[Quadratic]:
    """Chi-square of amounts of forces (W, N, S, 6) on some windows each, masks (W,)."""
    whole, numbers = [np.zeros((1, 1)) for _ in chosen], 0.0
    for some, parts in in_pieces(problem, path, forces.shape[1], lambda some: forces[some]):
        whole = [sums + parts.pooled(mask[some]) for sums, mask in zip(whole, chosen, strict=True)]
        numbers += parts.numbers
    return [
        Quadratic(float(sums[0, 0]), sums[0, 1:], sums[1:, 1:], round(round(numbers) * mask.mean()))
        for sums, mask in zip(whole, chosen, strict=True)
    ]


def in_pieces(
    problem: Problem, path: WindowPath, count: int, forces: Callable[[slice], Floats]
) -> Iterator[tuple[slice, Parts]]:
    """The responses to ``count`` forces, reduced piece by piece: those on all windows would fill the memory.

    ``forces`` gives those on some windows, (w, count, S, 6).
    """
    freedom, each = problem.freedom(path.state), 8 * path.state.residual[0].size * count
    for some in chunks(len(problem.windows), each, RESPONSES_BYTES):
        windows, state = problem.windows.subset(some), path.state.rows(some)
        shown = responses(windows, path.coefficients, problem.layout, state, forces(some))
        yield some, reduce(windows, problem.layout, freedom.rows(some), state, shown)


def _predicted(folds: list[tuple[Quadratic, Quadratic]], chosen: np.ndarray) -> float:
    """Share of the gap that some columns predict of windows that they were not fitted to."""
    square = np.ix_(chosen, chosen)
    closed = gap = 0.0
    for fit, test in folds:
        a = np.linalg.solve(fit.A[square] + np.eye(len(chosen)) / REACH_WIDTH**2, fit.b[chosen])
        closed += float(2 * test.b[chosen] @ a - a @ test.A[square] @ a)
        gap += test.constant - test.numbers
    return closed / max(gap, 1e-9)


def _whole(shares: dict[str, float]) -> dict[str, float]:
    total = sum(shares.values())
    return {name: share / total for name, share in shares.items()} if total > 0 else {}
