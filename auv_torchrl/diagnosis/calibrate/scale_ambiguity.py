"""The scale ambiguity: directions in which all coefficients change and no motion does.

Twice the inertia with twice the thrust and drag moves alike, so no log tells the overall scale of a vehicle. A fit that
is free in the scale runs away: the disturbance is in newtons, and a lighter vehicle needs less of it. The scale is
therefore put where the vehicle's file is nearest.

Tilts tell the scale, because weight is known. Where nobody measures tilts, they tell too little to hold a fit.
"""

from collections.abc import Sequence

import numpy as np

from auv_torchrl.diagnosis.axes import held_level
from auv_torchrl.diagnosis.calibrate.parameters import VehicleEstimate
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
LOOSE = 0.01  # share of the scale's variance that stays, so that the covariance can be inverted
STEP = 1e-4  # of a width, for slopes
UNSEEN = 1e-5  # of the largest slope: the error of the slopes


def restore_file_scale(estimate: VehicleEstimate) -> VehicleEstimate:
    """The same vehicle, with its overall scale as near to the file's as possible, in widths of the file.

    The directions that leave every motion as it is bend, because thrusts times arms are a moment. The function
    therefore follows them in short steps.
    """
    for _ in range(STEPS):
        (offset, precision), reach = estimate.file_prior, REACH * estimate.nuisance.width
        low, high = estimate.bounds
        directions = find_ambiguous_directions(estimate.vehicle, estimate.nuisance.entries)
        bounds = np.maximum(low, -reach), np.minimum(high, reach)
        step = least_within(precision, precision @ offset, bounds, directions)
        estimate = estimate.shifted(step)
        if (np.abs(step) < SETTLED * reach + STEP * reach.max()).all():
            break
    return estimate


def hold_scale(covariance: Floats, estimate: VehicleEstimate, hides_tilts: bool = False) -> Floats:
    """The covariance (k, k) with the overall scale held, but for the share ``LOOSE`` of its variance.

    A search that may scale everything does so to spare a little elsewhere, and a dead thruster comes to life on the
    way. :func:`measure_ambiguity` says how uncertain the scale leaves each number all the same.
    """
    along = estimate.file_prior[1] @ _ambiguous_directions_of(estimate, hides_tilts)
    goes = covariance @ along
    held: Floats = covariance - (1 - LOOSE) * goes @ np.linalg.pinv(along.T @ goes, hermitian=True) @ goes.T
    return 0.5 * (held + held.T)


def measure_ambiguity(estimate: VehicleEstimate, hides_tilts: bool = False) -> Floats:
    """By how much (k, g) each number may be off with each of g scales that no flight tells, one deviation of each.

    A vehicle whose heave has thrusters of its own has two scales. An effect that acts on heave and sway alike, such as
    a tether, is then as uncertain as the ratio of the scales.
    """
    along = _ambiguous_directions_of(estimate, hides_tilts)
    size, mixed = np.linalg.eigh(along.T @ estimate.file_prior[1] @ along)
    found: Floats = along @ mixed / np.sqrt(size)
    return found


def _ambiguous_directions_of(estimate: VehicleEstimate, hides_tilts: bool) -> Floats:
    """Ambiguous directions (k, g) in the motions of a log; ``hides_tilts`` tells that nobody measures tilts."""
    vehicle = held_level(estimate.vehicle) if hides_tilts else estimate.vehicle
    return find_ambiguous_directions(vehicle, estimate.nuisance.entries)


def find_ambiguous_directions(vehicle: Vehicle, nuisance: Sequence[NuisanceEntry]) -> Floats:
    """Changes (k, g) of nuisance parameters that leave every acceleration as it is, in all motions and commands.

    Parameters that act through time alone, such as delays, and parameters that change reports are not among them.
    """
    widths = np.array([width for *_, width in nuisance])
    rows = []
    for (effect, member, nominal, _), width in zip(nuisance, widths.tolist(), strict=True):
        rows += [{effect: {member: nominal + sign * STEP * width}} for sign in (1, -1)]
    moves = vehicle.free > 0
    rates = sample_accelerations(batch(vehicle, rows), moves)
    slopes = (rates[0::2] - rates[1::2]).reshape(len(nuisance), -1).T / (2 * STEP)
    acts = np.flatnonzero(np.abs(slopes).max(0) > UNSEEN * np.abs(slopes).max())
    _, size, directions = np.linalg.svd(slopes[:, acts], full_matrices=False)
    unseen = directions[size < UNSEEN * size[0]]
    found = np.zeros((len(nuisance), len(unseen)))
    found[acts] = np.where(np.abs(unseen) > UNSEEN, unseen, 0.0).T  # else a number of no width would pull by rounding
    return found * widths[:, None]


def sample_accelerations(vehicles: Vehicle, moves: np.ndarray) -> Floats:
    """Accelerations (R, N, 6) of vehicles (R,) in N motions at random, the same ones in every call.

    Args:
        vehicles: nominal or changed, with a batch.
        moves: (6,) bool, the degrees of freedom in which the vehicles move.
    """
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
