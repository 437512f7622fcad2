"""Whether healthy flights ask for a vehicle that may roll and pitch where nobody logged that it does."""

from collections.abc import Sequence

from auv_torchrl.diagnosis.calibrate.healthy import Calibration, calibrate, calibrate_free
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient
from auv_torchrl.diagnosis.identify.attitude import hold_attitude, is_hidden
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.thresholds import TILTS_MATTER
from auv_torchrl.flightlog import FlightLog, join
from auv_torchrl.vehicle import Vehicle


def tilted(
    healthy: Sequence[FlightLog], level: Calibration, vehicle: Vehicle, settings: Settings
) -> Calibration | None:
    """The calibration of a vehicle that may tilt, where that is what a ``level`` one lacks on healthy flights."""
    free = calibrate_free(healthy, level, vehicle.free, settings)
    return free if free.excess - 1 < TILTS_MATTER * (level.excess - 1) else None


def calibrate_attitude(
    healthy: Sequence[FlightLog], vehicle: Vehicle, settings: Settings, coefficients: Sequence[Coefficient] = ()
) -> Calibration:
    """The calibration of a vehicle that is held level, or may tilt, as these flights ask for.

    Args:
        healthy: at least one log without a fault; each is a flight.
        vehicle: as its file says, empty batch.
        settings: of the diagnosis.
        coefficients: what the file says is uncertain.
    """
    log = join(healthy)
    level = calibrate(healthy, hold_attitude(log, vehicle), settings, coefficients)
    if not level.has_gap or not is_hidden(log, vehicle):
        return level
    return tilted(healthy, level, vehicle, settings) or level
