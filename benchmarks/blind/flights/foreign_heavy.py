"""A second simulator of the BlueROV2 Heavy in six degrees of freedom that shares no line with the physics under test.

von Benzon et al. 2022, Table A1, and the published chart of the T200 thruster at 16 V, written a second time on
purpose; no other module may do so. Momentum is integrated, numpy, midpoint rule at 5 ms. Rows are vehicles. Earth NED,
body FRD.
"""

from collections.abc import Mapping

import numpy as np

from benchmarks.blind.flights.plant import Influences, Motion, Reported, Slack

STEP = 0.005  # s
MASS, INERTIA = 13.5, (0.26, 0.23, 0.37)  # kg, kg m^2; Table A1, as all below
WEIGHT, FLOAT, ARM = 13.5 * 9.81, 131.454, 0.01  # N, N, and m from the centre of buoyancy down to that of mass
ADDED = (6.36, 7.12, 18.68, 0.189, 0.135, 0.222)  # kg, kg m^2
LINEAR = (13.7, 0.0, 33.0, 0.0, 0.8, 0.0)  # kg/s, kg m^2/s
QUADRATIC = (141.0, 217.0, 190.0, 1.19, 0.47, 1.5)  # kg/m, kg m^2
AHEAD, ASIDE, BELOW = 0.156, 0.111, 0.085  # m, of the horizontal thrusters
UPRIGHT_AHEAD, UPRIGHT_ASIDE = 0.12, 0.218  # m, of the vertical ones
FORWARD, REVERSE, DEAD = 51.5, 0.775 * 51.5, 0.95  # N, T200 at 16 V: at full command, backwards, and not at all below
CURVE = 1.5  # power of the command
CONTROLLED = [0, 1, 2, 5]  # degrees of freedom with slack: surge, sway, heave, yaw


def _push() -> np.ndarray:
    """Force and moment per newton of each thruster, (6, 8)."""
    corners = [(1, 1), (1, -1), (-1, 1), (-1, -1)]  # ahead and to starboard are positive
    columns = []
    for ahead, aside in corners:  # in front they push backwards and outwards, behind forwards and outwards
        x, y, z = ahead * AHEAD, aside * ASIDE, BELOW
        fx, fy = -ahead / np.sqrt(2), aside / np.sqrt(2)
        columns.append([fx, fy, 0.0, -z * fy, z * fx, x * fy - y * fx])
    for ahead, aside in corners:
        columns.append([0.0, 0.0, 1.0, aside * UPRIGHT_ASIDE, -ahead * UPRIGHT_AHEAD, 0.0])
    return np.array(columns).T


class ForeignHeavy:
    """A batch of BlueROV2 Heavy, one row per vehicle."""

    def __init__(self, rows: int, control_dt: float) -> None:
        """Make nominal vehicles."""
        self.rows, self.control_dt = rows, control_dt
        self.gain = np.ones((rows, 8))
        self.linear, self.quadratic = np.tile(LINEAR, (rows, 1)), np.tile(QUADRATIC, (rows, 1))
        self.stretch = np.ones((rows, 6))  # roots of the factors on the inertia
        self.load, self.load_weight, self.load_at = np.zeros(rows), np.zeros(rows), np.zeros((rows, 3))
        self.heavier, self.depth_error = np.zeros(rows), np.zeros(rows)
        self.push = _push()
        self._prepare()

    def loosen(self, rows: slice, slack: Slack) -> None:
        """Multiply gains, drags and inertias of some vehicles by factors."""
        self.gain[rows] *= slack.gain
        for axis, linear, quadratic, mass in zip(CONTROLLED, *slack[1:], strict=True):
            self.linear[rows, axis] *= linear
            self.quadratic[rows, axis] *= quadratic
            self.stretch[rows, axis] *= np.sqrt(mass)
        self._prepare()

    def change(self, rows: slice, effect: str, values: Mapping[str, float]) -> None:
        """Give some vehicles an effect by its published name and parameters.

        Raises:
            ValueError: for an effect or parameter that this simulator does not have.
        """
        rest = dict(values)  # what no line below has read
        match effect:
            case "thruster_gain":
                for i in range(8):
                    self.gain[rows, i] *= rest.pop(f"gain_{i + 1}", 1.0)
            case "buoyancy":
                self.heavier[rows] += rest.pop("force")
            case "payload":
                self.load[rows], self.load_weight[rows] = rest.pop("mass"), rest.pop("weight")
                self.load_at[rows] = [rest.pop(axis, 0.0) for axis in "xyz"]
            case "depth_bias":
                self.depth_error[rows] += rest.pop("offset")
            case _:
                raise ValueError(f"the foreign BlueROV2 Heavy has no effect {effect!r}")
        if rest:
            raise ValueError(f"the foreign BlueROV2 Heavy's {effect} has no parameters {sorted(rest)}")
        self._prepare()

    def _prepare(self) -> None:
        mass = np.zeros((self.rows, 6, 6))
        mass[:, range(6), range(6)] = np.array([MASS] * 3 + [*INERTIA]) + ADDED
        for axis in range(6):  # what a load moves with, for a unit of each velocity
            unit = np.zeros((self.rows, 6))
            unit[:, axis] = 1.0
            swept = self.load[:, None] * (unit[:, :3] + np.cross(unit[:, 3:], self.load_at))
            mass[:, :3, axis] += swept
            mass[:, 3:, axis] += np.cross(self.load_at, swept)
        self.mass = mass * self.stretch[:, :, None] * self.stretch[:, None, :]
        self.mobility = np.linalg.inv(self.mass)

    def reset(self, position: np.ndarray, yaw: np.ndarray, velocity: np.ndarray) -> None:
        """Start level at (rows, 3) m, (rows,) rad, with u, v, w, r (rows, 4) in m/s and rad/s."""
        self.position = position.astype(float).copy()
        cos, sin, zero = np.cos(yaw), np.sin(yaw), np.zeros(self.rows)
        axes = [cos, -sin, zero, sin, cos, zero, zero, zero, zero + 1]
        self.rotation = np.stack(axes, axis=1).reshape(-1, 3, 3)  # body to earth
        self.velocity = np.zeros((self.rows, 6))
        self.velocity[:, CONTROLLED] = velocity

    def step(self, commands: np.ndarray, influences: Influences) -> None:
        """Hold commands (rows, 8) for one control step; nothing from outside the library acts on this vehicle."""
        thrust = np.sign(commands) * np.abs(commands) ** CURVE
        thrust = np.where(thrust < 0, REVERSE, FORWARD) * thrust
        thrust = np.where(np.abs(thrust) < DEAD, 0.0, thrust) * self.gain * influences.thrust_factor
        wrench = thrust @ self.push.T
        for _ in range(round(self.control_dt / STEP)):
            half = self.velocity + STEP / 2 * self._rate(self.rotation, self.velocity, wrench)
            halfway = self._turned(self.rotation, self.velocity[:, 3:] * STEP / 2)
            self.velocity = self.velocity + STEP * self._rate(halfway, half, wrench)
            self.position = self.position + STEP * np.einsum("rij,rj->ri", halfway, half[:, :3])
            self.rotation = self._turned(self.rotation, half[:, 3:] * STEP)

    def _rate(self, rotation: np.ndarray, velocity: np.ndarray, wrench: np.ndarray) -> np.ndarray:
        """Body accelerations (rows, 6): momentum seen from a body that turns, drag, weight and buoyancy."""
        momentum = np.einsum("rij,rj->ri", self.mass, velocity)
        turning = velocity[:, 3:]
        force = wrench - self.linear * velocity - self.quadratic * np.abs(velocity) * velocity
        force[:, :3] -= np.cross(turning, momentum[:, :3])
        force[:, 3:] -= np.cross(turning, momentum[:, 3:]) + np.cross(velocity[:, :3], momentum[:, :3])
        down = rotation[:, 2]  # the earth's z axis in the body
        force[:, :3] += (WEIGHT - FLOAT + self.heavier + self.load_weight)[:, None] * down
        arm = self.load_weight[:, None] * self.load_at + FLOAT * ARM * np.array([0.0, 0.0, 1.0])
        force[:, 3:] += np.cross(arm, down)
        return np.einsum("rij,rj->ri", self.mobility, force)

    @staticmethod
    def _turned(rotation: np.ndarray, by: np.ndarray) -> np.ndarray:
        """Rotations (rows, 3, 3) turned in the body by vectors of angle (rows, 3), after Rodrigues."""
        angle = np.maximum(np.linalg.norm(by, axis=1), 1e-12)[:, None, None]
        x, y, z = (by / angle[:, 0]).T
        zero = np.zeros_like(x)
        cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
        return rotation @ (np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)

    def reported(self) -> Reported:
        """What noiseless sensors report now."""
        pose = np.concatenate((self.position, self._angles()), axis=1)
        pose[:, 2] += self.depth_error
        return Reported(pose, self.velocity.copy())

    def _angles(self) -> np.ndarray:
        """Roll, pitch, yaw (rows, 3) in rad."""
        r = self.rotation
        pitch = -np.arcsin(np.clip(r[:, 2, 0], -1.0, 1.0))
        return np.column_stack((np.arctan2(r[:, 2, 1], r[:, 2, 2]), pitch, np.arctan2(r[:, 1, 0], r[:, 0, 0])))

    def true_motion(self) -> Motion:
        """How the vehicles truly move now."""
        return Motion(self.position, self._angles()[:, 2], self.velocity)
