"""A second simulator that shares no line with :mod:`auv_torchrl.physics`, so that a bug there would show.

Lu et al. 2023, Eq. 1 to 4, 13, 14 and Table 1 in four degrees of freedom (roll and pitch held), numpy, midpoint rule
at 5 ms. The numbers of Table 1, the geometry and the effects are written here a second time on purpose; no other module
may do so. Rows are vehicles. Earth NED, body FRD.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.blind.flights.plant import Influences, Motion, Reported, Slack

MASS = 12.0  # kg
TOTAL_MASS = (15.9, 32.2, 14.5, 0.3)  # kg, kg m^2: surge, sway, heave, yaw; Table 1
LINEAR = (36.8, 60.6, 112.2, 0.32)  # kg/s, kg m^2/s; Table 1
QUADRATIC = (374.7, 197.2, 153.2, 0.95)  # kg/m, kg m^2; Table 1
FULL_THRUST, LIMIT, DEAD_BAND = 50.0, 50.0, 5.0  # N, section 5
PLACE = np.array([[0.156, 0.111], [0.156, -0.111], [-0.156, 0.111], [-0.156, -0.111], [0, 0.218], [0, -0.218]])  # m
HEADING = np.radians([135.0, -135.0, 45.0, -45.0])  # of the force of thrusters 1 to 4 at a positive command
AXES = ("surge", "sway", "heave", "yaw")
THRUSTERS = ("1", "2", "3", "4", "5", "6")


class ForeignVehicles:
    """Parameters of a batch of vehicles in four degrees of freedom, one row per vehicle."""

    def __init__(self, rows: int) -> None:
        """Make nominal vehicles."""
        self.rows = rows
        ones = np.ones((rows, 6))
        self.gain, self.lag, self.exponent, self.asymmetry = ones.copy(), 0 * ones, ones.copy(), 0 * ones
        self.limit, self.dead_band = LIMIT * ones, DEAD_BAND * ones
        self.angle, self.source = 0 * ones, np.tile(np.arange(6), (rows, 1))
        self.delay, self.sag, self.pose_delay, self.heading_bias = (np.zeros(rows) for _ in range(4))
        self.position_scale = np.ones((rows, 3))
        self.linear = np.tile(np.diag(LINEAR), (rows, 1, 1))
        self.quadratic, self.mass_scale = np.tile(QUADRATIC, (rows, 1)), np.ones((rows, 4))
        self.load = np.zeros((rows, 4))  # kg, N, m, m: mass, weight in water, x, y
        self.offset, self.down_force, self.coriolis = np.zeros((rows, 2)), np.zeros(rows), np.zeros(rows)
        self.current, self.anchor = np.zeros((rows, 3)), np.zeros((rows, 3))
        self.stiffness, self.slack = np.zeros(rows), np.zeros(rows)
        self._prepare()

    def change(self, rows: slice, effect: str, values: Mapping[str, float]) -> None:
        """Give some vehicles an effect by its published name and parameters, before or during a flight.

        Raises:
            ValueError: for an effect or parameter that this simulator does not have.
        """
        for row in range(rows.start, rows.stop):
            rest = dict(values)  # what no line below has read
            if not (self._change_thrusters(row, effect, rest) or self._change_hull_or_sensors(row, effect, rest)):
                raise ValueError(f"the foreign simulator has no effect {effect!r}")
            if rest:
                raise ValueError(f"the foreign simulator's {effect} has no parameters {sorted(rest)}")
        self._prepare()

    def _change_thrusters(self, row: int, effect: str, rest: dict[str, float]) -> bool:
        """Change the thrusters of a vehicle; False if that is not what the effect does."""
        match effect:
            case "thruster_gain":
                self.gain[row] *= self._factors(rest, "gain", THRUSTERS)
            case "thruster_swap":
                givers = self.source[row] + 1.0
                self._family(rest, "command", givers)
                self.source[row] = np.round(givers).astype(int) - 1
            case "thruster_misalignment":
                self._family(rest, "angle", self.angle[row])
            case "thrust_limit":
                self._family(rest, "limit", self.limit[row])
            case "dead_band":
                self.dead_band[row] = rest.pop("width")
            case "thrust_curve":
                self.exponent[row] = rest.pop("exponent", self.exponent[row, 0])
                self.asymmetry[row] = rest.pop("asymmetry", self.asymmetry[row, 0])
            case "thruster_lag":
                self.lag[row] = rest.pop("time_constant")
            case "command_delay":
                self.delay[row] = rest.pop("delay")
            case "battery_sag":
                self.sag[row] = rest.pop("rate")
            case _:
                return False
        return True

    @staticmethod
    def _family(rest: dict[str, float], name: str, target: np.ndarray) -> None:
        """Read one number of each thruster."""
        for column, member in enumerate(THRUSTERS):
            target[column] = rest.pop(f"{name}_{member}", target[column])

    @staticmethod
    def _factors(rest: dict[str, float], name: str, members: Sequence[str]) -> np.ndarray:
        """Read one factor of each thruster, or of each axis, on what the vehicle has."""
        return np.array([rest.pop(f"{name}_{member}", 1.0) for member in members])

    def _change_hull_or_sensors(self, row: int, effect: str, rest: dict[str, float]) -> bool:
        """Change hull, load, surroundings or sensors of a vehicle; False if that is not what the effect does."""
        match effect:
            case "added_mass":
                self.mass_scale[row] *= self._factors(rest, "scale", AXES)
            case "payload":
                self.load[row] = [rest.pop(key, 0.0) for key in ("mass", "weight", "x", "y")]
                rest.pop("z", None)  # a height changes nothing while roll and pitch are held
            case "buoyancy":
                self.down_force[row] += rest.pop("force")
            case "mass_offset":
                self.offset[row] += [rest.pop("x", 0.0), rest.pop("y", 0.0)]
            case "linear_drag":
                self.linear[row] *= self._factors(rest, "scale", AXES)[:, None]  # of each axis, by all motions
            case "quadratic_drag":
                self.quadratic[row] *= self._factors(rest, "scale", AXES)
            case "drag_coupling":
                for i, to in enumerate(AXES):
                    for j, by in enumerate(AXES):
                        self.linear[row, i, j] += rest.pop(f"drag_{to}_from_{by}", 0.0)
            case "coriolis":
                self.coriolis[row] = rest.pop("strength")
            case "current":
                self.current[row] += [rest.pop(key, 0.0) for key in ("north", "east", "down")]
            case "tether":
                self.anchor[row] = [rest.pop(key, 0.0) for key in ("north", "east", "down")]
                self.stiffness[row], self.slack[row] = rest.pop("stiffness"), rest.pop("slack", 0.0)
            case "heading_bias":
                self.heading_bias[row] += rest.pop("angle")
            case "pose_delay":
                self.pose_delay[row] = rest.pop("delay")
            case "position_scale":
                self.position_scale[row] *= rest.pop("factor")
            case "depth_scale":
                self.position_scale[row, 2] *= rest.pop("factor")
            case _:
                return False
        return True

    def loosen(self, rows: slice, slack: Slack) -> None:
        """Multiply gains, drags and inertias of some vehicles by factors."""
        self.gain[rows] *= slack.gain
        self.linear[rows] *= slack.linear[:, None]
        self.quadratic[rows] *= slack.quadratic
        self.mass_scale[rows] *= slack.mass
        self._prepare()

    def _prepare(self) -> None:
        load, offset = self.load, self.offset
        mass = np.zeros((self.rows, 4, 4))
        mass[:, range(4), range(4)] = TOTAL_MASS
        mass[:, range(3), range(3)] += load[:, :1]
        arm_x = MASS * offset[:, 0] + load[:, 0] * load[:, 2]
        arm_y = MASS * offset[:, 1] + load[:, 0] * load[:, 3]
        mass[:, 3, 3] += MASS * (offset**2).sum(1) + load[:, 0] * (load[:, 2:] ** 2).sum(1)
        mass[:, 1, 3] = mass[:, 3, 1] = arm_x
        mass[:, 0, 3] = mass[:, 3, 0] = -arm_y
        root = np.sqrt(self.mass_scale)
        self.mass = mass * root[:, :, None] * root[:, None, :]
        self.mass_inverse = np.linalg.inv(self.mass)
        turned = HEADING + self.angle[:, :4]
        self.allocation = np.zeros((self.rows, 4, 6))
        self.allocation[:, 0, :4], self.allocation[:, 1, :4] = np.cos(turned), np.sin(turned)
        self.allocation[:, 3, :4] = PLACE[:4, 0] * np.sin(turned) - PLACE[:4, 1] * np.cos(turned)
        self.allocation[:, 2, 4:] = 1.0


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
