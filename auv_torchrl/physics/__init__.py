"""6-DOF physics of an underwater vehicle, batch first, on numpy or torch."""

from typing import TYPE_CHECKING

from auv_torchrl.late import late

if TYPE_CHECKING:
    from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients, prepare
    from auv_torchrl.physics.pace import CONTROL_DT, SUBSTEPS
    from auv_torchrl.physics.step import State, control_step, rest_state

__all__ = ["CONTROL_DT", "SUBSTEPS", "ActiveTerms", "Coefficients", "State", "control_step", "prepare", "rest_state"]

__getattr__ = late(
    __name__,
    {
        "coefficients": "ActiveTerms Coefficients prepare",
        "pace": "CONTROL_DT SUBSTEPS",
        "step": "State control_step rest_state",
    },
)
