"""A second simulator that shares no line with :mod:`auv_torchrl.physics`, so that a bug there would show.

Lu et al. 2023, Eq. 1 to 4, 13, 14 and Table 1 in four degrees of freedom (roll and pitch held), numpy, midpoint rule
at 5 ms. The numbers of Table 1, the geometry and the effects are written a second time on purpose, in
``foreign_vehicles.py``; no other module may do so. Rows are vehicles. Earth NED, body FRD.
"""

import numpy as np

from benchmarks.blind.foreign_vehicles import FULL_THRUST, ForeignVehicles
from benchmarks.blind.plant import Influences, Motion, Reported

STEP = 0.005  # s
LONGEST_DELAY = 1.0  # s


class ForeignPlant(ForeignVehicles):
    """A batch of vehicles that swim in four degrees of freedom, one row per vehicle."""

    def __init__(self, rows: int, control_dt: float) -> None:
        """Make nominal vehicles."""
        super().__init__(rows)
        self.control_dt = control_dt

    def reset(self, position: np.ndarray, yaw: np.ndarray, velocity: np.ndarray) -> None:
        """Start at (rows, 3) m, (rows,) rad, with u, v, w, r (rows, 4) in m/s and rad/s and silent thrusters."""
        self.position, self.yaw = position.astype(float).copy(), yaw.astype(float).copy()
        self.velocity = velocity.astype(float).copy()
        self.thrust = np.zeros((self.rows, 6))
        self.time = 0.0
        self._steps = 0
        # rings, newest at the pointer
        self._sent = np.zeros((round(LONGEST_DELAY / self.control_dt) + 2, self.rows, 6))
        self._trace = np.zeros((round(LONGEST_DELAY / STEP) + 1, self.rows, 4))
        self._trace[:] = np.column_stack((self.position, self.yaw))

    def step(self, commands: np.ndarray, influences: Influences) -> None:
        """Hold commands (rows, 6) for one control step under influences from outside the library."""
        newest = round(self.time / self.control_dt)
        self._sent[newest % len(self._sent)] = commands
        for _ in range(round(self.control_dt / STEP)):
            self._advance(influences)
            self._steps += 1
            self._trace[self._steps % len(self._trace)] = np.column_stack((self.position, self.yaw))

    def _advance(self, influences: Influences) -> None:
        target = self._target()
        before = self.thrust
        follow = [np.where(self.lag > 0, 1 - np.exp(-dt / np.maximum(self.lag, 1e-9)), 1.0) for dt in (STEP / 2, STEP)]
        halfway, self.thrust = (before + share * (target - before) for share in follow)
        body = np.column_stack((self.position, self.yaw, self.velocity))
        middle = body + STEP / 2 * self._rate(body, self._now(before, target), self.time, influences)
        body = body + STEP * self._rate(middle, halfway, self.time + STEP / 2, influences)
        self.position, self.yaw, self.velocity = body[:, :3], body[:, 3], body[:, 4:]
        self.time += STEP

    def _now(self, before: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Thrust at once after the command has changed: thrusters without lag are there already."""
        return np.where(self.lag > 0, before, target)

    def _target(self) -> np.ndarray:
        """Mean thrust (rows, 6) that the commands call for which arrive until the next small step."""
        index = np.floor((self.time - self.delay) / self.control_dt + 1e-6).astype(int)
        until_next = (index + 1) * self.control_dt + self.delay - self.time
        old = np.clip(until_next / STEP, 0.0, 1.0)[:, None]
        old = np.where(old > 1 - 1e-6, 1.0, old)
        return old * self._called_for(index) + (1 - old) * self._called_for(index + 1)

    def _called_for(self, index: np.ndarray) -> np.ndarray:
        """Thrust (rows, 6) for the commands sent at control step ``index`` (rows,)."""
        command = np.where((index >= 0)[:, None], self._sent[index % len(self._sent), np.arange(self.rows)], 0.0)
        command = np.take_along_axis(command, self.source, axis=1)
        force = FULL_THRUST * np.sign(command) * np.abs(command) ** self.exponent
        force = np.where(force < 0, (1 - self.asymmetry) * force, force)
        force = np.clip(force, -self.limit, self.limit)
        return np.where(np.abs(force) < self.dead_band, 0.0, force)

    def _rate(self, body: np.ndarray, thrust: np.ndarray, time: float, influences: Influences) -> np.ndarray:
        """Rate of x, y, z, yaw, u, v, w, r, (rows, 8)."""
        velocity = body[:, 4:]
        u, v, w, r = velocity.T
        cos, sin = np.cos(body[:, 3]), np.sin(body[:, 3])
        real = thrust * self.gain * influences.thrust_factor * (1 - self.sag * time / 60)[:, None]
        wrench = np.einsum("rij,rj->ri", self.allocation, real)
        water = self._to_body(self.current + influences.current, cos, sin)
        relative = velocity.copy()
        relative[:, :3] -= water
        wrench -= np.einsum("rij,rj->ri", self.linear, relative) + self.quadratic * np.abs(relative) * relative
        earth = influences.earth_force.copy()
        earth[:, 2] += self.down_force + self.load[:, 1]
        reach = self.anchor - body[:, :3]
        length = np.maximum(np.linalg.norm(reach, axis=1), 1e-9)
        earth += (self.stiffness * np.maximum(length - self.slack, 0) / length)[:, None] * reach
        wrench[:, :3] += self._to_body(earth, cos, sin)
        wrench -= self.coriolis[:, None] * self._coriolis(relative)
        rate = np.einsum("rij,rj->ri", self.mass_inverse, wrench)
        rate[:, 0] += self.coriolis * r * water[:, 1]  # the water turns against the body
        rate[:, 1] -= self.coriolis * r * water[:, 0]
        return np.column_stack((cos * u - sin * v, sin * u + cos * v, w, r, rate))

    def _coriolis(self, relative: np.ndarray) -> np.ndarray:
        momentum = np.einsum("rij,rj->ri", self.mass, relative)
        u, v, _, r = relative.T
        zero = np.zeros_like(u)
        return np.column_stack((-r * momentum[:, 1], r * momentum[:, 0], zero, u * momentum[:, 1] - v * momentum[:, 0]))

    @staticmethod
    def _to_body(earth: np.ndarray, cos: np.ndarray, sin: np.ndarray) -> np.ndarray:
        x, y, z = earth.T
        return np.column_stack((cos * x + sin * y, -sin * x + cos * y, z))

    def reported(self) -> Reported:
        """What noiseless sensors report now: late and with a heading bias where the vehicle has them."""
        ago = self._steps - self.pose_delay / STEP
        index = np.maximum(np.floor(ago + 1e-6), 0).astype(int)
        part = np.clip(ago - index, 0.0, 1.0)[:, None]
        rows = np.arange(self.rows)
        late = self._trace[index % len(self._trace), rows]
        late = late + part * (self._trace[np.minimum(index + 1, self._steps) % len(self._trace), rows] - late)
        pose, velocity = np.zeros((self.rows, 6)), np.zeros((self.rows, 6))
        pose[:, :3], pose[:, 5] = late[:, :3] * self.position_scale, late[:, 3] + self.heading_bias
        velocity[:, :3], velocity[:, 5] = self.velocity[:, :3], self.velocity[:, 3]  # fixed to the body, at once
        return Reported(pose, velocity)

    def true_motion(self) -> Motion:
        """How the vehicles truly move now."""
        velocity = np.zeros((self.rows, 6))
        velocity[:, :3], velocity[:, 5] = self.velocity[:, :3], self.velocity[:, 3]
        return Motion(self.position, self.yaw, velocity)
