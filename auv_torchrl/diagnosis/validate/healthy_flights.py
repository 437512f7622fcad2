"""Which flights may serve as healthy ones: each by itself, and against the others.

By itself: poses that a flight's own velocities contradict are left out of it. A compass that is turned, or a position
in a frame of its own, leaves a healthy vehicle healthy. No force makes a simulator follow both reports, and lost
windows would look like a disturbance, or as another vehicle. ``flightlog/checks/agreement.py`` has already asked of
every log whether velocities give most of its motion. Here single stretches count, because each lost one leads a
calibration astray.

Against the others: each flight is predicted by what all others say of the vehicle. A flight that departs from the
others by more than flights do is left out, and a calibration that predicts no unseen flight better is not kept.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.axes import followable, restricted
from auv_torchrl.diagnosis.calibrate.calibration import Calibration, calibrate_attitude, leave_out
from auv_torchrl.diagnosis.calibrate.flights import fit_flight
from auv_torchrl.diagnosis.calibrate.parameters import Coefficient
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import CONTRADICTED, FEW_CONTRADICTED, WITHIN_FLOOR, WORTH_A_CORRECTION
from auv_torchrl.diagnosis.validate.predict import errors_by_kind, horizons_of, predict_by
from auv_torchrl.diagnosis.validate.veto import scaled_errors
from auv_torchrl.diagnosis.verdict import Errors
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import POSE, VELOCITY, Episode, Finding, FlightLog, Severity
from auv_torchrl.flightlog.signals import integral
from auv_torchrl.physics.kinematics import matvec, quaternion_from_euler, rotation_and_rate
from auv_torchrl.quantities import quantity
from auv_torchrl.vehicle import Vehicle

STRETCH_S = 2.0  # s over which poses and velocities are compared, as long as windows are
FEWEST_STRETCHES = 10  # that tell how often poses and velocities differ
PLACE, TURN = POSE[:3], POSE[3:]
FEWEST_TO_BLAME_ONE = 3  # of two flights that disagree, nobody can tell which one is wrong
STANDS_OUT = 3.0  # ratio of chi-squares beyond noise: of the odd flight to the next, or with it to without it


def check_healthy_flight(log: FlightLog) -> FlightLog:
    """A healthy flight as it can be followed, without positions or attitudes that its velocities contradict.

    A finding says so. Where positions, attitudes and all velocities are not measured together, nothing is compared.

    Raises:
        FlightLogError: as :func:`~auv_torchrl.diagnosis.axes.followable`.
    """
    flight = followable(log)
    if not {*POSE, *VELOCITY} <= set(flight.axes):
        return flight
    place, turn = (np.concatenate(sizes) for sizes in zip(*map(_pose_differences, flight.episodes), strict=True))
    contradicted, left_out = [], ()
    if _are_many(place):
        contradicted, left_out = [_describe_difference(PLACE, place, "m")], PLACE
    if _are_many(turn):  # attitudes turn the velocities that positions are compared with
        contradicted, left_out = [*contradicted, _describe_difference(TURN, turn, "rad")], POSE
    if not contradicted:
        return flight
    sentence = (
        f"{' and '.join(contradicted)} contradict the velocities of this healthy flight: it is followed by its "
        f"velocities, and {', '.join(left_out)} are left out"
    )
    remedy = "Log positions, attitudes and velocities in the frames that the documentation says"
    finding = Finding(Severity.WARNING, "healthy_contradicts_itself", sentence, remedy, left_out)
    rest = tuple(axis for axis in flight.axes if axis not in left_out)
    return restricted(replace(flight, findings=(*flight.findings, finding)), rest)


def _are_many(sizes: Floats) -> bool:
    return len(sizes) >= FEWEST_STRETCHES and bool(np.mean(sizes > CONTRADICTED) > FEW_CONTRADICTED)


def _describe_difference(axes: tuple[str, ...], sizes: Floats, unit: str) -> str:
    return f"{', '.join(axes)} (by {quantity(float(np.median(sizes)), unit, 2)} within {STRETCH_S:g} s)"


def _pose_differences(episode: Episode) -> tuple[Floats, Floats]:
    """By how much positions in m, and attitudes in rad, part ways with velocities over each stretch, (N,) each."""
    seen = np.isfinite(episode.pose).all(1) & np.isfinite(episode.velocity).all(1)
    t, pose, velocity = episode.t[seen], episode.pose[seen], episode.velocity[seen]
    if not len(t):
        return np.empty(0), np.empty(0)
    quaternion = quaternion_from_euler(*pose[:, 3:].T)
    side = np.sign((quaternion[1:] * quaternion[:-1]).sum(1))  # both signs of a quaternion are one attitude
    quaternion = quaternion * np.cumprod(np.append(1.0, side))[:, None]
    rotation, turning = rotation_and_rate(quaternion, velocity[:, 3:])
    place = pose[:, :3] - integral(t, matvec(rotation, velocity[:, :3]))
    turn = 2 * (quaternion - integral(t, turning))  # rad, of small turns
    stretches = np.flatnonzero(np.diff(((t - t[0]) / STRETCH_S).astype(int))) + 1
    return _spans(place, stretches), _spans(turn, stretches)


def _spans(values: Floats, edges: np.ndarray) -> Floats:
    """How far values (T, k) range within each stretch."""
    return np.array([np.linalg.norm(np.ptp(part, axis=0)) for part in np.split(values, edges)])


@dataclass(frozen=True)
class FlightCheck:
    """A flight under the vehicle as other flights show it."""

    name: str
    excess: float  # chi-square per number; 1 is noise, disturbance and the spread between flights
    others_excess: float  # chi-square per number of the other flights under their calibration
    before: float  # root mean square error of predictions by the vehicle's file, in units of the floor
    after: float  # the same by the calibration of the other flights
    horizons_s: tuple[float, ...]
    position_m: Errors | None  # None where it is not measured
    yaw_rad: Errors | None
    velocity: Errors | None

    @property
    def gains(self) -> bool:
        """Whether the flight is predicted better than by the file, where the file leaves anything to gain."""
        return self.before <= WITHIN_FLOOR or self.after <= (1 - WORTH_A_CORRECTION) * self.before


def check_flight(flight: FlightLog, calibration: Calibration, vehicle: Vehicle, settings: Settings) -> FlightCheck:
    """A flight under a calibration of others.

    Args:
        flight: not one of those that were calibrated on.
        calibration: of other flights.
        vehicle: as its file says, empty batch.
        settings: of the diagnosis.
    """
    windows = cut_windows(flight, settings.window_s, settings.lead_s, settings.bin_s)
    problem, fit = fit_flight(windows, calibration.vehicle, settings, calibration.prior)
    stages = [changed(vehicle, free=calibration.vehicle.free), calibration.vehicle]
    predictions = predict_by(problem, flight, stages, settings)
    before, after = scaled_errors(predictions).tolist()
    errors = errors_by_kind(predictions)
    return FlightCheck(
        name=flight.name,
        excess=fit.excess,
        others_excess=calibration.excess,
        before=before,
        after=after,
        horizons_s=horizons_of(predictions.windows),
        **{kind: errors[kind] for kind in ("position_m", "yaw_rad", "velocity")},
    )


def cross_validate(
    healthy: Sequence[FlightLog],
    vehicle: Vehicle,
    settings: Settings,
    coefficients: Sequence[Coefficient] = (),
    report: Callable[[int], None] = lambda done: None,
) -> tuple[tuple[FlightCheck, ...], Calibration]:
    """Each of two or more flights under the calibration of all the others, and the calibration on all of them.

    Where all flights show one vehicle, the calibrations of the others begin there. ``report`` gets the number of
    calibrations that are done.
    """
    calibration, found = calibrate_attitude(healthy, vehicle, settings, coefficients), []
    report(1)
    for place, flight in enumerate(healthy):
        others = leave_out(calibration, healthy, place, settings)
        if others is None:
            rest = [log for k, log in enumerate(healthy) if k != place]
            others = calibrate_attitude(rest, vehicle, settings, coefficients)
        found.append(check_flight(flight, others, vehicle, settings))
        report(place + 2)
    return tuple(found), calibration


def find_odd_flight(flights: Sequence[FlightCheck], settings: Settings) -> int | None:
    """The place of the flight that is not like the others; None where there is none, or where nobody can tell.

    An odd flight departs from the others, and without it they agree. The largest misfit alone proves nothing: a
    calibration with a fault among its flights may lie anywhere, and healthy flights may depart from it by more than the
    faulty flight from theirs.
    """
    if len(flights) < FEWEST_TO_BLAME_ONE:
        return None
    sizes = zip(*((flight.excess, flight.others_excess) for flight in flights), strict=True)
    excess, others = (_beyond_noise(row, settings) for row in sizes)
    unlike = [place for place, size in enumerate(excess) if size > settings.excess - 1]
    if not unlike:
        return None
    odd, *rest = sorted(unlike, key=lambda place: (others[place], -excess[place]))
    stands_out = excess[odd] > STANDS_OUT * max([excess[place] for place in range(len(flights)) if place != odd])
    reconciles = others[odd] < min([others[place] for place in rest], default=0.0) / STANDS_OUT
    return odd if stands_out or reconciles else None


def _beyond_noise(excess: Sequence[float], settings: Settings) -> list[float]:
    """Chi-square per number beyond noise, at least as much as a verdict needs to speak of a gap."""
    return [max(size, settings.excess) - 1 if np.isfinite(size) else np.inf for size in excess]


def calibrate_without_odd_flights(
    healthy: Sequence[FlightLog],
    vehicle: Vehicle,
    settings: Settings,
    coefficients: Sequence[Coefficient] = (),
    report: Callable[[int], None] = lambda done: None,
) -> tuple[Calibration, tuple[FlightCheck, ...], tuple[FlightCheck, ...]]:
    """The calibration on flights that agree, the check of each by the others, and the flights that were left out.

    At most a minority is left out: where half of the flights are odd, nobody can tell which half.
    """
    used, left_out, done = tuple(healthy), [], 0
    while True:
        flights, calibration = cross_validate(
            used, vehicle, settings, coefficients, lambda more, before=done: report(before + more)
        )
        odd = find_odd_flight(flights, settings) if 2 * (len(left_out) + 1) < len(healthy) else None
        if odd is None:
            return calibration, flights, tuple(left_out)
        done += len(used) + 1
        left_out.append(flights[odd])
        used = tuple(log for place, log in enumerate(used) if place != odd)


def flights_disagree(flights: Sequence[FlightCheck], settings: Settings) -> bool:
    """Whether two flights show two vehicles, of which nobody can tell the healthy one."""
    return len(flights) == 2 and all(flight.excess > settings.excess for flight in flights)


def pool_errors(flights: Sequence[FlightCheck]) -> tuple[float, float]:
    """Root mean square error over unseen flights in units of the floor, by the file and by the calibrations."""
    squares = np.square([[flight.before, flight.after] for flight in flights])
    before, after = np.sqrt(squares.mean(0)).tolist()
    return before, after


def reason_against(flights: Sequence[FlightCheck]) -> str:
    """Why a calibration is not worth keeping; empty where it predicts unseen flight better than the file."""
    before, after = pool_errors(flights)
    if not np.isfinite(after):
        return "the calibrated vehicle flies off where the file's does not" if np.isfinite(before) else "both fly off"
    if before <= WITHIN_FLOOR:
        return f"the file predicts unseen flight as well as the sensors allow (error of {before:.2f} floors)"
    if after > (1 - WORTH_A_CORRECTION) * before:
        return (
            f"it predicts unseen flight no better than the file does ({after:.2f} floors of error, {before:.2f} before)"
        )
    return ""
