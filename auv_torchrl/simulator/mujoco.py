"""The simulator in MuJoCo: the same physics, with contacts and MuJoCo's integrator."""

from itertools import cycle
from typing import Any, Unpack

import mujoco
import numpy as np

from auv_torchrl.physics import SUBSTEPS, ActiveTerms, ByRow, Coefficients, Forces, RowFunction, State, Targets
from auv_torchrl.physics.fins import fin_wrench
from auv_torchrl.physics.free_body import body_velocity, free_body_force
from auv_torchrl.physics.kinematics import matvec, rotation_matrix
from auv_torchrl.physics.step import push, stage_thrusts
from auv_torchrl.physics.surface import given_in_water
from auv_torchrl.physics.thrusters import body_wrench
from auv_torchrl.simulator.base import FASTEST, Options, Simulator
from auv_torchrl.simulator.mujoco_model import compiled, fleet_model
from auv_torchrl.vehicle import Vehicle

# m/s^2 and rad/s^2, of all six together; beyond it a vehicle has diverged, and MuJoCo would give up on all
RUNAWAY = FASTEST / 1e-3

_BODY_VELOCITY = RowFunction("body-velocity", body_velocity, {"pose": 7, "rate": 6})


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
        self._read: tuple[Coefficients, Forces] | None = None  # compiled forces, and the coefficients they know
        self._targets, self._body_velocity = Targets(vehicles.thrusters), ByRow(_BODY_VELOCITY)
        super().__init__(vehicles, control_dt, **options)
        self.physics = compiled(fleet_model(self._flown, self.count, control_dt, walls))
        self._model, self._data = self.physics.model.ptr, self.physics.data.ptr
        self._pose = self._data.qpos.reshape(self.count, 7)
        self._rate = self._data.qvel.reshape(self.count, 6)  # earth m/s, body rad/s
        self._rotation = self._data.xmat[1:].reshape(self.count, 3, 3)
        self._passive = self._data.qfrc_passive.reshape(self.count, 6)
        body = self.physics.model.body("vehicle_0")
        self._inertia = np.repeat((float(body.mass[0]), float(body.inertia[0])), 3)
        self._lost = np.zeros((self.count, 1))  # 1 for vehicles that diverged within this control step
        self._moved: State | None = None  # the state that MuJoCo's bodies are in

    def _begin_phase(self, rows: np.ndarray, phase: int) -> None:
        super()._begin_phase(rows, phase)
        self._read = None

    def _advance(self, c: Coefficients, terms: ActiveTerms, command: np.ndarray) -> State:
        state, dt = self.state, self.control_dt
        commands = push(state.commands, command)
        if state is not self._moved:
            self._write_bodies(state)
        targets = self._targets(c, terms, commands, dt, SUBSTEPS)
        stages, thrust = stage_thrusts(c, terms, state.thrust, targets, state.time, dt / SUBSTEPS)
        self._step_bodies(c, terms, stages)
        position, quaternion, velocity = self._read_bodies()
        if self._lost.any():
            velocity[self._lost[:, 0] > 0] = np.nan
            self._lost[:] = 0.0
        self._moved = State(position, quaternion, velocity, thrust, commands, state.time + dt)
        return self._moved

    def _step_bodies(self, c: Coefficients, terms: ActiveTerms, stages: list[tuple[np.ndarray, np.ndarray]]) -> None:
        """Let MuJoCo take its steps, with the thrust (N, n) and the time (N,) of each stage, or the same in all."""
        forces = self._forces(c)
        if forces.compiled:
            call = forces.callback(np.stack([body_wrench(c, terms, *stage) for stage in stages]))
        else:
            following = cycle(stages)

            def call(*_: Any) -> None:
                self._passive[:] = self._force(c, terms, *next(following))

        mujoco.set_mjcb_passive(call)  # pyright: ignore[reportAttributeAccessIssue]
        try:
            mujoco.mj_step(self._model, self._data, SUBSTEPS)  # pyright: ignore[reportAttributeAccessIssue]
        finally:
            mujoco.set_mjcb_passive(None)  # pyright: ignore[reportAttributeAccessIssue]

    def _forces(self, c: Coefficients) -> Forces:
        """Compiled forces on vehicles with these coefficients, on MuJoCo's own arrays."""
        if self._read is None or self._read[0] is not c:
            bodies = {
                "position": self._pose[:, :3],
                "rate": self._rate,
                "rotation": self._rotation.reshape(self.count, 9),
                "lost": self._lost,
                "body force": self._passive,
            }
            self._read = c, Forces(c, self._inertia, RUNAWAY, bodies)
        return self._read[1]

    def _force(self, c: Coefficients, terms: ActiveTerms, thrust: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Generalized force (N, 6) that gives MuJoCo's bodies the Fossen acceleration at this stage."""
        wrench = body_wrench(c, terms, given_in_water(c, terms, thrust, self._rotation, self._pose[:, :3]), time)
        if terms.fins:
            moving = np.concatenate((matvec(self._rotation.mT, self._rate[:, :3]), self._rate[:, 3:]), axis=-1)
            wrench = wrench + fin_wrench(c, terms, self._rotation, self._pose[:, :3], moving, thrust)
        force, sane = free_body_force(
            c, terms, self._inertia, RUNAWAY, self._pose[:, :3], self._rate, self._rotation, wrench
        )
        self._lost[~sane] = 1.0
        return force

    def _write_bodies(self, state: State) -> None:
        self._pose[:, :3], self._pose[:, 3:] = state.position, state.quaternion
        self._rate[:, :3] = matvec(rotation_matrix(state.quaternion), state.velocity[:, :3])
        self._rate[:, 3:] = state.velocity[:, 3:]

    def _read_bodies(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        pose = self._pose.copy()
        return pose[:, :3], pose[:, 3:], self._body_velocity(pose, self._rate)
