"""A first look at the motion: local parabolas through the samples, and the force that the simulator misses there.

It is noisy and only a place to begin from; the smoother then follows the samples by simulation.
"""

import numpy as np

from auv_torchrl.diagnosis.motion.actuation import actuate
from auv_torchrl.diagnosis.motion.force import accelerations
from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.motion.smooth import Layout
from auv_torchrl.diagnosis.motion.windows import Floats, Windows, columns_of_motion
from auv_torchrl.physics import Coefficients
from auv_torchrl.physics.kinematics import cross, matvec, quaternion_from_euler, rotation_matrix
from auv_torchrl.sensors import FELT, MOTION, motion_of, read
from auv_torchrl.vehicle import Vehicle

REACH_S = 0.25  # half width of the parabolas; wider where samples are sparse
LEAST_SAMPLES = 6


def local_parabolas(windows: Windows, times: Floats) -> Floats:
    """Value, first and second derivative (W, B, 3, C) of every channel at ``times`` (B,) s into the windows."""
    at = windows.sampled
    measured = windows.measured.copy()
    measured[..., windows.angular] = np.unwrap(measured[..., windows.angular], axis=1)
    away = at[:, None] - times[:, None]  # (W, B, m)
    distance = np.where(windows.present[:, None], np.abs(away), np.inf)
    least = min(LEAST_SAMPLES, distance.shape[-1])
    reach = np.maximum(np.partition(distance, least - 1, axis=-1)[..., least - 1] * 1.01, REACH_S)
    weight = (distance <= reach[..., None]).astype(float)
    powers = np.stack([np.ones_like(away), away, 0.5 * away**2], axis=-1) * weight[..., None]  # (W, B, m, 3)
    gram = powers.swapaxes(-1, -2) @ powers + 1e-12 * np.eye(3)
    return np.linalg.solve(gram, powers.swapaxes(-1, -2) @ measured[:, None])


@DIVERGING
def rough_force(windows: Windows, vehicle: Vehicle, layout: Layout) -> Floats:
    """Missing force (W, B, D) in N and N m per bin; ``vehicle`` is a batch (1,)."""
    centres = (np.arange(layout.bins) + 0.5) * layout.steps_per_bin * windows.dt
    centres = np.minimum(centres, (windows.steps - 0.5) * windows.dt)
    fits = local_parabolas(windows, centres)
    value, slope, bend = (_spread(windows, fits[:, :, order]) for order in range(3))  # (W, B, 12) each
    quaternion = quaternion_from_euler(value[..., 3], value[..., 4], value[..., 5])
    to_body = rotation_matrix(quaternion).swapaxes(-1, -2)
    velocity, rate = value[..., 6:].copy(), slope[..., 6:].copy()
    spinning = slope[..., 3:6]  # Euler rates serve as body rates: roll and pitch are small
    for columns, first, second in (
        (slice(0, 3), matvec(to_body, slope[..., :3]), matvec(to_body, bend[..., :3])),
        (slice(3, 6), slope[..., 3:6], bend[..., 3:6]),
    ):
        turning = cross(spinning, first) if columns.start == 0 else 0.0
        known = np.array([channel in windows.channels for channel in MOTION[6:][columns]])
        velocity[..., columns] = np.where(known, velocity[..., columns], first)
        rate[..., columns] = np.where(known, rate[..., columns], second - turning)
    motion = np.concatenate([value[..., :3], quaternion, velocity], axis=-1)
    by_step = np.repeat(motion, layout.steps_per_bin, axis=1)[:, : windows.steps]
    actuation = actuate(windows, vehicle)
    rate[..., :3] = _where_felt_alone(windows, actuation.c, fits[:, :, 0], motion, rate[..., :3])
    predicted = accelerations(actuation, by_step)[:, 0]
    missing = np.repeat(rate, layout.steps_per_bin, axis=1)[:, : windows.steps] - predicted
    missing = actuation.sensors.true_rate(missing, by_step)
    force = matvec(actuation.c.mass_matrix[0], missing)[..., layout.dof]
    edges = np.arange(0, windows.steps, layout.steps_per_bin)
    counts = np.diff(np.append(edges, windows.steps))
    return np.add.reduceat(force, edges, axis=1) / counts[:, None]


def _where_felt_alone(windows: Windows, c: Coefficients, fits: Floats, motion: Floats, rate: Floats) -> Floats:
    """Accelerations (W, B, 3), as the fits (W, B, C) of what is felt say along axes that nothing else tells of."""
    rate = rate.copy()
    for axis, name in enumerate(FELT):
        if name in windows.channels and not {MOTION[axis], MOTION[6 + axis]} & set(windows.channels):
            weight = read(c.rows((slice(None), None)), (name,), motion_of(motion))[..., 0]
            rate[..., axis] = fits[..., windows.channels.index(name)] - weight
    return rate


def _spread(windows: Windows, values: Floats) -> Floats:
    """Values (W, B, C) of the channels as columns of all twelve, zero where not measured."""
    full = np.zeros((*values.shape[:-1], 12))
    moved, columns = columns_of_motion(windows.channels)
    full[..., columns] = values[..., moved]
    return full
