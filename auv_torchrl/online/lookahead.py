"""Where a vehicle whose thrust comes late will be when the next command arrives (a Smith predictor)."""

from typing import Any

import numpy as np

from auv_torchrl.online.motion import SourceMotion
from auv_torchrl.online.timing import ActuatorTiming
from auv_torchrl.physics.kinematics import quaternion_from_euler
from auv_torchrl.tasks import Task
from auv_torchrl.vehicle import CONTROLLED_INDEX

Array = Any
_TILT = ("roll_rate", "pitch_rate", "down_x", "down_y")  # not predicted


class Lookahead:
    """Replaces the observation of vehicles with late thrust by the one expected when thrust has followed.

    Args:
        task: how a state is observed.
        motion: of the source vehicle.
    """

    def __init__(self, task: Task, motion: SourceMotion):
        self.task, self.motion = task, motion
        names = task.observation_names
        self._replaced = [i for i, name in enumerate(names) if name not in _TILT]

    def __call__(
        self, observation: Array, raw: Array, timing: ActuatorTiming, effectiveness: Array, constant: Array, time: Array
    ) -> Array:
        """Observations (N, d) for the policy.

        Args:
            observation: (N, d) as measured.
            raw: (N, 8) velocity, position and heading in it; rows with other than numbers are left as they are.
            timing: of the N vehicles, with the thrusts that are on their way.
            effectiveness: (N, 4, n) wrench per share.
            constant: (N, 4) wrench that acts without the thrusters.
            time: (N,) s since the episodes began.
        """
        rows = (timing.late_s() > 0).nonzero()[0]
        rows = rows[np.isfinite(raw[rows]).all(-1)]
        if not len(rows):
            return observation
        observation = observation.copy()
        steps = np.ceil(timing.late_s()[rows] / self.motion.control_dt - 1e-9).astype(int)
        thrusts = timing.coming(rows, int(steps.max()))
        velocity, position, heading = raw[rows, :4], raw[rows, 4:7], raw[rows, 7]
        for k, thrust in enumerate(thrusts):
            wrench = (effectiveness[rows] @ thrust[..., None])[..., 0] + constant[rows]
            moved, reached = self.motion.advance(velocity, wrench)
            going = (k < steps)[:, None]
            moved, velocity = np.where(going, moved, 0.0), np.where(going, reached, velocity)
            middle = heading + moved[:, 3] / 2
            c, s = np.cos(middle), np.sin(middle)
            x, y = moved[:, 0], moved[:, 1]
            position = position + np.stack((c * x - s * y, s * x + c * y, moved[:, 2]), axis=-1)
            heading = heading + moved[:, 3]
        six = np.zeros((len(rows), 6))
        six[:, list(CONTROLLED_INDEX)] = velocity
        level = np.zeros_like(heading)
        attitude = quaternion_from_euler(level, level, heading)
        expected = self.task.observe(position, attitude, six, time[rows] + steps * self.motion.control_dt)
        observation[np.ix_(rows, self._replaced)] = expected[:, self._replaced]
        return observation
