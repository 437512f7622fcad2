"""How much of the gap any map of the commands could close: whether adapting the controls will help."""

import numpy as np

from auv_torchrl.diagnosis.identify.judged import Base
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.force import marks
from auv_torchrl.diagnosis.motion.reduce import reduce
from auv_torchrl.diagnosis.thresholds import NOTHING_TO_MAP
from auv_torchrl.physics import prepare


def input_mappable(problem: Problem, follow: Base) -> float | None:
    """Share of the gap that a force affine in the commands closes, best fit; None without a gap."""
    windows, layout = problem.windows, problem.layout
    grid = np.minimum(windows.start[:, None] + np.arange(windows.steps), windows.commands.shape[1] - 1)
    commands = windows.commands[windows.episode[:, None], grid]  # (W, S, n)
    inputs = np.concatenate([commands, np.ones_like(commands[..., :1])], axis=-1)
    forces = np.zeros((len(windows), inputs.shape[-1] * len(layout.dof), windows.steps, 6))
    for column, (j, d) in enumerate(np.ndindex(inputs.shape[-1], len(layout.dof))):
        forces[:, column, :, layout.dof[d]] = inputs[..., j]
    columns = marks(windows, prepare(follow.vehicle).numpy(), layout, follow.state, forces)
    q = reduce(windows, layout, problem.freedom(follow.state.slope), follow.state, columns).windows(problem.followed)
    if q.constant <= NOTHING_TO_MAP * q.numbers:
        return None
    best = q.constant - float(q.b @ np.linalg.lstsq(q.A, q.b, rcond=1e-10)[0])
    return float(np.clip((q.constant - best) / (q.constant - q.numbers), 0.0, 1.0))
