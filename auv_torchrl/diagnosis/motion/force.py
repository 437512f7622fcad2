"""The force that a change of the vehicle would have added along the motion that was measured.

At a given motion, an effect is a force in time, however large it is and however far the changed vehicle would have
drifted from the measured path in a simulation. That makes every effect nearly linear, a reversed or swapped thruster
included, and one rollout per effect gives its mark on the measurements.
"""

from typing import cast

import numpy as np

from auv_torchrl.diagnosis.motion.reported import (
    as_true,
    reported_motion,
    reported_per_true,
    true_forces,
    true_per_reported,
    turned,
)
from auv_torchrl.diagnosis.motion.rollout import DIVERGING, Actuation, actuate
from auv_torchrl.diagnosis.motion.smooth import Layout, Smoothed, pose_late
from auv_torchrl.diagnosis.motion.tangent import Tangent, respond
from auv_torchrl.diagnosis.motion.windows import CHANNELS, Floats, Windows
from auv_torchrl.physics import prepare
from auv_torchrl.physics.hydrodynamics import acceleration
from auv_torchrl.physics.kinematics import (
    matvec,
    normalise,
    quaternion_from_euler,
    quaternion_product,
    rotation_matrix,
)
from auv_torchrl.physics.thrusters import body_wrench, thrust_after
from auv_torchrl.vehicle import Vehicle

CANDIDATES_AT_ONCE = 16


@DIVERGING
def middles(states: Floats) -> Floats:
    """States (W, S, 13) in the middle of each grid step, of states (W, S + 1, 13) on the grid."""
    middle = 0.5 * (states[:, :-1] + states[:, 1:])
    middle[..., 3:7] = normalise(middle[..., 3:7])
    return middle


@DIVERGING
def force_changes(windows: Windows, nominal: Vehicle, changed: Vehicle, motion: Floats) -> Floats:
    """Force (W, R, S, 6) in N and N m that the changed vehicles (R,) feel beyond the nominal one (1,).

    It is the nominal mass matrix times the difference of the accelerations, so that a change of the inertia counts too.
    """
    sound = actuate(windows, nominal)
    seen = reported_motion(sound.c, windows.channels, motion)
    before, mass = accelerations(sound, seen), sound.c.mass_matrix[:, None]
    rows = changed.batch_size[0]
    pieces = []
    for first in range(0, rows, CANDIDATES_AT_ONCE):
        some = slice(first, min(rows, first + CANDIDATES_AT_ONCE))
        beyond = accelerations(actuate(windows, cast(Vehicle, changed[some])), seen) - before
        pieces.append(matvec(mass, true_forces(sound.c, windows.channels, beyond)))
    return np.concatenate(pieces, axis=1)


def accelerations(actuation: Actuation, motion: Floats) -> Floats:
    """(W, R, S, 6), as reported, of the vehicles of ``actuation`` along a reported ``motion`` (W, S, 13)."""
    windows, c, terms = actuation.windows, actuation.c, actuation.terms
    by_step = c.rows((slice(None), None))  # (R, 1, ...) so that steps are a batch axis
    (target,) = actuation.targets(slice(0, len(windows)), np.arange(windows.steps))
    thrust = target
    if terms.lag:
        left = actuation.thrust
        thrust = np.empty_like(target)
        for step in range(windows.steps):
            thrust[:, :, step] = thrust_after(c, terms, left, target[:, :, step], windows.dt / 2)
            left = thrust_after(c, terms, left, target[:, :, step], windows.dt)
    time = windows.time[:, None, None] + (np.arange(windows.steps) + 0.5) * windows.dt - c.pose_delay[:, None]
    wrench = body_wrench(by_step, terms, thrust, time)
    channels = windows.channels
    position, velocity = as_true(by_step, channels, motion[:, None, :, :3], motion[:, None, :, 7:])
    factor = true_per_reported(by_step, channels)[..., 6:]
    if not c.heading_bias.any():
        rotation = rotation_matrix(motion[:, None, :, 3:7])
        return acceleration(by_step, terms, rotation, position, velocity, wrench) / factor
    zero = np.zeros_like(by_step.heading_bias)
    turn = quaternion_from_euler(zero, zero, -by_step.heading_bias)  # from the reported to the true heading
    to_true = turned(by_step)
    rotation = rotation_matrix(quaternion_product(turn, motion[:, None, :, 3:7]))
    rate = acceleration(by_step, terms, rotation, position, matvec(to_true, velocity), wrench)
    return matvec(to_true.mT, rate) / factor


def marks(windows: Windows, vehicle: Vehicle, layout: Layout, state: Smoothed, forces: Floats) -> Floats:
    """How forces (W, R, S, 6) along the measured motion would show in the samples, to first order: (W, K, R)."""
    moves = layout.start[: len(layout.start) // 2]
    pushed = forces[..., moves].transpose(0, 2, 3, 1)
    nothing = np.zeros((1, len(layout.start), forces.shape[1]))
    tangent = Tangent(state.transition, state.push, reported_per_true(prepare(vehicle).numpy())[0])
    return respond(windows, layout.start, tangent, nothing, pushed, pose_late(windows, vehicle))


def reading_changes(windows: Windows, nominal: Vehicle, changed: Vehicle, motion: Floats) -> Floats | None:
    """What velocities (W, K, R) read beyond those of the nominal vehicle (1,) where positions read the same.

    None where the vehicles ``changed`` (R,) report velocities as the nominal one does. ``motion`` (W, S, 13) is the
    true one of the nominal vehicle.
    """
    before, after = (prepare(vehicle).numpy() for vehicle in (nominal, changed))
    gains = [reported_per_true(c)[..., 6:] * true_per_reported(c, windows.channels)[..., 6:] for c in (before, after)]
    beyond = gains[1] - gains[0]  # (R, 6), of what positions say of the velocity
    if not beyond.any():
        return None
    seen = reported_motion(before, windows.channels, motion)
    step = np.minimum(windows.index, motion.shape[1] - 1)
    shown = np.zeros((*windows.measured.shape, len(beyond)))
    for column, name in enumerate(windows.channels):
        if name in CHANNELS[6:]:
            which = CHANNELS.index(name)
            speed = seen[np.arange(len(windows))[:, None], step, 1 + which]
            shown[:, :, column] = speed[..., None] * beyond[:, which - 6]
    shown *= windows.trust[..., None]
    return shown.reshape(len(windows), -1, len(beyond))
