"""Block averages of a log: velocities out of poses, and how the vehicle answers its commands.

Poses are never differentiated from sample to sample: over a block of :data:`BLOCK_S` the noise of 2 mm that a
motion-capture system has is 6 mm/s.
"""

from typing import NamedTuple

import numpy as np

from auv_torchrl.flightlog.log import Episode, Floats
from auv_torchrl.flightlog.signals import integral, interpolate
from auv_torchrl.physics import ActiveTerms, Coefficients, prepare
from auv_torchrl.physics.hydrodynamics import acceleration
from auv_torchrl.physics.kinematics import matvec, quaternion_from_euler, rotation_matrix
from auv_torchrl.physics.thrusters import body_wrench, thrust_target
from auv_torchrl.sensors import MOTION, Inverse
from auv_torchrl.vehicle import Vehicle

BLOCK_S = 0.5
_BLOCK_SAMPLES = 3  # at least, where the log is slow
FEWEST_BLOCKS = 12  # from which motion and thrusters are compared
SLOWEST = 0.02  # m/s, root mean square speed below which positions and velocities cannot be compared


class Blocks(NamedTuple):
    """Averages over consecutive blocks of all episodes; B blocks."""

    attitude: Floats  # (B, 3) rad, in the middle; roll and pitch 0 where not measured, yaw NaN
    rate: Floats  # (B, 4) d(x, y, z, yaw)/dt in m/s and rad/s, earth; NaN where not measured
    velocity: Floats  # (B, 6) measured body velocity; NaN where not measured
    thrust: Floats  # (B, n) N; mean from the middle of the block before to the middle of this one
    length: Floats  # (B,) s
    joined: np.ndarray  # (B,) whether the block follows the one before without a break
    vehicle: Coefficients  # of the vehicle whose thrust it is


class Response(NamedTuple):
    """How the acceleration that the thrusters should give shows in the measured one, along one axis."""

    correlation: float
    slope: float  # 1 for the nominal vehicle


def blocks(episodes: tuple[Episode, ...], vehicle: Vehicle, late: float = 0.0) -> Blocks:
    """Average the episodes; those shorter than three blocks are left out.

    Velocities are taken ``late`` seconds after the poses that they belong to.
    """
    c = prepare(vehicle).numpy()
    parts = [part for episode in episodes if (part := _episode_blocks(episode, c, late)) is not None]
    if not parts:
        empty = np.empty
        nothing = empty((0, vehicle.thrusters)), empty(0), empty(0, dtype=bool)
        return Blocks(empty((0, 3)), empty((0, 4)), empty((0, 6)), *nothing, c)
    averages = {name: np.concatenate([getattr(part, name) for part in parts]) for name in Blocks._fields[:-1]}
    return Blocks(**averages, vehicle=c)


def _episode_blocks(episode: Episode, c: Coefficients, late: float) -> Blocks | None:
    t = episode.t
    block = max(BLOCK_S, _BLOCK_SAMPLES * float(np.median(np.diff(t))))
    count = int((t[-1] - t[0]) / block)
    if count < 3:
        return None
    edges = t[0] + block * np.arange(count + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    angles = np.unwrap(episode.pose[:, 3:], axis=0)
    pose = np.concatenate((episode.pose[:, :3], angles), axis=-1)
    at_edges = interpolate(edges, t, pose)
    attitude = (at_edges[1:, 3:] + at_edges[:-1, 3:]) / 2
    attitude[:, :2] = np.nan_to_num(attitude[:, :2])
    rate = np.diff(at_edges, axis=0)[:, [0, 1, 2, 5]] / block
    velocity = _mean_between(edges + late, t, episode.velocity)
    velocity[edges[1:] + late > t[-1]] = np.nan
    velocity = _of_the_origin(velocity, c)
    thrust = thrust_target(c, ActiveTerms.of(c), episode.commands)
    between = _mean_between(np.concatenate((edges[:1], middle)), t, thrust, held=True)
    joined = np.arange(count) > 0
    return Blocks(attitude, rate, velocity, between, np.full(count, block), joined, c)


def _of_the_origin(velocity: Floats, c: Coefficients) -> Floats:
    """Velocities (B, 6) of the body, of those of a Doppler log that is mounted as the vehicle's file says."""
    mixing = Inverse.of(c.rows(None), MOTION[6:]).mixing
    if mixing is None:
        return velocity
    known = np.nan_to_num(velocity)
    linear = mixing.true(known[:, :3], known[:, 3:], known[:, :3])
    return np.where(np.isnan(velocity), np.nan, np.concatenate([linear, known[:, 3:]], axis=-1))


def _mean_between(edges: Floats, t: Floats, values: Floats, held: bool = False) -> Floats:
    """Mean (B, k) of a signal between consecutive edges: held from sample to sample, or linear between them."""
    return np.diff(interpolate(edges, t, integral(t, values, held)), axis=0) / np.diff(edges)[:, None]


def rotations(attitude: Floats) -> Floats:
    """Rotation matrices (B, 3, 3) from body to earth of roll, pitch, yaw (B, 3)."""
    return rotation_matrix(quaternion_from_euler(*attitude.T))


def body_velocity(b: Blocks) -> Floats:
    """Body velocity (B, 6) from the poses, or as measured where poses lack; 0 for axes that nothing measures."""
    turned = rotations(np.nan_to_num(b.attitude))  # without a heading, what lies across it is not used
    from_pose = matvec(turned.swapaxes(-1, -2), np.nan_to_num(b.rate[:, :3]))
    from_pose[~np.isfinite(b.rate[:, :2]).all(-1) | ~np.isfinite(b.attitude[:, 2]), :2] = np.nan
    from_pose[~np.isfinite(b.rate[:, 2]), 2] = np.nan
    velocity = b.velocity.copy()
    velocity[:, :3] = np.where(np.isfinite(velocity[:, :3]), velocity[:, :3], from_pose)
    velocity[:, 5] = np.where(np.isnan(velocity[:, 5]), b.rate[:, 3], velocity[:, 5])
    return np.where(np.isfinite(velocity).any(0), velocity, 0.0)


def driven_accelerations(b: Blocks) -> tuple[Floats, Floats]:
    """What the thrusters should add to the acceleration (P, 6) and what the motion shows that they do; may be empty."""
    velocity = body_velocity(b)
    pair = np.flatnonzero(b.joined & np.isfinite(velocity).all(-1))
    pair = pair[np.isfinite(velocity[pair - 1]).all(-1)]
    c, terms = b.vehicle, ActiveTerms.of(b.vehicle)
    mean = (velocity[pair] + velocity[pair - 1]) / 2
    rotation = rotations(np.nan_to_num(b.attitude[pair] + b.attitude[pair - 1]) / 2)
    position = np.zeros((len(pair), 3))
    wrench = body_wrench(c, terms, b.thrust[pair], np.zeros(len(pair)))
    coasting = acceleration(c, terms, rotation, position, mean, np.zeros_like(wrench))
    expected = acceleration(c, terms, rotation, position, mean, wrench) - coasting
    return expected, (velocity[pair] - velocity[pair - 1]) / b.length[pair, None] - coasting


def responses(b: Blocks) -> dict[str, Response]:
    """Response of each of surge, sway, heave and yaw that is measured and driven; too few blocks give none."""
    return {
        name: Response(float(x @ y / np.sqrt((x @ x) * (y @ y))), float(x @ y / (x @ x)))
        for name, (x, y) in _changes(b).items()
    }


def force_balance(b: Blocks) -> float:
    """Share of what the thrusters push that the motion shows, mean over the driven axes; 1 is a perfect simulator.

    -inf where too little is driven or measured.
    """
    with np.errstate(over="ignore"):
        shares = [1.0 - float(((y - x) ** 2).sum() / (x @ x)) for x, y in _changes(b).values()]
    return float(np.mean(shares)) if shares else -np.inf


def _changes(b: Blocks) -> dict[str, tuple[Floats, Floats]]:
    """Expected and measured accelerations about their means, by axis that is driven; too few blocks give none."""
    accelerations = driven_accelerations(b)
    if len(accelerations[0]) < FEWEST_BLOCKS:
        return {}
    found = {}
    for axis, name in _DRIVEN.items():
        x, y = (values[:, axis] - values[:, axis].mean() for values in accelerations)
        if x.std() > _SMALLEST_DRIVE and y.std() > 0:
            found[name] = x, y
    return found


_DRIVEN = {0: "surge", 1: "sway", 2: "heave", 5: "yaw"}
_SMALLEST_DRIVE = 0.05  # m/s^2, rad/s^2: ten times what 2 mm of noise makes of a block
