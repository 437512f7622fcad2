"""What is said of the volts of the battery that a log has: whether thrust was taken to follow them."""

import numpy as np

from auv_torchrl.flightlog import Finding, FlightLog, Severity
from auv_torchrl.physics.thrusters import VOLTS_EXPONENT, VOLTS_WITHIN
from auv_torchrl.quantities import percent
from auv_torchrl.vehicle import Vehicle

FELL = 0.03  # of the volts, from which thrust fades by more than the nuisance parameters of a sound vehicle


def volts_findings(log: FlightLog, vehicle: Vehicle) -> tuple[Finding, ...]:
    """How far logged volts explain a fading thrust, or that nothing says at which volts the file's thrusts hold."""
    told = [episode.battery[np.isfinite(episode.battery)] for episode in log.episodes if episode.battery is not None]
    volts = np.concatenate([*told, np.empty(0)])
    if not len(volts):
        return ()
    high, low, own = float(np.quantile(volts, 0.95)), float(np.quantile(volts, 0.05)), float(vehicle.volts)
    if not own:
        if high <= 0 or low > (1 - FELL) * high:
            return ()
        sentence = (
            f"the battery goes from {high:.1f} to {low:.1f} V, and the vehicle file does not say at which volts its"
        )
        remedy = "Enter volts under thrusters in the vehicle file, 16.0 for the published thrusts of a T200"
        return (
            Finding(Severity.INFO, "volts_unused", f"{sentence} thrusts hold: thrust is taken not to follow", remedy),
        )
    if not VOLTS_WITHIN[0] * own < low <= high < VOLTS_WITHIN[1] * own:
        sentence = f"the logged volts, {low:.1f} to {high:.1f}, are no battery of thrusters for {own:g} V"
        remedy = "Look at the scale of the power sensor (BATT_VOLT_MULT)"
        return (Finding(Severity.WARNING, "odd_volts", f"{sentence}: thrust does not follow those far off", remedy),)
    most, least = (percent((v / own) ** VOLTS_EXPONENT) for v in (high, low))
    sentence = f"thrust follows the logged volts, {high:.1f} to {low:.1f} V: {most} to {least} of the file's"
    return (Finding(Severity.INFO, "volts", f"{sentence}, which hold at {own:g} V"),)
