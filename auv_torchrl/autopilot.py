"""Which output of ArduPilot drives which motor: https://ardupilot.org/sub/docs/parameters.html#servo1-function."""

import re

_FIRST_MOTOR = 33  # value of SERVOk_FUNCTION for motor 1, up to 40 for motor 8
_NINTH_MOTOR = 82  # for motor 9, up to 85 for motor 12
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
