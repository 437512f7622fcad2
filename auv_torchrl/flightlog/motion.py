"""Block averages of a log: velocities out of poses, and how the vehicle answers its commands.

Poses are never differentiated from sample to sample: over a block of :data:`BLOCK_S` the noise of 2 mm that a
motion-capture system has is 6 mm/s.
"""

from typing import NamedTuple

import numpy as np

from auv_torchrl.flightlog.log import Episode, Floats
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.hydrodynamics import acceleration
from auv_torchrl.physics.kinematics import matvec, quaternion_from_euler, rotation_matrix
from auv_torchrl.physics.thrusters import body_wrench, thrust_target
from auv_torchrl.vehicle import Vehicle

BLOCK_S = 0.5
_BLOCK_SAMPLES = 3  # at least, where the log is slow


class Blocks(NamedTuple):
    """Averages over consecutive blocks of all episodes; B blocks."""

    attitude: Floats  # (B, 3) rad, in the middle; roll and pitch 0 where not measured, yaw NaN
    rate: Floats  # (B, 4) d(x, y, z, yaw)/dt in m/s and rad/s, earth; NaN where not measured
    velocity: Floats  # (B, 6) measured body velocity; NaN where not measured
    thrust: Floats  # (B + 1, n) N; mean from the middle of the block before to the middle of this one
    length: Floats  # (B,) s
    joined: np.ndarray  # (B,) whether the block follows the one before without a break


class Response(NamedTuple):
    """How the acceleration that the thrusters should give shows in the measured one, along one axis."""

    correlation: float
    slope: float  # 1 for the nominal vehicle
    size: float  # standard deviation of the expected acceleration, m/s^2 or rad/s^2


def blocks(episodes: tuple[Episode, ...], vehicle: Vehicle) -> Blocks:
    """Average the episodes; those shorter than three blocks are left out."""
    parts = [part for episode in episodes if (part := _episode_blocks(episode, vehicle)) is not None]
    if not parts:
        empty = np.empty
        return Blocks(
            empty((0, 3)), empty((0, 4)), empty((0, 6)), empty((0, vehicle.thrusters)), empty(0), empty(0, dtype=bool)
        )
    return Blocks(*(np.concatenate(field) for field in zip(*parts, strict=True)))


def _episode_blocks(episode: Episode, vehicle: Vehicle) -> Blocks | None:
    t = episode.t
    block = max(BLOCK_S, _BLOCK_SAMPLES * float(np.median(np.diff(t))))
    count = int((t[-1] - t[0]) / block)
    if count < 3:
        return None
    edges = t[0] + block * np.arange(count + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    angles = np.unwrap(episode.pose[:, 3:], axis=0)
    pose = np.concatenate((episode.pose[:, :3], angles), axis=-1)
    at_edges = _interpolate(edges, t, pose)
    attitude = (at_edges[1:, 3:] + at_edges[:-1, 3:]) / 2
    attitude[:, :2] = np.nan_to_num(attitude[:, :2])
    rate = np.diff(at_edges, axis=0)[:, [0, 1, 2, 5]] / block
    velocity = _mean_between(edges, t, episode.velocity)
    coefficients = prepare(vehicle).numpy()
    thrust = thrust_target(coefficients, ActiveTerms.of(coefficients), episode.commands)
    between = _mean_between(np.concatenate((edges[:1], middle)), t, thrust, held=True)
    joined = np.arange(count) > 0
    return Blocks(attitude, rate, velocity, between, np.full(count, block), joined)


def _interpolate(at: Floats, t: Floats, values: Floats) -> Floats:
    return np.stack([np.interp(at, t, column) for column in values.T], axis=-1)


def _mean_between(edges: Floats, t: Floats, values: Floats, held: bool = False) -> Floats:
    """Mean (B, k) of a signal between consecutive edges: held from sample to sample, or linear between them."""
    area = values[:-1] if held else (values[:-1] + values[1:]) / 2
    steps = np.diff(t)[:, None]
    integral = np.concatenate((np.zeros((1, values.shape[1])), np.cumsum(area * steps, axis=0)))
    return np.diff(_interpolate(edges, t, integral), axis=0) / np.diff(edges)[:, None]


def rotations(attitude: Floats) -> Floats:
    """Rotation matrices (B, 3, 3) from body to earth of roll, pitch, yaw (B, 3)."""
    return rotation_matrix(quaternion_from_euler(*attitude.T))


def body_velocity(b: Blocks) -> Floats:
    """Body velocity (B, 6) from the poses, or as measured where poses lack; 0 for axes that nothing measures."""
    from_pose = matvec(rotations(b.attitude).swapaxes(-1, -2), b.rate[:, :3])
    velocity = b.velocity.copy()
    lacking = np.isnan(velocity[:, :3]).any(axis=-1)
    velocity[lacking, :3] = from_pose[lacking]
    velocity[:, 5] = np.where(np.isnan(velocity[:, 5]), b.rate[:, 3], velocity[:, 5])
    velocity[:, 3:5] = np.nan_to_num(velocity[:, 3:5])
    return velocity


def responses(b: Blocks, vehicle: Vehicle) -> dict[str, Response]:
    """Response of each of surge, sway, heave and yaw that is measured and driven; too few blocks give none."""
    velocity = body_velocity(b)
    pair = np.flatnonzero(b.joined & np.isfinite(velocity).all(-1))
    pair = pair[np.isfinite(velocity[pair - 1]).all(-1)]
    if len(pair) < _FEWEST_BLOCKS:
        return {}
    c = prepare(vehicle).numpy()
    terms = ActiveTerms.of(c)
    mean = (velocity[pair] + velocity[pair - 1]) / 2
    rotation = rotations((b.attitude[pair] + b.attitude[pair - 1]) / 2)
    position = np.zeros((len(pair), 3))
    wrench = body_wrench(c, terms, b.thrust[pair], np.zeros(len(pair)))
    coasting = acceleration(c, terms, rotation, position, mean, np.zeros_like(wrench))
    expected = acceleration(c, terms, rotation, position, mean, wrench) - coasting
    measured = (velocity[pair] - velocity[pair - 1]) / b.length[pair, None] - coasting
    found = {}
    for axis, name in _DRIVEN.items():
        x = expected[:, axis] - expected[:, axis].mean()
        y = measured[:, axis] - measured[:, axis].mean()
        if x.std() > _SMALLEST_DRIVE and y.std() > 0:
            found[name] = Response(float(x @ y / np.sqrt((x @ x) * (y @ y))), float(x @ y / (x @ x)), float(x.std()))
    return found


_DRIVEN = {0: "surge", 1: "sway", 2: "heave", 5: "yaw"}
_FEWEST_BLOCKS = 12
_SMALLEST_DRIVE = 0.05  # m/s^2, rad/s^2: ten times what 2 mm of noise makes of a block
