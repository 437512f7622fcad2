"""Directions in which all coefficients change and no motion does: twice the inertia with twice the thrust and drag.

No log tells the overall scale of a vehicle. Left to a fit it runs away, because a disturbance is in newtons, and a
lighter vehicle needs less of it. So it is put where the file is nearest.

Tilts tell it, for weight is known; where nobody measures them, that is too little to keep a fit from running away.
"""

from collections.abc import Sequence

import numpy as np

from auv_torchrl.diagnosis.calibrate.nuisance import Centred
from auv_torchrl.diagnosis.identify.attitude import held_level
from auv_torchrl.diagnosis.identify.hypotheses import batch
from auv_torchrl.diagnosis.identify.problem import NuisanceEntry
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.hydrodynamics import acceleration
from auv_torchrl.physics.kinematics import quaternion_from_euler, rotation_matrix
from auv_torchrl.physics.surface import given_in_water
from auv_torchrl.physics.thrusters import body_wrench, thrust_target
from auv_torchrl.sysid.bounded import least_within
from auv_torchrl.vehicle import Vehicle

MOTIONS = 300  # drawn at random, several times the numbers that they are to tell apart
TILT = 0.3  # rad of roll and pitch among them
STEPS, REACH = 100, 0.25  # at most, and of a width: a step within which directions hardly turn
SETTLED = 0.01  # of that step
LOOSE = 0.01  # so that the covariance can be inverted
STEP = 1e-4  # of a width, for slopes
UNSEEN = 1e-5  # of the largest slope: the error of the slopes


def scaled_as_the_file(centred: Centred) -> Centred:
    """The same vehicle, with an overall scale, which no flight tells, as near to the file's as it gets, in its widths.

    What leaves every motion as it is bends, for thrusts times arms are a moment: it is followed in short steps.
    """
    for _ in range(STEPS):
        (away, nearer), reach = centred.prior, REACH * centred.nuisance.width
        low, high = centred.bounds
        unseen = unseen_directions(centred.vehicle, centred.nuisance.entries)
        bounds = np.maximum(low, -reach), np.minimum(high, reach)
        step = least_within(nearer, nearer @ away, bounds, unseen)
        centred = centred.shifted(step)
        if (np.abs(step) < SETTLED * reach + STEP * reach.max()).all():
            break
    return centred


def hold_scale(covariance: Floats, centred: Centred, hides: bool = False) -> Floats:
    """The covariance (k, k) of deviations that leave the overall scale where it is, but for ``LOOSE`` of its variance.

    A search that may scale everything does so to spare a little elsewhere, and a dead thruster comes to life on the
    way. What it owes to the scale a value is unsure of all the same (:func:`scales_left_open`).
    """
    along = centred.prior[1] @ _unseen(centred, hides)
    goes = covariance @ along
    held: Floats = covariance - (1 - LOOSE) * goes @ np.linalg.pinv(along.T @ goes, hermitian=True) @ goes.T
    return 0.5 * (held + held.T)


def scales_left_open(centred: Centred, hides: bool = False) -> Floats:
    """By how much (k, g) each number of a vehicle may be off with each scale that no flight tells, one deviation of it.

    A vehicle whose heave has thrusters of its own has two scales, and what acts on heave and sway alike, as a tether
    does, is as unsure as what one of them is to the other.
    """
    along = _unseen(centred, hides)
    size, mixed = np.linalg.eigh(along.T @ centred.prior[1] @ along)
    found: Floats = along @ mixed / np.sqrt(size)
    return found


def _unseen(centred: Centred, hides: bool) -> Floats:
    """Unseen directions (k, g) in the motions that logs show; ``hides`` is whether these lack its tilts."""
    vehicle = held_level(centred.vehicle) if hides else centred.vehicle
    return unseen_directions(vehicle, centred.nuisance.entries)


def unseen_directions(vehicle: Vehicle, nuisance: Sequence[NuisanceEntry]) -> Floats:
    """Changes (k, g) of slack that leave every acceleration as it is, whatever the motion and the commands.

    What acts through time alone, as a delay does, and what changes reports is not among them.
    """
    widths = np.array([width for *_, width in nuisance])
    rows = []
    for (effect, member, nominal, _), width in zip(nuisance, widths.tolist(), strict=True):
        rows += [{effect: {member: nominal + sign * STEP * width}} for sign in (1, -1)]
    moves = vehicle.free.numpy() > 0
    rates = _accelerations(batch(vehicle, rows), moves)
    slopes = (rates[0::2] - rates[1::2]).reshape(len(nuisance), -1).T / (2 * STEP)
    acts = np.flatnonzero(np.abs(slopes).max(0) > UNSEEN * np.abs(slopes).max())
    _, size, directions = np.linalg.svd(slopes[:, acts], full_matrices=False)
    unseen = directions[size < UNSEEN * size[0]]
    found = np.zeros((len(nuisance), len(unseen)))
    found[acts] = unseen.T
    return found * widths[:, None]


def _accelerations(vehicles: Vehicle, moves: np.ndarray) -> Floats:
    """(R, N, 6) of vehicles (R,) in motions that are drawn once and for all."""
    rng, shape = np.random.default_rng(0), (len(vehicles), MOTIONS)
    c = prepare(vehicles).numpy()
    by_motion, terms = c.rows((slice(None), None)), ActiveTerms.of(c)

    def drawn(low: Floats | float, high: Floats | float, *entries: int) -> Floats:
        return np.broadcast_to(rng.uniform(low, high, (1, MOTIONS, *entries)), (*shape, *entries))

    velocity, place = drawn(-1.0, 1.0, 6) * moves, drawn(-1.0, 1.0, 3)
    roll, pitch = (drawn(-TILT, TILT) * free for free in moves[3:5])
    attitude = quaternion_from_euler(roll, pitch, drawn(-np.pi, np.pi))
    thrust = thrust_target(by_motion, terms, drawn(-1.0, 1.0, vehicles.thrusters))
    rotation = rotation_matrix(attitude)
    wrench = body_wrench(by_motion, terms, given_in_water(by_motion, terms, thrust, rotation, place), np.zeros(shape))
    return acceleration(by_motion, terms, rotation, place, velocity, wrench)
