"""Whether healthy flights ask for a vehicle that may roll and pitch where nobody logged that it does."""

from collections.abc import Sequence

from auv_torchrl.diagnosis.calibrate.healthy import Calibration, calibrate
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient
from auv_torchrl.diagnosis.identify.attitude import hold_attitude, is_hidden
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.flightlog import FlightLog, join
from auv_torchrl.vehicle import Vehicle


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
    free = vehicle.free if is_hidden(log, vehicle) else None
    return calibrate(healthy, hold_attitude(log, vehicle), settings, coefficients, free)
