"""Where a vehicle whose thrust comes late will be when the next command arrives (a Smith predictor)."""

from typing import Any

import numpy as np

from auv_torchrl.adaptation.motion import SourceMotion
from auv_torchrl.adaptation.sensing import VELOCITY, turned
from auv_torchrl.adaptation.timing import ActuatorTiming
from auv_torchrl.physics.kinematics import euler_angles, quaternion_from_euler, quaternion_product

Array = Any


def look_ahead(
    motion: SourceMotion, state: Array, time: Array, timing: ActuatorTiming, effectiveness: Array, constant: Array
) -> tuple[Array, Array]:
    """States (N, 13) and times (N,) that are expected when thrust has followed; the same where it is not late.

    Args:
        motion: of the source vehicle; roll, pitch and their rates are taken to stay as they are.
        state: (N, 13) measured position, quaternion and velocity; rows with other than numbers are left as they are.
        time: (N,) s since the episodes began.
        timing: of the N vehicles, with the thrusts that are on their way.
        effectiveness: (N, 4, n) wrench per share.
        constant: (N, 4) wrench that acts without the thrusters.
    """
    rows = (timing.late_s() > 0).nonzero()[0]
    rows = rows[np.isfinite(state[rows]).all(-1)]
    if not len(rows):
        return state, time
    state, time = state.copy(), time.copy()
    steps = np.ceil(timing.late_s()[rows] / motion.control_dt - 1e-9).astype(int)
    velocity, position, turn = state[rows][:, VELOCITY], state[rows, :3], np.zeros(len(rows))
    heading = euler_angles(state[rows, 3:7])[2]
    for k, thrust in enumerate(timing.coming(rows, int(steps.max()))):
        wrench = (effectiveness[rows] @ thrust[..., None])[..., 0] + constant[rows]
        moved, reached = motion.advance(velocity, wrench)
        going = (k < steps)[:, None]
        moved, velocity = np.where(going, moved, 0.0), np.where(going, reached, velocity)
        position = position + turned(moved[:, :3], heading + turn + moved[:, 3] / 2)
        turn = turn + moved[:, 3]
    level = np.zeros_like(turn)
    state[rows, :3] = position
    state[rows, 3:7] = quaternion_product(quaternion_from_euler(level, level, turn), state[rows, 3:7])
    state[np.ix_(rows, VELOCITY)] = velocity
    time[rows] += steps * motion.control_dt
    return state, time
