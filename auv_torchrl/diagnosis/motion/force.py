"""The force that a change of the vehicle would have added along the measured motion, and its response in the samples.

At a given motion an effect is a force over time, however far a simulation of the changed vehicle would drift from the
measured path. So every effect is nearly linear, a reversed or swapped thruster included. One pass along the motion
gives the response of the samples to an effect.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from auv_torchrl.diagnosis.motion.actuation import actuate_prepared, sensors_of
from auv_torchrl.diagnosis.motion.rollout import DIVERGING, accelerations, ahead, mean_specific_forces
from auv_torchrl.diagnosis.motion.smooth import Layout, Smoothed
from auv_torchrl.diagnosis.motion.tangent import Tangent, respond
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.physics import Coefficients
from auv_torchrl.physics.kinematics import least_turn, matvec, normalise
from auv_torchrl.sensors import Inverse, motion_of, read, report_the_same

CANDIDATES_AT_ONCE = 64  # vehicles: as many arrays of them as there are at once stay below 0.1 GB
READ_AT_ONCE = 300  # windows of vehicles: their arrays stay in the cache of a laptop
PROBED = 3  # windows that show which vehicles report something else
SAME = 1e-9  # m, rad, m/s, rad/s: rounding


@DIVERGING
def middles(states: Floats) -> Floats:
    """States (W, S, 13) in the middle of each grid step, of states (W, S + 1, 13) on the grid."""
    middle = 0.5 * (states[:, :-1] + states[:, 1:])
    middle[..., 3:7] = normalise(middle[..., 3:7])
    return middle


@dataclass(frozen=True)
class MeasuredMotion:
    """A measured motion, and the accelerations of the nominal vehicle along it."""

    windows: Windows
    sensors: Inverse  # of the vehicle (1,)
    mass: Floats  # (1, 1, 6, 6)
    seen: Floats  # (W, S, 13) the motion as reported
    rate: Floats  # (W, 1, S, 6) accelerations of the vehicle there, as reported

    @staticmethod
    @DIVERGING
    def of(windows: Windows, nominal: Coefficients, motion: Floats) -> "MeasuredMotion":
        """The true ``motion`` (W, S, 13) with the accelerations of a vehicle (1,)."""
        actuation = actuate_prepared(windows, nominal)
        seen = actuation.sensors.reported_state(motion)
        return MeasuredMotion(
            windows, actuation.sensors, actuation.c.mass_matrix[:, None], seen, accelerations(actuation, seen)
        )

    def rows(self, some: slice) -> "MeasuredMotion":
        """The measured motion of some windows."""
        if some == slice(0, len(self.windows)):
            return self
        return replace(self, windows=self.windows.subset(some), seen=self.seen[some], rate=self.rate[some])

    @DIVERGING
    def forces(self, changed: Coefficients) -> Floats:
        """Force (W, R, S, 6) in N and N m on changed vehicles (R,) less that on the nominal one.

        The force is the nominal mass matrix times the difference of the accelerations, so a changed inertia counts too.
        """
        windows, sensors = self.windows, self.sensors
        forces = np.empty((len(windows), len(changed.lag), windows.steps, 6))
        slow = (changed.lag > 0).any(-1) | (changed.delay > 0)  # what one needs is worked out for all with it
        for sensed in Inverse.of(changed, windows.channels).kinds():
            for some in (*_chunks(sensed[~slow[sensed]]), *_chunks(sensed[slow[sensed]])):
                there = actuate_prepared(windows, changed.rows(some))
                beyond = accelerations(there, self.seen) - self.rate
                forces[:, some] = matvec(self.mass, sensors.true_rate(beyond, self.seen[:, None]))
        return forces


def _chunks(rows: np.ndarray) -> list[np.ndarray]:
    return [rows[first : first + CANDIDATES_AT_ONCE] for first in range(0, len(rows), CANDIDATES_AT_ONCE)]


def responses(windows: Windows, c: Coefficients, layout: Layout, state: Smoothed, forces: Floats) -> Floats:
    """Responses (W, K, R) of the samples to forces (W, R, S, 6) along the measured motion, to first order."""
    moves = layout.start[: len(layout.start) // 2]
    pushed = forces[..., moves].transpose(0, 2, 3, 1)
    nothing = np.zeros((1, len(layout.start), forces.shape[1]))
    tangent = Tangent.of(windows, c, layout.start, state.transition, state.push, state.feel)
    return respond(windows, tangent, nothing, pushed)


@DIVERGING
def reading_changes(windows: Windows, before: Coefficients, after: Coefficients, states: Floats) -> Floats | None:
    """Reports (W, K, R) of vehicles (R,) less those of the nominal one (1,), for motions that give the same report.

    A vehicle whose positions are scaled, or whose compass is off, moves otherwise than reported, and its other sensors
    show that: a speed that positions show is also a speed that a Doppler log reads. None where all vehicles report the
    same. ``states`` (W, S + 1, 13) are the true ones of the nominal vehicle.
    """
    first, kind = report_the_same(before, after, windows.channels)
    if not len(first):
        return None
    seen = sensors_of(before, windows.channels).reported_state(states)[:, None]
    now = _readings(windows, before, seen)

    def beyond(c: Coefficients, some: Any) -> Floats:
        change = _readings(windows.subset(some), c, seen[some]) - now[some]
        change[..., windows.angular] = least_turn(change[..., windows.angular])
        return change

    few = np.linspace(0, len(windows) - 1, PROBED).astype(int)
    other = np.flatnonzero(np.abs(beyond(after.rows(first), few)).max((0, 2, 3)) > SAME)
    if not len(other):
        return None
    shown = np.zeros((*windows.measured.shape, len(after.lag)))
    few = max(1, READ_AT_ONCE // len(windows)) if windows.specific_force.any() else 1
    for start in range(0, len(other), few):
        some = other[start : start + few]
        for like, change in zip(some, np.moveaxis(beyond(after.rows(first[some]), slice(None)), 1, 0), strict=True):
            shown[..., kind == like] = change[..., None]
    shown *= windows.trust[..., None]
    return windows.whitened(shown.reshape(len(windows), -1, shown.shape[-1]))


def _readings(windows: Windows, c: Coefficients, seen: Floats) -> Floats:
    """Reports (W, R, m, C) of vehicles (R,) at the times of samples, along a reported motion (W, 1, S + 1, 13)."""
    true = sensors_of(c, windows.channels).by_step().true_state(seen)
    loads_matter = c.compass_per_load.any()  # thrust is computed where some sensor depends on it
    load = actuate_prepared(windows, c).load(slice(0, len(windows)), true.shape[2]) if loads_matter else None
    by_step, motion = c.rows((slice(None), None)), motion_of(true)
    reports = read(by_step, windows.channels, motion, load)
    reports[..., windows.angular] = np.unwrap(reports[..., windows.angular], axis=2)
    at = (windows.index + windows.fraction)[:, None, :, None] + ahead(windows, c)[:, None]
    whole = np.minimum(np.floor(at + 1e-9).astype(int), windows.steps - 1)
    here, there = (np.take_along_axis(reports, step, axis=2) for step in (whole, whole + 1))
    found = here + (at - whole) * (there - here)
    if windows.specific_force.any():
        found[..., windows.specific_force] = mean_specific_forces(
            windows, by_step, motion, at[..., windows.specific_force]
        )
    return found
