"""What logs of the sound vehicle say before a fault is looked for: its coefficients, its floor, and how it varies.

Three layers are kept apart. What the vehicle's file has wrong is the same in every flight; what differs from flight to
flight, as trim and current do, has a spread; and only what is neither is new. The first two become slack of the search,
with all of their uncertainty.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from torch import Tensor

from auv_torchrl.diagnosis.calibrate.by_prediction import predicts_better
from auv_torchrl.diagnosis.calibrate.draft import Draft, draft, parted
from auv_torchrl.diagnosis.calibrate.floor import sizes_by_axis
from auv_torchrl.diagnosis.calibrate.gauge import scales_left_open
from auv_torchrl.diagnosis.calibrate.nuisance import Centred
from auv_torchrl.diagnosis.calibrate.together import PASSES, Together, follow_all
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient
from auv_torchrl.diagnosis.identify.attitude import hold_attitude, is_hidden
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.problem import Known
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.reduce import OU_TIME
from auv_torchrl.diagnosis.motion.windows import Windows
from auv_torchrl.diagnosis.thresholds import TILT_PASSES
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import Finding, FlightLog, Severity, join
from auv_torchrl.quantities import counted, percent, words
from auv_torchrl.vehicle import Vehicle

FEWEST_TO_LEAVE_ONE = 3  # flights, so that all of them show a vehicle near that of the others


@dataclass(frozen=True)
class Calibration:
    """The vehicle as healthy logs show it."""

    centred: Centred  # the vehicle, empty batch, and what may differ from it in another flight
    known: Known
    strays: tuple[str, ...]  # effects whose coefficients the file has wrong by more than slack
    as_stated: float  # chi-square per number where the file is right within slack
    excess: float  # that of the calibrated vehicle, under the floor of the settings
    has_gap: bool  # beyond what the file may have wrong
    findings: tuple[Finding, ...]
    together: Together | None = None  # what each flight tells, where they are here

    @property
    def vehicle(self) -> Vehicle:
        """The calibrated vehicle, empty batch."""
        return self.centred.vehicle

    @property
    def tilts(self) -> bool:
        """Whether it may roll or pitch."""
        return bool((self.vehicle.free[3:5] > 0).any())


def calibrate(
    healthy: Sequence[FlightLog],
    vehicle: Vehicle,
    settings: Settings,
    coefficients: Sequence[Coefficient] = (),
    free: Tensor | None = None,
) -> Calibration:
    """Fit the coefficients of a sound vehicle, how it varies from flight to flight, and its disturbance floor.

    Where the file is right within slack, that is all that is fitted; else every coefficient that it may have wrong,
    and whether the vehicle rolls and pitches.

    Args:
        healthy: at least one log without the fault; each is a flight.
        vehicle: nominal, empty batch; roll and pitch held or free as they are to be diagnosed.
        settings: widths of the slack and the floor to begin from.
        coefficients: what is uncertain in the file; empty for what the effects declare.
        free: degrees of freedom (6,) of a vehicle that is held level because nobody measured how it tilts; None where
            that is known.
    """
    return work_out(draft(healthy, vehicle, settings, coefficients), settings, free)


def work_out(drafted: Draft, settings: Settings, free: Tensor | None = None) -> Calibration:
    """The calibration that a draft of it leads to; ``settings`` and ``free`` as of :func:`calibrate`."""
    together, centred, known = drafted.together, drafted.centred, drafted.known
    if together is None:
        passes = PASSES
        if free is not None:
            centred, passes = _tilting_or_level(drafted.flights, centred, known, settings, free), PASSES - TILT_PASSES
        together = follow_all(drafted.flights, centred, known, settings, passes=passes)
    found = _told(together, drafted.strays, drafted.as_stated, drafted.log, settings)
    given = drafted.log, drafted.given, found.vehicle, settings, tuple(drafted.coefficients)
    better = predicts_better(*given) if found.has_gap else None
    if better is None:
        return found
    centred, known, excess = better
    found = replace(found, centred=centred, known=known, excess=excess, together=None)
    return replace(found, findings=tuple(_findings(drafted.log, found, settings)))


def calibrate_attitude(
    healthy: Sequence[FlightLog], vehicle: Vehicle, settings: Settings, coefficients: Sequence[Coefficient] = ()
) -> Calibration:
    """The calibration of a vehicle that is held level or may tilt, as its flights ask for; see :func:`calibrate`."""
    log = join(healthy)
    free = vehicle.free if is_hidden(log, vehicle) else None
    return calibrate(healthy, hold_attitude(log, vehicle), settings, coefficients, free)


def _tilting_or_level(
    flights: Sequence[Windows], level: Centred, known: Known, settings: Settings, free: Tensor
) -> Centred:
    """The vehicle held level or with the degrees of freedom ``free`` (6,), whichever makes the flights likelier.

    A disturbance makes up for the tilts that a level vehicle lacks, so that what is left tells nothing of them. Both
    begin where nothing has been shown yet, for what a level vehicle shows has its lack of tilts in it.
    """
    both, odds = (level, replace(level, vehicle=changed(level.vehicle, free=free))), 0.0
    for _ in range(TILT_PASSES):
        held, tilting = (follow_all(flights, begin, known, settings, passes=1) for begin in both)
        both, odds = (held.whole, tilting.whole), tilting.likelihood - held.likelihood
    return both[odds > 0]


def calibrate_free(healthy: Sequence[FlightLog], level: Calibration, free: Tensor, settings: Settings) -> Calibration:
    """The same for the degrees of freedom ``free`` (6,), from what was calibrated with the vehicle held level.

    Roll and pitch that nobody measured are seen by what they do to the rest, and that is little: a fit of all
    coefficients that begins elsewhere would be led astray by them.
    """
    log = join(healthy)
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)
    whole = level.together.whole if level.together else level.centred
    centred = replace(whole, vehicle=changed(whole.vehicle, free=free))
    known = replace(level.known, floor=np.array(settings.floor_force))
    together = follow_all(parted(healthy, windows), centred, known, settings)
    return _told(together, level.strays, level.as_stated, log, settings)


def leave_out(sound: Calibration, healthy: Sequence[FlightLog], place: int, settings: Settings) -> Calibration | None:
    """The calibration on all of these flights but one, from that on all of them.

    None where that is no start: where all of them are not one vehicle at once, the one that is left out may have led
    the others astray to a vehicle that explains it too, and one of two flights alone may lie far from both.
    """
    together = sound.together
    few = len(healthy) < FEWEST_TO_LEAVE_ONE
    if together is None or few or together.at_once > settings.excess or len(together.told) != len(healthy):
        return None
    others = join([log for k, log in enumerate(healthy) if k != place])
    return _told(together.without(place), sound.strays, sound.as_stated, others, settings)


def _told(
    together: Together, strays: tuple[str, ...], as_stated: float, log: FlightLog, settings: Settings
) -> Calibration:
    """With the findings about flights that are joined to a log."""
    excess = together.excess
    has_gap = excess > settings.excess
    known, centred = together.known, together.centred
    if centred.nuisance.is_guess:
        known = replace(known, scales=scales_left_open(centred, together.hides))
    found = Calibration(centred, known, strays, as_stated, excess, has_gap, (), together)
    return replace(found, findings=tuple(_findings(log, found, settings)))


def noise_findings(noisier: dict[str, float]) -> tuple[Finding, ...]:
    """A warning about channels that are so many times noisier than on the healthy log."""
    if not noisier:
        return ()
    sizes = ", ".join(f"{name} {times:.1f} times" for name, times in noisier.items())
    sentence = f"the sensors are noisier than on the healthy log: {sizes}; their noise is fitted on this log instead"
    return (Finding(Severity.WARNING, "noisier_than_healthy", sentence, columns=tuple(noisier)),)


def _findings(log: FlightLog, calibration: Calibration, settings: Settings) -> list[Finding]:
    excess, known, corrections = calibration.excess, calibration.known, calibration.centred.corrections
    largest = ""
    if corrections:
        most = max(corrections, key=lambda key: abs(corrections[key]))
        largest = f"; the largest correction is {words(' '.join(most))} {percent(corrections[most], sign=True)}"
    dof = np.flatnonzero(calibration.vehicle.free.numpy() > 0)
    sentence = (
        f"the verdict rests on the healthy log {log.name} ({log.duration:.0f} s): disturbance of "
        f"{sizes_by_axis(known.floor, dof)} over {OU_TIME:g} s, coefficients calibrated on it{largest}"
    )
    found = [Finding(Severity.INFO, "floor_measured", sentence)]
    if calibration.as_stated > settings.excess:
        sentence = (
            f"the vehicle's file is off by more than a few per cent: {counted(len(known.nuisance), 'coefficient')} "
            f"corrected on the healthy log {log.name} (chi-square {calibration.as_stated:.3g} per number before, "
            f"{excess:.3g} after); what is found is relative to the vehicle of that log"
        )
        found.append(Finding(Severity.INFO, "coefficients_corrected", sentence))
    if calibration.has_gap:
        sentence = (
            f"the healthy log {log.name} departs from the simulator by more than coefficients can explain "
            f"(chi-square {excess:.2f} per number): what is left of it counts as disturbance, and faults of that size "
            "cannot be seen"
        )
        found.append(Finding(Severity.WARNING, "healthy_has_gap", sentence, "Diagnose the healthy log by itself first"))
    return found
