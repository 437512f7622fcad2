"""6-DOF physics of an underwater vehicle, batch first, on numpy or torch."""

from typing import TYPE_CHECKING

from auv_torchrl.late import late

if TYPE_CHECKING:
    from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients, prepare
    from auv_torchrl.physics.kernel import Advance, ByRow, Forces, RowFunction, Steps, Targets, rates
    from auv_torchrl.physics.pace import CONTROL_DT, SUBSTEPS
    from auv_torchrl.physics.step import State, control_step, rest_state

__all__ = [
    "CONTROL_DT", "SUBSTEPS", "ActiveTerms", "Advance", "ByRow", "Coefficients", "Forces", "RowFunction", "State",
    "Steps", "Targets", "control_step", "prepare", "rates", "rest_state",
]  # fmt: skip

__getattr__ = late(
    __name__,
    {
        "coefficients": "ActiveTerms Coefficients prepare",
        "kernel": "Advance ByRow Forces RowFunction Steps Targets rates",  # the border: nobody else imports it
        "pace": "CONTROL_DT SUBSTEPS",
        "step": "State control_step rest_state",
    },
)
