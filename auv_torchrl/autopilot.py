"""Which output of ArduPilot drives which motor: https://ardupilot.org/sub/docs/parameters.html#servo1-function.

And what each motor of ArduSub's frames does for forward, lateral, down and yaw.
"""

import re
from collections.abc import Sequence

_FIRST_MOTOR = 33  # value of SERVOk_FUNCTION for motor 1, up to 40 for motor 8
_NINTH_MOTOR = 82  # for motor 9, up to 85 for motor 12
_LEVEL = ((-1, 1, 0, 1), (-1, -1, 0, -1), (1, 1, 0, -1), (1, -1, 0, 1))
_VERTICAL = (0, 0, 1, 0)
FRAMES = {  # by FRAME_CONFIG: name, and a row for each motor; libraries/AP_Motors/AP_Motors6DOF.cpp
    1: ("vectored", (*_LEVEL, _VERTICAL, _VERTICAL)),
    2: ("vectored_6dof", (*_LEVEL, _VERTICAL, _VERTICAL, _VERTICAL, _VERTICAL)),
}
_SAME = 1e-6
_FUNCTION = re.compile(r"SERVO[0-9]+_FUNCTION")


def is_function(parameter: str) -> bool:
    """Whether a parameter says what an output drives."""
    return _FUNCTION.fullmatch(parameter) is not None


def motor_of(function: float) -> int:
    """The motor that an output of this function drives; 0 for none, and where the function is no whole number."""
    if function % 1 != 0:
        return 0
    if _FIRST_MOTOR <= function < _FIRST_MOTOR + 8:
        return int(function) - _FIRST_MOTOR + 1
    return int(function) - _NINTH_MOTOR + 9 if _NINTH_MOTOR <= function < _NINTH_MOTOR + 4 else 0


def function_of(motor: int) -> int:
    """The function of the output that drives this motor."""
    return _FIRST_MOTOR + motor - 1 if motor <= 8 else _NINTH_MOTOR + motor - 9


def frame_scale(frame: int, mixer: Sequence[Sequence[float]]) -> tuple[float, ...] | None:
    """(4,) by how much a mixer (n, 4) moves each motor further than a frame does; None where it is not that frame's.

    The columns of the mixer are surge, sway, heave and yaw.
    """
    _, factors = FRAMES[frame]
    if len(mixer) != len(factors):
        return None
    scales = []
    for channel, column in enumerate(zip(*mixer, strict=True)):
        own = [row[channel] for row in factors]
        scale = sum(a * b for a, b in zip(column, own, strict=True)) / sum(b * b for b in own)
        if not scale > 0 or any(abs(a - scale * b) > _SAME for a, b in zip(column, own, strict=True)):
            return None
        scales.append(float(scale))
    return tuple(scales)
