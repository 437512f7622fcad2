"""The parameters that are tracked from dive to dive, what the reference dives show, and what one further dive tells."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from threadpoolctl import threadpool_limits

from auv_torchrl.diagnosis.axes import followable, hold_attitude, is_hidden
from auv_torchrl.diagnosis.calibrate.calibration import Calibration, calibrate, calibrate_free
from auv_torchrl.diagnosis.calibrate.flights import FlightInformation
from auv_torchrl.diagnosis.calibrate.parameters import Coefficient
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_along_motion, fit_by_simulation
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.paths import nuisance_now
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.validate.healthy_flights import check_healthy_flight
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import Finding, FlightLog, join
from auv_torchrl.vehicle import Vehicle

NOISE = "noise"  # stands for an effect where a parameter is the noise of a channel
# Of its bounds, that a parameter of the day may be away by: a current of 0.4 m/s, not one of the 2 cm/s by which
# currents differ in one tank.
OF_THE_DAY = 0.1
NOISE_WIDTH = 1.0  # e-fold, by which a sensor may become noisier


@dataclass(frozen=True)
class TrackedParameter:
    """One parameter of a vehicle, counted from its value in the reference dives."""

    effect: str
    member: str
    nominal: float  # what its deviations are counted from: 1 for a factor
    unit: str
    width: float  # standard deviation by which it may change
    is_daily: bool = False  # whether it belongs to the day rather than to the vehicle, as a current does
    is_rough: bool = False  # whether linear sensitivities do not describe what it does

    @property
    def key(self) -> str:
        """Its name in files."""
        return f"{self.effect}.{self.member}"

    @property
    def watched(self) -> bool:
        """Whether a change of it is one of the vehicle, and can be seen."""
        return not self.is_daily and not self.is_rough


def tracked_parameter(
    effect: str, member: str, nominal: float, vehicle: Vehicle, file_width: float = 0.0, rough: bool = False
) -> TrackedParameter:
    """A parameter of an effect of a vehicle.

    Args:
        effect: in the registry.
        member: of its parameters.
        nominal: at which the effect does nothing.
        vehicle: calibrated, empty batch.
        file_width: standard deviation by which the vehicle's own file says that the parameter may be off.
        rough: linear sensitivities do not describe what it does.
    """
    p = EFFECTS[effect].member_parameters(vehicle)[member]
    width = max(p.guessed_within(vehicle, member), file_width)
    daily = not width  # what no file can have wrong
    return TrackedParameter(effect, member, nominal, p.unit, width or OF_THE_DAY * (p.high - p.low), daily, rough)


def noise_parameter(channel: str) -> TrackedParameter:
    """The noise of a channel, as the logarithm of a factor."""
    return TrackedParameter(NOISE, channel, 1.0, "1", NOISE_WIDTH)


@dataclass(frozen=True)
class Dive:
    """What one log tells of the parameters (k,) of a vehicle: chi-square is ``a A a - 2 h a`` and a constant."""

    name: str
    A: Floats  # (k, k)
    h: Floats  # (k,)
    noise: Mapping[str, float]  # standard deviation by channel
    excess: float | None  # chi-square per measured number, with all parameters free; None where nothing was read
    seconds: float = 0.0
    begun: str = ""  # date and time, where the name of its file has one
    findings: tuple[Finding, ...] = ()
    refused: str = ""  # why the log was not read; then the other fields are empty

    def explained(self, most: float) -> bool:
        """Whether the misfit is at most ``most``; a log that was not read has none."""
        return self.excess is None or not self.excess > most

    @staticmethod
    def unread(name: str, why: str, k: int, begun: str = "") -> "Dive":
        """A log without information about k parameters."""
        return Dive(name, np.zeros((k, k)), np.zeros(k), {}, None, begun=begun, refused=why)


@dataclass(frozen=True)
class Baseline:
    """How a healthy vehicle is, as its reference dives show."""

    parameters: tuple[TrackedParameter, ...]  # (k,)
    covariance: Floats  # (k, k) of what another dive of a healthy vehicle may show
    noise: Mapping[str, float]  # standard deviation by channel
    findings: tuple[Finding, ...] = ()

    @cached_property
    def width(self) -> Floats:
        """(k,) by how much each parameter may change."""
        return np.array([parameter.width for parameter in self.parameters])

    def all_parameters(self, dives: Sequence[Dive]) -> tuple[TrackedParameter, ...]:
        """Those of the vehicle, then the noise of every channel that reference and dives have."""
        seen = {channel for dive in dives for channel in dive.noise}
        return (*self.parameters, *(noise_parameter(channel) for channel in self.noise if channel in seen))


@dataclass(frozen=True)
class Reference:
    """The healthy vehicle, calibrated on its reference dives."""

    calibration: Calibration
    baseline: Baseline
    settings: Settings


@threadpool_limits.wrap(limits=1)  # the arrays are small: a second thread only waits
def learn_reference(
    healthy: Sequence[FlightLog], vehicle: Vehicle, settings: Settings, coefficients: Sequence[Coefficient] = ()
) -> Reference:
    """Calibrate a vehicle on the dives that are the reference.

    Args:
        healthy: at least one.
        vehicle: nominal, empty batch.
        settings: as of a diagnosis.
        coefficients: what is uncertain in the vehicle's file.
    """
    healthy = [check_healthy_flight(log) for log in healthy]
    joined = join(healthy)
    calibration = calibrate(healthy, hold_attitude(joined, vehicle), settings, coefficients)
    if calibration.has_gap and is_hidden(joined, vehicle):
        free = calibrate_free(healthy, calibration, vehicle.free, settings)
        calibration = free if free.excess < calibration.excess else calibration
    known = calibration.prior
    file_widths = calibration.estimate.nuisance.width.tolist()
    parameters = tuple(
        tracked_parameter(effect, member, nominal, calibration.vehicle, width, settings.is_rough(effect))
        for (effect, member, nominal, _), width in zip(known.nuisance, file_widths, strict=True)
    )
    baseline = Baseline(parameters, known.nuisance_covariance, known.rough_noise, calibration.findings)
    return Reference(calibration, baseline, settings)


@threadpool_limits.wrap(limits=1)
def follow_dive(log: FlightLog, reference: Reference, begun: str = "") -> Dive:
    """What one dive tells of the parameters of the vehicle, with room for each to have changed.

    Raises:
        FlightLogError: if nothing of the log can be followed.
    """
    log = followable(log)
    settings, known, baseline = reference.settings, reference.calibration.prior, reference.baseline
    open_to = baseline.covariance + np.diag(baseline.width**2)
    sizes = np.sqrt(np.diag(open_to)).tolist()
    nuisance = tuple((*entry[:3], size) for entry, size in zip(known.nuisance, sizes, strict=True))
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)
    problem = Problem.of(
        windows, reference.calibration.vehicle, settings, replace(known, nuisance=nuisance, nuisance_covariance=open_to)
    )
    problem, follow = follow_windows(problem)
    # Along the measured motion first: a large change would lose windows that are simulated.
    begin = fit_along_motion(problem, Explanation(), follow)
    fitted = fit_by_simulation(problem, begin.explanation, begin.path)
    tells = FlightInformation.of(fitted.quadratic, nuisance_now(problem, fitted.explanation))
    excess = fitted.excess
    return Dive(log.name, tells.A, tells.h, dict(problem.rough_noise), excess, log.duration, begun, log.findings)
