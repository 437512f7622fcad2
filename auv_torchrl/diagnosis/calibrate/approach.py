"""From a file that is wrong by factors to a vehicle near enough to be linearised about.

Against the disturbance of a sound vehicle, a fit from afar ends in the wrong place: what nothing explains yet is
cheapest where all moments are small, for then the disturbance that makes up for them is small, too. Predicted from its
commands alone, a vehicle of small moments moves wrongly.
"""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.calibrate.descent import fit
from auv_torchrl.diagnosis.calibrate.nuisance import Centred, Nuisance
from auv_torchrl.diagnosis.calibrate.uncertainty import as_coefficients
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.effects import EFFECTS
from auv_torchrl.vehicle import Vehicle

MOST_WINDOWS = 120  # four minutes: what more windows tell is fitted later, with their disturbance


def approach(windows: Windows, file: Vehicle, nuisance: Nuisance) -> Centred:
    """About a vehicle that predicts windows from their starts, as unsure as before.

    Args:
        windows: of sound flight, so short that a vehicle from afar stays near.
        file: the vehicle as its file says, empty batch.
        nuisance: what may differ from it.
    """
    if len(windows) > MOST_WINDOWS:
        windows = windows.subset(np.linspace(0, len(windows) - 1, MOST_WINDOWS).astype(int))
    coefficients = as_coefficients(nuisance.entries, file)
    fitted = fit(windows, file, coefficients)
    before = np.array([c.nominal for c in coefficients])
    near = Centred.at(file, nuisance).moved(fitted.values - before, fitted.covariance)
    wide = replace(near.nuisance, width=near.nuisance.width * _grown(near.nuisance, before))
    covariance = np.diag(wide.width**2) + wide.between_flights()
    return Centred(near.vehicle, wide, near.file, covariance).sure(covariance)


def settled(centred: Centred) -> Centred:
    """Without what a vehicle is for good and nobody looks for, as where its thrusters sit: that is no slack."""
    for_good = {name for name, effect in EFFECTS.items() if effect.is_property and not effect.is_searched}
    left = [place for place, (effect, *_) in enumerate(centred.nuisance.entries) if effect not in for_good]
    return Centred(
        centred.vehicle, centred.nuisance.only(left), centred.file[left], centred.covariance[np.ix_(left, left)]
    )


def _grown(nuisance: Nuisance, before: Floats) -> Floats:
    """How many times (k,) each number is what the file says ``before``, where it is more.

    A drag of 2 that is guessed within 1 and turns out to be 10 was guessed within 5: guesses are wrong by factors.
    """
    now = np.array([nominal for *_, nominal, _ in nuisance.entries])
    return np.maximum(np.abs(now / np.where(before, before, np.inf)), 1.0)
