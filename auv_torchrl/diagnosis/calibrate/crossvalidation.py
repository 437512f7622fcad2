"""Whether a calibration holds in flights that it has not seen, and which healthy flight is not like the others.

Each flight is held against what all others say of the vehicle: how well it is predicted from its commands alone, and
whether it departs from them by more than flights do.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.calibrate.healthy import Calibration, calibrate_attitude, leave_out
from auv_torchrl.diagnosis.calibrate.together import follow_flight
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.thresholds import WITHIN_FLOOR, WORTH_A_CORRECTION
from auv_torchrl.diagnosis.validate.predict import errors_by_kind, horizons_of, predict_by
from auv_torchrl.diagnosis.validate.veto import scaled_errors
from auv_torchrl.diagnosis.verdict import Errors
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import FlightLog
from auv_torchrl.vehicle import Vehicle

FEWEST_TO_BLAME_ONE = 3  # of two that disagree, nobody knows which one is wrong
STANDS_OUT = 3.0  # times the chi-square beyond noise, of the next flight or of the others with it: not like them


@dataclass(frozen=True)
class Unseen:
    """A flight under the vehicle as other flights show it."""

    name: str
    excess: float  # chi-square per number; 1 is noise, disturbance and what flights differ in
    others: float  # and that which the calibration on the other flights leaves of these
    before: float  # root mean square error of predictions by the vehicle's file, in units of the floor
    after: float  # and by what the other flights made of it
    horizons_s: tuple[float, ...]
    position_m: Errors | None  # None where it is not measured
    yaw_rad: Errors | None
    velocity: Errors | None

    @property
    def gains(self) -> bool:
        """Whether it is predicted better than by the file, where that leaves anything to predict better."""
        return self.before <= WITHIN_FLOOR or self.after <= (1 - WORTH_A_CORRECTION) * self.before


def hold_against(flight: FlightLog, sound: Calibration, vehicle: Vehicle, settings: Settings) -> Unseen:
    """A flight under a calibration of others.

    Args:
        flight: not one of those that were calibrated on.
        sound: the vehicle as these show it.
        vehicle: as its file says, empty batch.
        settings: of the diagnosis.
    """
    windows = cut_windows(flight, settings.window_s, settings.lead_s, settings.bin_s)
    problem, fit = follow_flight(windows, sound.vehicle, settings, sound.known)
    stages = [changed(vehicle, free=sound.vehicle.free), sound.vehicle]
    predictions = predict_by(problem, flight, stages, settings)
    before, after = scaled_errors(predictions).tolist()
    errors = errors_by_kind(predictions)
    return Unseen(
        name=flight.name,
        excess=fit.excess,
        others=sound.excess,
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
) -> tuple[tuple[Unseen, ...], Calibration]:
    """Each of two or more flights under the calibration of all the others, and that on all of them.

    Where all of them are one vehicle, the others are calibrated from there. ``report`` is told how many are done.
    """
    sound, found = calibrate_attitude(healthy, vehicle, settings, coefficients), []
    report(1)
    for place, flight in enumerate(healthy):
        others = leave_out(sound, healthy, place, settings)
        if others is None:
            rest = [log for k, log in enumerate(healthy) if k != place]
            others = calibrate_attitude(rest, vehicle, settings, coefficients)
        found.append(hold_against(flight, others, vehicle, settings))
        report(place + 2)
    return tuple(found), sound


def odd_one(flights: Sequence[Unseen], settings: Settings) -> int | None:
    """Which flight is not like the others, by its place; None where none is, or where nobody can tell.

    It does not fit what the others say, and without it these agree. That it fits worst is not enough: a calibration
    with a fault among sound flights may lie anywhere, and sound flights then fit it worse than the fault fits them.
    """
    if len(flights) < FEWEST_TO_BLAME_ONE:
        return None
    excess, others = (_beyond(sizes, settings) for sizes in zip(*((f.excess, f.others) for f in flights), strict=True))
    unlike = [place for place, size in enumerate(excess) if size > settings.excess - 1]
    if not unlike:
        return None
    odd, *rest = sorted(unlike, key=lambda place: (others[place], -excess[place]))
    stands_out = excess[odd] > STANDS_OUT * max([excess[place] for place in range(len(flights)) if place != odd])
    reconciles = others[odd] < min([others[place] for place in rest], default=0.0) / STANDS_OUT
    return odd if stands_out or reconciles else None


def _beyond(excess: Sequence[float], settings: Settings) -> list[float]:
    """Chi-square per number beyond noise, at least what no verdict makes anything of."""
    return [max(size, settings.excess) - 1 if np.isfinite(size) else np.inf for size in excess]


def without_odd_ones(
    healthy: Sequence[FlightLog],
    vehicle: Vehicle,
    settings: Settings,
    coefficients: Sequence[Coefficient] = (),
    report: Callable[[int], None] = lambda done: None,
) -> tuple[Calibration, tuple[Unseen, ...], tuple[Unseen, ...]]:
    """The calibration on flights that agree, each under that of the others among them, and those that were left out.

    At most a minority is left out: of flights half of which are odd, nobody knows which half.
    """
    used, left_out, done = tuple(healthy), [], 0
    while True:
        flights, sound = cross_validate(
            used, vehicle, settings, coefficients, lambda more, before=done: report(before + more)
        )
        odd = odd_one(flights, settings) if 2 * (len(left_out) + 1) < len(healthy) else None
        if odd is None:
            return sound, flights, tuple(left_out)
        done += len(used) + 1
        left_out.append(flights[odd])
        used = tuple(log for place, log in enumerate(used) if place != odd)


def disagree(flights: Sequence[Unseen], settings: Settings) -> bool:
    """Whether two flights show two vehicles, of which nobody can tell the sound one."""
    return len(flights) == 2 and all(flight.excess > settings.excess for flight in flights)


def pooled(flights: Sequence[Unseen]) -> tuple[float, float]:
    """Root mean square error over unseen flights in units of the floor, by the file and by what was calibrated."""
    squares = np.square([[flight.before, flight.after] for flight in flights])
    before, after = np.sqrt(squares.mean(0)).tolist()
    return before, after


def why_not(flights: Sequence[Unseen]) -> str:
    """Why a calibration is not worth keeping; empty where it predicts unseen flight better than the file."""
    before, after = pooled(flights)
    if not np.isfinite(after):
        return "the calibrated vehicle flies off where the file's does not" if np.isfinite(before) else "both fly off"
    if before <= WITHIN_FLOOR:
        return f"the file predicts unseen flight as well as the sensors allow (error of {before:.2f} floors)"
    if after > (1 - WORTH_A_CORRECTION) * before:
        return (
            f"it predicts unseen flight no better than the file does ({after:.2f} floors of error, {before:.2f} before)"
        )
    return ""
