"""What healthy dives show of a vehicle, and what one further dive tells of its numbers."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from auv_torchrl.diagnosis.axes import followable
from auv_torchrl.diagnosis.calibrate.contradicting import healthy_flight
from auv_torchrl.diagnosis.calibrate.flights import Told
from auv_torchrl.diagnosis.calibrate.healthy import Calibration, calibrate, calibrate_free
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient
from auv_torchrl.diagnosis.dives.told import Dive, Normal, number_of
from auv_torchrl.diagnosis.identify.attitude import hold_attitude, is_hidden
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_along_motion, fit_by_simulation
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.judged import slack_now
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.flightlog import FlightLog, join
from auv_torchrl.vehicle import Vehicle


@dataclass(frozen=True)
class Reference:
    """The sound vehicle, as its healthy dives show it."""

    calibration: Calibration
    normal: Normal
    settings: Settings


@threadpool_limits.wrap(limits=1)  # the arrays are small: a second thread only waits
def refer(
    healthy: Sequence[FlightLog], vehicle: Vehicle, settings: Settings, coefficients: Sequence[Coefficient] = ()
) -> Reference:
    """Calibrate a vehicle on the dives that are the reference.

    Args:
        healthy: at least one.
        vehicle: nominal, empty batch.
        settings: as of a diagnosis.
        coefficients: what is uncertain in the vehicle's file.
    """
    healthy = [healthy_flight(log) for log in healthy]
    joined = join(healthy)
    calibration = calibrate(healthy, hold_attitude(joined, vehicle), settings, coefficients)
    if calibration.has_gap and is_hidden(joined, vehicle):
        free = calibrate_free(healthy, calibration, vehicle.free, settings)
        calibration = free if free.excess < calibration.excess else calibration
    known = calibration.known
    file_widths = calibration.centred.nuisance.width.tolist()
    numbers = tuple(
        number_of(effect, member, nominal, calibration.vehicle, width, settings.is_rough(effect))
        for (effect, member, nominal, _), width in zip(known.slack, file_widths, strict=True)
    )
    normal = Normal(numbers, known.slack_covariance, known.rough_noise, calibration.findings)
    return Reference(calibration, normal, settings)


@threadpool_limits.wrap(limits=1)
def tell(log: FlightLog, reference: Reference, begun: str = "") -> Dive:
    """What one dive tells of the numbers of the vehicle, with room for each to have changed.

    Raises:
        FlightLogError: if nothing of it can be followed.
    """
    log = followable(log)
    settings, known, normal = reference.settings, reference.calibration.known, reference.normal
    open_to = normal.covariance + np.diag(normal.width**2)
    sizes = np.sqrt(np.diag(open_to)).tolist()
    slack = tuple((*entry[:3], size) for entry, size in zip(known.slack, sizes, strict=True))
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)
    problem = Problem.of(
        windows, reference.calibration.vehicle, settings, replace(known, slack=slack, slack_covariance=open_to)
    )
    problem, follow = follow_windows(problem)
    begin = fit_along_motion(problem, Explanation(), follow)  # what changed much would lose windows that are simulated
    fitted = fit_by_simulation(problem, begin.explanation, begin.base)
    told = Told.of(fitted.quadratic, slack_now(problem, fitted.explanation))
    excess = fitted.excess
    return Dive(log.name, told.A, told.h, dict(problem.rough_noise), excess, log.duration, begun, log.findings)
