"""Dives of a torpedo with fins, to be diagnosed: a helmsman who sees the pose changes depth, heading and speed."""

import numpy as np

from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import Episode, FlightLog
from auv_torchrl.physics import rest_state
from auv_torchrl.physics.kinematics import quaternion_from_euler, wrap_angle
from auv_torchrl.scenario import Change, Scenario
from auv_torchrl.simulator import PlainSimulator, record
from auv_torchrl.vehicle import Vehicle

DT = 0.05
AXES = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")
NOISE = np.repeat((0.002, 0.004), 3)  # m, rad
SPEED_NOISE = np.repeat((0.01, 0.005), 3)  # m/s, rad/s
HOLD_S = 8.0  # a depth, a heading and a speed


class Helmsman:
    """Heading by the rudders, depth by the pitch, pitch by the stern planes, all with what a person does beside."""

    def __init__(self, vehicle: Vehicle, count: int, seconds: float, rng: np.random.Generator) -> None:
        self.mixer, self.before = vehicle.mixer[:, [0, 4, 5]], None
        legs = int(seconds / HOLD_S) + 1
        self.ahead = rng.uniform(0.4, 0.7, (count, legs))
        self.depth, self.heading = rng.uniform(-1.5, 1.5, (2, count, legs))
        self.rate, self.phase = rng.uniform(0.5, 2.5, (2, count, 2, 3))  # rad/s and rad

    def __call__(self, time: float, seen: np.ndarray) -> np.ndarray:
        """Commands of the propeller and the four fins."""
        leg = int(time / HOLD_S)
        turning = np.zeros((len(seen), 3)) if self.before is None else wrap_angle(seen - self.before)[:, 3:] / DT
        self.before = seen
        pitch = np.clip(0.4 * (seen[:, 2] - self.depth[:, leg]), -0.3, 0.3)
        off = wrap_angle(self.heading[:, leg] - seen[:, 5])
        stir = 0.25 * np.sin(self.rate * time + self.phase).sum(-1)
        stern = 0.3 + 2.0 * (pitch - seen[:, 4]) - 0.4 * turning[:, 1] + stir[:, 0]
        rudder = 1.5 * off - 0.4 * turning[:, 2] + stir[:, 1]
        demand = np.clip(np.stack((self.ahead[:, leg], stern, rudder), axis=-1), -1, 1)
        return np.round(np.clip(demand @ self.mixer.T, -1, 1), 4)


def fly_torpedo(
    vehicle: Vehicle, values: dict[str, dict[str, float]], seed: int = 0, episodes: int = 3, seconds: float = 40.0
) -> FlightLog:
    """Dive with ``vehicle``, changed by ``values``, from 1.5 m/s ahead; pose and velocity are logged."""
    rng = np.random.default_rng(seed)
    scenario = Scenario("flown", tuple(Change(name, EFFECTS[name], given) for name, given in values.items()))
    steps = round(seconds / DT)
    flat = np.zeros(episodes)
    level = quaternion_from_euler(flat, flat, rng.uniform(-1.0, 1.0, episodes))
    begin = np.concatenate((rng.uniform(-1, 1, (episodes, 2)), np.zeros((episodes, 1))), axis=-1)
    simulator = PlainSimulator(vehicle.expand(episodes), DT, scenario=scenario)
    simulator.resume(rest_state(begin, level, np.tile([1.5, 0, 0, 0, 0, 0], (episodes, 1)), vehicle.thrusters))
    pilot = Helmsman(vehicle, episodes, seconds, rng)
    recorded = record(simulator, pilot, steps, DT, rng.standard_normal((steps, episodes, 6)) * NOISE)
    pose, velocity = recorded.measured, recorded.velocity + SPEED_NOISE * rng.standard_normal(recorded.velocity.shape)
    pose[..., 3:] = wrap_angle(pose[..., 3:])
    t = np.arange(steps, dtype=float) * DT
    flown = (Episode(e, t, pose[e], velocity[e], recorded.commands[e]) for e in range(episodes))
    return FlightLog("dive", tuple(flown), AXES)
