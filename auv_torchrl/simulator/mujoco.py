"""The simulator in MuJoCo: the same physics, with contacts and MuJoCo's integrator."""

from typing import Any, Unpack

import mujoco
import numpy as np

from auv_torchrl.physics import SUBSTEPS, ActiveTerms, Coefficients, State
from auv_torchrl.physics.hydrodynamics import acceleration
from auv_torchrl.physics.kinematics import cross, matvec, rotation_matrix
from auv_torchrl.physics.step import push
from auv_torchrl.physics.surface import given_in_water
from auv_torchrl.physics.thrusters import body_wrench, thrust_after, thrust_targets
from auv_torchrl.simulator.base import FASTEST, Options, Simulator
from auv_torchrl.simulator.mujoco_model import compiled, fleet_model
from auv_torchrl.vehicle import Vehicle

RUNAWAY = FASTEST / 1e-3  # m/s^2, rad/s^2; beyond it a vehicle has diverged, and MuJoCo would give up on all


class MujocoSimulator(Simulator):
    """Vehicles as free bodies of one MuJoCo model, which calls the physics at every Runge-Kutta stage.

    The generalized force is M_mujoco times the Fossen acceleration, so that MuJoCo's acceleration is exactly
    that, added mass included, whatever the mass of each vehicle. MuJoCo keeps its passive-force callback per
    process: it is ours only while a simulator steps.

    Args:
        vehicles, control_dt, options: of every :class:`Simulator`; MuJoCo works on numpy alone.
        walls: half sizes in m of a tank around the origin; None for open water.
    """

    def __init__(
        self,
        vehicles: Vehicle,
        control_dt: float,
        *,
        walls: tuple[float, float, float] | None = None,
        **options: Unpack[Options],
    ) -> None:
        super().__init__(vehicles, control_dt, **options)
        self.physics = compiled(fleet_model(self._flown, self.count, control_dt, walls))
        self._model, self._data = self.physics.model.ptr, self.physics.data.ptr
        self._pose = self._data.qpos.reshape(self.count, 7)
        self._rate = self._data.qvel.reshape(self.count, 6)  # earth m/s, body rad/s
        self._rotation = self._data.xmat[1:].reshape(self.count, 3, 3)
        self._passive = self._data.qfrc_passive.reshape(self.count, 6)
        body = self.physics.model.body("vehicle_0")
        self._inertia = np.repeat((float(body.mass[0]), float(body.inertia[0])), 3)
        self._runaway = np.zeros(self.count, dtype=bool)  # vehicles that diverged within this control step
        self._moved: State | None = None  # the state that MuJoCo's bodies are in

    def _advance(self, c: Coefficients, terms: ActiveTerms, command: np.ndarray) -> State:
        state, dt = self.state, self.control_dt
        commands = push(state.commands, command)
        stretches = SUBSTEPS if commands.shape[-2] > 1 else 1  # a late command may arrive within a control step
        thrust, time = state.thrust, state.time
        if state is not self._moved:
            self._write_bodies(state)
        for target in thrust_targets(c, terms, commands, dt, stretches):
            self._step_bodies(c, terms, thrust, target, time, SUBSTEPS // stretches)
            thrust = thrust_after(c, terms, thrust, target, dt / stretches)
            time = time + dt / stretches
        position, quaternion, velocity = self._read_bodies()
        if self._runaway.any():
            velocity[self._runaway] = np.nan
            self._runaway[:] = False
        self._moved = State(position, quaternion, velocity, thrust, commands, state.time + dt)
        return self._moved

    def _step_bodies(
        self, c: Coefficients, terms: ActiveTerms, thrust: Any, target: Any, time: Any, substeps: int
    ) -> None:
        """Let MuJoCo take some of its steps while the thrust goes from ``thrust`` towards ``target``."""
        data, began = self._data, self._data.time
        changing = terms.lag or terms.battery_sag or terms.surface
        constant = None if changing else body_wrench(c, terms, target, time)

        def apply_physics(*_: Any) -> None:
            elapsed = data.time - began
            wrench = constant
            if wrench is None:
                given = thrust_after(c, terms, thrust, target, elapsed)
                given = given_in_water(c, terms, given, self._rotation, self._pose[:, :3])
                wrench = body_wrench(c, terms, given, time + elapsed)
            self._passive[:] = self._force(c, terms, wrench)

        mujoco.set_mjcb_passive(apply_physics)  # pyright: ignore[reportAttributeAccessIssue]
        try:
            mujoco.mj_step(self._model, data, substeps)  # pyright: ignore[reportAttributeAccessIssue]
        finally:
            mujoco.set_mjcb_passive(None)  # pyright: ignore[reportAttributeAccessIssue]

    def _force(self, c: Coefficients, terms: ActiveTerms, wrench: np.ndarray) -> np.ndarray:
        """Generalized force (N, 6) that gives MuJoCo's bodies the Fossen acceleration at this stage."""
        rotation, spin = self._rotation, self._rate[:, 3:]
        velocity = np.concatenate((matvec(rotation.mT, self._rate[:, :3]), spin), axis=-1)
        rate = acceleration(c, terms, rotation, self._pose[:, :3], velocity, wrench)
        if not np.abs(rate).max() < RUNAWAY:
            sane = np.abs(rate).max(axis=-1) < RUNAWAY
            rate = np.where(sane[:, None], rate, 0.0)
            self._runaway |= ~sane
        linear = matvec(rotation, rate[:, :3] + cross(spin, velocity[:, :3]))
        return np.concatenate((linear, rate[:, 3:]), axis=-1) * self._inertia

    def _write_bodies(self, state: State) -> None:
        self._pose[:, :3], self._pose[:, 3:] = state.position, state.quaternion
        self._rate[:, :3] = matvec(rotation_matrix(state.quaternion), state.velocity[:, :3])
        self._rate[:, 3:] = state.velocity[:, 3:]

    def _read_bodies(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        pose = self._pose.copy()
        position, quaternion = pose[:, :3], pose[:, 3:]
        linear = matvec(rotation_matrix(quaternion).mT, self._rate[:, :3])
        return position, quaternion, np.concatenate((linear, self._rate[:, 3:]), axis=-1)
