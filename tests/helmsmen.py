"""Who steers vehicles in tests without a training."""

import torch
from tensordict.nn import TensorDictModule

from auv_torchrl.tasks import Cruise

CRUISE = Cruise()


def _turning(task, seen_error, heading):
    """Yaw rate, less that of the way, which the observed error of the turning has beside the turn to the heading."""
    return (task.turn_rate or 1.0) * seen_error + task.turning_towards(-heading)


def helmsman_of_vessel(turn=0.8, damping=0.5, task=CRUISE):
    """Proportional on heading and speed, with damping in yaw; reads the observation of a surface vessel."""

    def steer(seen):
        heading = torch.atan2(seen[..., 3], seen[..., 4])
        surge = 0.7 - 0.5 * seen[..., 0]
        yaw = turn * heading - damping * _turning(task, seen[..., 2], heading)
        return torch.stack((surge, yaw), dim=-1).clamp(-1.0, 1.0)

    return TensorDictModule(steer, in_keys=["observation"], out_keys=["action"])


def helmsman_of_torpedo(task):
    """Heading by the rudders, depth by the pitch, pitch by the stern planes."""

    def steer(seen):
        named = dict(zip(task.observation_names, seen.unbind(-1), strict=True))
        heading = torch.atan2(named["heading_error_sin"], named["heading_error_cos"])
        deep = torch.atanh(named["far_z"].clamp(-0.999, 0.999))
        pitch = (-0.4 * deep - 0.024).clamp(
            -0.3, 0.3
        )  # nose down to go down; it floats, and its hull and its tail push down
        surge = 0.6 - 0.5 * named["surge_speed_error"]
        stern = 0.34 + 5.0 * (pitch + named["down_x"]) - 2.0 * named["pitch_rate"]
        rudder = 8.0 * heading - 4.0 * _turning(task, named["turning_error"], heading)
        return torch.stack((surge, stern, rudder), dim=-1).clamp(-1.0, 1.0)

    return TensorDictModule(steer, in_keys=["observation"], out_keys=["action"])
