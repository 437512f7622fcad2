"""6-DOF physics of an underwater vehicle, batch first, on numpy or torch."""

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients, prepare
from auv_torchrl.physics.step import CONTROL_DT, SUBSTEPS, State, control_step, rest_state

__all__ = ["CONTROL_DT", "SUBSTEPS", "ActiveTerms", "Coefficients", "State", "control_step", "prepare", "rest_state"]
