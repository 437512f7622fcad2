"""How much an effect shows: the 2 s prediction error that leaving it out causes, in standard deviations of the sensors.

Effects are drawn again until they show clearly, so that "clear size" means the same for all of them.
"""

import numpy as np

from auv_torchrl.effects.effect import changed
from auv_torchrl.physics import ActiveTerms, Coefficients, prepare, rest_state
from auv_torchrl.physics.kinematics import euler_angles, quaternion_from_euler, wrap_angle
from auv_torchrl.physics.thrusters import thrust_after, thrust_target
from auv_torchrl.simulator import simulate
from auv_torchrl.vehicle import Vehicle

HORIZON_S = 2.0
CLEAR_AT = 5.0  # times the sensors' standard deviation
POSITION_NOISE = 0.002  # m
ATTITUDE_NOISE = 0.004  # rad


def influence(
    vehicle: Vehicle, pose: np.ndarray, velocity: np.ndarray, commands: np.ndarray, control_dt: float
) -> float:
    """Root mean square error at 2 s of ``vehicle`` on noiseless logs, in the axis that shows it best.

    Args:
        vehicle: one vehicle with everything but the effect in question.
        pose: (episodes, T, 6) as reported, noiseless.
        velocity: (episodes, T, 6) that fits it.
        commands: (episodes, T, n) sent.
        control_dt: seconds between samples.
    """
    ahead = round(HORIZON_S / control_dt)
    bias = float(vehicle.heading_bias)
    # A pose that is reported late looks, in prediction, like commands that arrive late.
    late = float(vehicle.delay + vehicle.pose_delay)
    memory = int(np.ceil(late / control_dt)) + 1
    starts = np.arange(memory, pose.shape[1] - ahead, ahead)

    def pick(series: np.ndarray, shift: int = 0) -> np.ndarray:
        return series[:, starts + shift].reshape(-1, series.shape[2])

    at, moving = pick(pose), pick(velocity)
    past = np.stack([pick(commands, -1 - age) for age in range(memory)], axis=1)
    flown = changed(vehicle, delay=vehicle.delay + vehicle.pose_delay, pose_delay=0 * vehicle.pose_delay)
    c = prepare(flown.expand(len(at))).numpy()
    quaternion = quaternion_from_euler(at[:, 3], at[:, 4], at[:, 5] - bias)
    state = rest_state(at[:, :3], quaternion, _turned(moving, bias), commands.shape[2], memory)
    terms = ActiveTerms.of(c)
    time = np.tile(starts * control_dt, len(pose))
    state = state._replace(commands=past, thrust=_thrust_at(c, terms, commands, starts, control_dt), time=time)
    sent = np.stack([pick(commands, step) for step in range(ahead)], axis=1)
    end = simulate(flown, sent, control_dt * np.arange(ahead + 1), state).states[:, -1]
    reached = pick(pose, ahead)
    turn = wrap_angle(euler_angles(end[:, 3:7])[2] + bias - reached[:, 5])
    error = np.column_stack(((end[:, :3] - reached[:, :3]) / POSITION_NOISE, turn / ATTITUDE_NOISE))
    return float(np.sqrt((error**2).mean(axis=0)).max())


def _thrust_at(
    c: Coefficients, terms: ActiveTerms, commands: np.ndarray, starts: np.ndarray, control_dt: float
) -> np.ndarray:
    """Thrust (episodes * starts, n) before the starts: it follows from the commands alone, from the first one on."""
    episodes = len(commands)
    one = c.rows(slice(0, episodes))
    lagging = round(float(one.delay[0]) / control_dt)
    thrust = np.zeros_like(commands[:, 0])
    series = []
    for step in range(commands.shape[1]):
        series.append(thrust)
        if step >= lagging:
            thrust = thrust_after(
                one, terms, thrust, thrust_target(one, terms, commands[:, step - lagging]), control_dt
            )
    return np.stack(series, axis=1)[:, starts].reshape(-1, commands.shape[2])


def _turned(velocity: np.ndarray, angle: float) -> np.ndarray:
    """Body velocities (rows, 6) seen from a body that is turned back by ``angle`` about z."""
    turned = velocity.copy()
    cos, sin = np.cos(angle), np.sin(angle)
    turned[:, 0] = cos * velocity[:, 0] - sin * velocity[:, 1]
    turned[:, 1] = sin * velocity[:, 0] + cos * velocity[:, 1]
    return turned
