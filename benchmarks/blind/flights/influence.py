"""How much an effect shows: the 2 s prediction error that leaving it out causes, in standard deviations of the sensors.

Effects are drawn again until they show clearly, so that "clear size" means the same for all of them.
"""

import numpy as np

from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import POSE
from auv_torchrl.physics import CONTROL_DT, ActiveTerms, Coefficients, prepare, rest_state
from auv_torchrl.physics.kinematics import wrap_angle
from auv_torchrl.physics.thrusters import thrust_after, thrust_target
from auv_torchrl.sensors import Inverse, ages
from auv_torchrl.simulator import simulate
from auv_torchrl.vehicle import Vehicle

HORIZON_S = 2.0
CLEAR_AT = 5.0  # times the sensors' standard deviation
POSITION_NOISE = 0.002  # m
ATTITUDE_NOISE = 0.004  # rad


def influence(vehicle: Vehicle, flown: Vehicle, pose: np.ndarray, velocity: np.ndarray, commands: np.ndarray) -> float:
    """Root mean square error at 2 s of ``vehicle`` on noiseless logs, in the axis that shows it best.

    Args:
        vehicle: one vehicle with everything but the effect in question.
        flown: the same with it.
        pose: (episodes, T, 6) as reported, noiseless.
        velocity: (episodes, T, 6) of the body.
        commands: (episodes, T, n) sent.
    """
    ahead = round(HORIZON_S / CONTROL_DT)
    c, late = _sensors(vehicle)
    # A pose that is reported late looks, in prediction, like commands that arrive late.
    memory = int(np.ceil((float(vehicle.delay) + late) / CONTROL_DT)) + 1
    starts = np.arange(memory, pose.shape[1] - ahead, ahead)

    def pick(series: np.ndarray, shift: int = 0) -> np.ndarray:
        return series[:, starts + shift].reshape(-1, series.shape[2])

    sensors = Inverse.of(c, POSE)
    motion = pick(np.concatenate((pose, _fitting(flown, pose, velocity)), axis=2))
    true = sensors.true_start(motion)
    past = np.stack([pick(commands, -1 - age) for age in range(memory)], axis=1)
    believed = changed(vehicle, delay=vehicle.delay + late)
    c = prepare(believed.expand(len(motion))).numpy()
    terms = ActiveTerms.of(c)
    time = np.tile(starts * CONTROL_DT, len(pose))
    state = rest_state(true[:, :3], true[:, 3:7], true[:, 7:], commands.shape[2], memory)
    state = state._replace(commands=past, thrust=_thrust_at(c, terms, commands, starts), time=time)
    sent = np.stack([pick(commands, step) for step in range(ahead)], axis=1)
    end = simulate(believed, sent, CONTROL_DT * np.arange(ahead + 1), state).states[:, -1]
    error = sensors.reported_start(end)[:, :6] - pick(pose, ahead)
    scaled = np.column_stack((error[:, :3] / POSITION_NOISE, wrap_angle(error[:, 5]) / ATTITUDE_NOISE))
    return float(np.sqrt((scaled**2).mean(axis=0)).max())


def _sensors(vehicle: Vehicle) -> tuple[Coefficients, float]:
    """Coefficients (1,) of a vehicle, and by how many seconds its poses are late."""
    c = prepare(vehicle.expand(1)).numpy()
    return c, float(ages(c, POSE).max())


def _fitting(flown: Vehicle, pose: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """The velocity (episodes, T, 6) that the reported poses change by, of what the body does."""
    c, late = _sensors(flown)
    sensors = Inverse.of(c, POSE)
    attitude = sensors.true_start(np.concatenate((pose, 0 * velocity), axis=2))[..., 3:7]
    time = CONTROL_DT * np.arange(pose.shape[1])
    then = np.stack([[np.interp(time - late, time, number) for number in episode.T] for episode in velocity])
    return sensors.reported_state(np.concatenate((pose[..., :3], attitude, then.swapaxes(1, 2)), axis=2))[..., 7:]


def _thrust_at(c: Coefficients, terms: ActiveTerms, commands: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Thrust (episodes * starts, n) before the starts: it follows from the commands alone, from the first one on."""
    episodes = len(commands)
    one = c.rows(slice(0, episodes))
    lagging = round(float(one.delay[0]) / CONTROL_DT)
    thrust = np.zeros_like(commands[:, 0])
    series = []
    for step in range(commands.shape[1]):
        series.append(thrust)
        if step >= lagging:
            target = thrust_target(one, terms, commands[:, step - lagging])
            thrust = thrust_after(one, terms, thrust, target, CONTROL_DT)
    return np.stack(series, axis=1)[:, starts].reshape(-1, commands.shape[2])
