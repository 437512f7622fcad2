"""The MuJoCo simulator as a plant: it takes commands per thruster and influences from outside the library."""

from collections.abc import Callable, Mapping

import numpy as np

from auv_torchrl.effects import get_effect
from auv_torchrl.effects.body import per_dof
from auv_torchrl.physics import Coefficients
from auv_torchrl.physics.kinematics import euler_angles, quaternion_from_euler
from auv_torchrl.simulator.mujoco import MujocoSimulator
from auv_torchrl.vehicle import CONTROLLED_INDEX, Vehicle
from benchmarks.blind.flights.plant import Influences, Motion, Reported, Slack

_FAR = 1e4  # m, where the tether that stands for a constant earth-frame force is anchored


class MujocoPlant:
    """A batch of vehicles in one MuJoCo model."""

    def __init__(self, vehicle: Vehicle, rows: int, control_dt: float) -> None:
        """Make ``rows`` vehicles like the nominal one."""
        self.rows = rows
        self.simulator = MujocoSimulator(vehicle.expand(rows), control_dt)

    def loosen(self, rows: slice, slack: Slack) -> None:
        """Multiply gains, drags and inertias of some vehicles by factors."""
        self._replace(rows, lambda vehicles: loosened(vehicles, slack))

    def change(self, rows: slice, effect: str, values: Mapping[str, float]) -> None:
        """Give some vehicles an effect of the library, before or during a flight."""
        self._replace(rows, lambda vehicles: get_effect(effect).apply(vehicles, values))

    def _replace(self, rows: slice, change: Callable[[Vehicle], Vehicle]) -> None:
        part = self.simulator.vehicles[rows]
        self.simulator.replace(np.arange(self.rows)[rows], change(part))

    def reset(self, position: np.ndarray, yaw: np.ndarray, velocity: np.ndarray) -> None:
        """Start at (rows, 3) m, (rows,) rad, with u, v, w, r (rows, 4) in m/s and rad/s and silent thrusters."""
        zero, moving = np.zeros(self.rows), np.zeros((self.rows, 6))
        moving[:, list(CONTROLLED_INDEX)] = velocity
        self.simulator.place(np.arange(self.rows), position, quaternion_from_euler(zero, zero, yaw), moving)

    def step(self, commands: np.ndarray, influences: Influences) -> None:
        """Hold commands (rows, n) for one control step."""
        self.simulator.step(commands, acting=self._influenced(influences))

    def _influenced(self, influences: Influences) -> Coefficients:
        """Write the influences as coefficients; an earth-frame force is the pull of a very long tether.

        Raises:
            ValueError: for such a force on a vehicle that has a tether.
        """
        c = self.simulator.coefficients
        changed: dict[str, np.ndarray] = {
            "allocation": c.allocation * influences.thrust_factor[:, None, :],
            "current": c.current + influences.current,
        }
        size = np.linalg.norm(influences.earth_force, axis=1)
        pulled = size > 0
        if pulled.any():
            if (c.tether_stiffness[pulled] != 0).any():
                raise ValueError("a vehicle with a tether cannot also have a force in the earth frame")
            toward = influences.earth_force / np.where(pulled, size, 1.0)[:, None]
            anchor = self.simulator.state.position + _FAR * toward
            changed["tether_anchor"] = np.where(pulled[:, None], anchor, c.tether_anchor)
            changed["tether_stiffness"] = np.where(pulled, size / _FAR, c.tether_stiffness)
        return c._replace(**changed)

    def reported(self) -> Reported:
        """What noiseless sensors report now: late and with a heading bias where the vehicle has them."""
        seen = self.simulator.report()
        return Reported(seen.pose, seen.velocity)

    def true_motion(self) -> Motion:
        """How the vehicles truly move now."""
        state = self.simulator.state
        return Motion(state.position, euler_angles(state.quaternion)[2], state.velocity)


def loosened(vehicle: Vehicle, slack: Slack) -> Vehicle:
    """The vehicle with factors on its gains, drags and inertias."""
    gain, linear, quadratic, mass = map(np.asarray, slack)
    return vehicle.replace(
        gain=vehicle.gain * gain,
        linear_drag=vehicle.linear_drag * per_dof(linear)[:, None],
        quadratic_drag=vehicle.quadratic_drag * per_dof(quadratic),
        mass_scale=vehicle.mass_scale * per_dof(mass),
    )
