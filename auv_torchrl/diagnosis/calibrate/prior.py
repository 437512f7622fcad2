"""What a vehicle's file may have wrong of several numbers together."""

from collections.abc import Sequence

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import SHARED_BY_THRUSTERS
from auv_torchrl.effects import get_effect


def shared_covariance(members: Sequence[tuple[str, str]], width: Floats) -> Floats:
    """Covariance (k, k) of what a file has wrong of ``members``, (effect, parameter), each within ``width`` (k,).

    What makes all members of a family differ from flight to flight, as volts do all thrusters, is also what a file has
    wrong of all of them. Else a fit would rather bend the curve of thrust than pay once for each thruster, and go wrong
    where commands are larger than those that it has seen.
    """
    families = [_varies_with(*member) for member in members]
    same = np.array([[one is not None and one == other for other in families] for one in families])
    return np.outer(width, width) * np.where(np.eye(len(width), dtype=bool), 1.0, SHARED_BY_THRUSTERS * same)


def _varies_with(effect: str, member: str) -> tuple[str, str] | None:
    """The effect and its parameter where all members of that differ together from flight to flight."""
    for p in get_effect(effect).parameters:
        if p.varies and p.over is not None and member.startswith(f"{p.name}_"):
            return effect, p.name
    return None
