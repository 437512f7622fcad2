"""The MuJoCo fleet as a plant: it takes commands per thruster and influences from outside the library."""

from collections.abc import Mapping

import numpy as np
import torch

from auv_torchrl.blind.plant import Influences, Reported, Slack
from auv_torchrl.effects import get_effect
from auv_torchrl.effects.body import per_dof
from auv_torchrl.envs.mujoco_fleet import MujocoFleet
from auv_torchrl.envs.regulation import RegulationTask
from auv_torchrl.physics import ActiveTerms, Coefficients, State, prepare, rest_state
from auv_torchrl.physics.kinematics import euler_angles, quaternion_from_euler, rotation_matrix
from auv_torchrl.physics.step import memory_length, push
from auv_torchrl.sensors import measured_pose, measured_velocity
from auv_torchrl.vehicle import CONTROLLED_INDEX, Vehicle

_FAR = 1e4  # m, where the tether that stands for a constant earth-frame force is anchored


class Bodies(MujocoFleet):
    """The fleet without its task: whoever calls it says what each vehicle is and is commanded."""

    def carry(self, coefficients: Coefficients, terms: ActiveTerms, state: State, commands: np.ndarray) -> State:
        """The state one control step later, in 6 degrees of freedom and MuJoCo's own substeps."""
        self._coefficients, self._terms, self._state = coefficients, terms, state
        return self._advance(commands)


class MujocoPlant:
    """A batch of vehicles in one MuJoCo model."""

    def __init__(self, vehicle: Vehicle, rows: int, control_dt: float) -> None:
        """Make ``rows`` vehicles like the nominal one."""
        self.rows, self.control_dt, self.thrusters = rows, control_dt, vehicle.thrusters
        self.vehicles = vehicle.expand(rows).clone()
        self.coefficients = prepare(self.vehicles).numpy()
        self.bodies = Bodies(vehicle, RegulationTask(control_dt=control_dt), rows, seed=0)

    def loosen(self, rows: slice, slack: Slack) -> None:
        """Multiply gains, drags and inertias of some vehicles by factors."""
        self._replace(rows, loosened(self._vehicles(rows), slack))

    def change(self, rows: slice, effect: str, values: Mapping[str, float]) -> None:
        """Give some vehicles an effect of the library; one with a delay only before the flight."""
        self._replace(rows, get_effect(effect).apply(self._vehicles(rows), values))

    def _vehicles(self, rows: slice) -> Vehicle:
        part = self.vehicles[rows]
        assert isinstance(part, Vehicle)
        return part

    def _replace(self, rows: slice, vehicles: Vehicle) -> None:
        self.vehicles[rows] = vehicles
        self.coefficients = prepare(self.vehicles).numpy()

    def reset(self, position: np.ndarray, yaw: np.ndarray, velocity: np.ndarray) -> None:
        """Start at (rows, 3) m, (rows,) rad, with u, v, w, r (rows, 4) in m/s and rad/s and silent thrusters."""
        zero = np.zeros(self.rows)
        memory = memory_length(float(self.coefficients.delay.max()), self.control_dt)
        quaternion = quaternion_from_euler(zero, zero, yaw)
        moving = np.zeros((self.rows, 6))
        moving[:, list(CONTROLLED_INDEX)] = velocity
        self.state = rest_state(position, quaternion, moving, self.thrusters, memory)
        length = memory_length(float(self.coefficients.pose_delay.max()), self.control_dt)
        self.poses = np.repeat(self._pose()[:, None], length, axis=1)
        self.velocities = np.repeat(moving[:, None], length, axis=1)

    def step(self, commands: np.ndarray, influences: Influences) -> None:
        """Hold commands (rows, n) for one control step."""
        coefficients = self._influenced(influences)
        self.state = self.bodies.carry(coefficients, ActiveTerms.of(coefficients), self.state, commands)
        self.poses = push(self.poses, self._pose())
        self.velocities = push(self.velocities, self.state.velocity)

    def _influenced(self, influences: Influences) -> Coefficients:
        """Write the influences as coefficients; an earth-frame force is the pull of a very long tether.

        Raises:
            ValueError: for such a force on a vehicle that has a tether.
        """
        c = self.coefficients
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
            anchor = self.state.position + _FAR * toward
            changed["tether_anchor"] = np.where(pulled[:, None], anchor, c.tether_anchor)
            changed["tether_stiffness"] = np.where(pulled, size / _FAR, c.tether_stiffness)
        return c._replace(**changed)

    def _pose(self) -> np.ndarray:
        return np.concatenate((self.state.position, self.state.quaternion), axis=-1)

    def reported(self) -> Reported:
        """What noiseless sensors report now: late and with a heading bias where the vehicle has them."""
        c = self.coefficients
        position, quaternion = measured_pose(c, self.poses, self.control_dt)
        pose = np.column_stack((position, *euler_angles(quaternion)))
        age = np.clip(np.round(c.pose_delay / self.control_dt).astype(int), 0, self.velocities.shape[1] - 1)
        velocity = self.velocities[np.arange(self.rows), age].copy()
        # The velocity over ground is true; a biased attitude splits it over other body axes.
        true = rotation_matrix(self.poses[np.arange(self.rows), age, 3:])
        earth = np.einsum("rij,rj->ri", true, velocity[:, :3])
        velocity[:, :3] = np.einsum("rji,rj->ri", rotation_matrix(quaternion), earth)
        return Reported(pose, measured_velocity(c, velocity))

    def true_motion(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position (rows, 3), yaw (rows,) and body velocity (rows, 6) that are true now."""
        return self.state.position, euler_angles(self.state.quaternion)[2], self.state.velocity


def loosened(vehicle: Vehicle, slack: Slack) -> Vehicle:
    """The vehicle with factors on its gains, drags and inertias."""
    gain, linear, quadratic, mass = (torch.as_tensor(factor) for factor in slack)
    vehicle = vehicle.clone()
    vehicle.gain = vehicle.gain * gain
    vehicle.linear_drag = vehicle.linear_drag * per_dof(linear)[:, None]
    vehicle.quadratic_drag = vehicle.quadratic_drag * per_dof(quadratic)
    vehicle.mass_scale = vehicle.mass_scale * per_dof(mass)
    return vehicle
