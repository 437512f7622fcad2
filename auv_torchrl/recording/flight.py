"""One flight in which the vehicle changes, in the viewer: under ``flight/``, on the timeline ``time`` like the rest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from torch import Tensor

from auv_torchrl.adaptation.flight import AdaptedFlight
from auv_torchrl.adaptation.learner import PHASES
from auv_torchrl.adaptation.recovery import BACK_M, Happening, Moment
from auv_torchrl.flight import Flight
from auv_torchrl.palette import MOMENT, NEUTRAL, U_S, U_T, rgb
from auv_torchrl.recording.body import record_vehicle
from auv_torchrl.recording.series import record_reference, record_series, thruster_series
from auv_torchrl.vehicle import Vehicle

NEAR, FAR = f"within {BACK_M:g} m", f"beyond {BACK_M:g} m"
_HEALTHY = "nominal"
_COLOUR = {**MOMENT, "CHANGE": "#999999"}  # black is not seen on a dark background


@dataclass(frozen=True)
class OneFlight:
    """One flight, batch (T + 1), with what is to be said of it."""

    vehicle: Vehicle  # no batch, for the places of its thrusters
    adapted: AdaptedFlight
    alone: Flight  # the same with u_s alone
    gains: Tensor  # (T + 1, n) estimated, 1 when healthy
    true_gains: Tensor  # (T + 1, n)
    moments: Sequence[Moment]
    summary: str


def record_flight(recording: rr.RecordingStream, one: OneFlight) -> None:
    """Log error, gains, the detector's statistic, the states of vehicle and adaptation, and markers of the moments."""
    flight = one.adapted.flight
    recording.log("flight/world", rr.ViewCoordinates.FRD, static=True)
    record_reference(recording, "flight/world/target", flight)
    path = rr.LineStrips3D([flight.position.float().numpy()], colors=[rgb(U_T)], radii=0.004)
    recording.log("flight/world/path", path, static=True)
    record_vehicle(recording, "flight/world/vehicle", one.vehicle, flight, U_T)
    error = flight.position_error.double().numpy()
    for name, values, colour in (
        ("with the adaptation", error, U_T),
        ("u_s alone", one.alone.position_error.double().numpy(), U_S),
    ):
        entity = f"flight/error/{name.replace(' ', '_')}"
        record_series(recording, entity, flight, values[:, None], [name], [rgb(colour)])
    thrusters = one.gains.shape[-1]
    names, colours = thruster_series(thrusters)
    record_series(recording, "flight/gain/estimated", flight, one.gains.numpy(), names, colours, 2.0)
    true = [f"{name}, true" for name in names]
    record_series(recording, "flight/gain/true", flight, one.true_gains.numpy(), true, [rgb(NEUTRAL)] * thrusters, 0.8)
    statistic = one.adapted.statistic.double().numpy()
    both = np.stack((statistic, np.ones_like(statistic)), axis=-1)
    record_series(recording, "flight/statistic", flight, both, ["sum", "threshold"], [rgb(U_T), rgb(NEUTRAL)])
    recording.log("flight/summary", rr.TextDocument(one.summary, media_type=rr.MediaType.MARKDOWN), static=True)
    _record_states(recording, one, error)
    _record_moments(recording, one, error)


def _record_states(recording: rr.RecordingStream, one: OneFlight, error: np.ndarray) -> None:
    """Lanes of the state timeline: what the vehicle is, what the adaptation does, where the vehicle is."""
    time = one.adapted.flight.time.double().numpy()
    changes = [moment for moment in one.moments if moment.happening is Happening.CHANGE]
    vehicle = [(0.0, _HEALTHY), *((change.time_s, change.text) for change in changes)]
    phases = [PHASES[index].name.lower() for index in one.adapted.phase.tolist()]
    near = [NEAR if value < BACK_M else FAR for value in error]
    quiet, busy = rgb(MOMENT["RECOVERED"]), rgb(MOMENT["NOTICED"])
    lanes = {
        "vehicle": (vehicle, {_HEALTHY: quiet, **{change.text: busy for change in changes}}),
        "adaptation": (
            [*zip(time, phases, strict=True)],
            {"following": quiet, "searching": busy, "frozen": rgb(MOMENT["FROZEN"])},
        ),
        "distance": ([*zip(time, near, strict=True)], {NEAR: quiet, FAR: busy}),
    }
    for lane, (states, colours) in lanes.items():
        entity = f"flight/state/{lane}"
        style = rr.StateConfiguration(values=list(colours), colors=list(colours.values()))
        recording.log(entity, style, static=True)
        before = None
        for at, state in states:
            if state != before:
                recording.set_time("time", duration=float(at))
                recording.log(entity, rr.StateChange(state=state))
                before = state
    recording.reset_time()


def _record_moments(recording: rr.RecordingStream, one: OneFlight, error: np.ndarray) -> None:
    """A line of text and a point on the curve of the error at each moment."""
    time = one.adapted.flight.time.double().numpy()
    for happening in {moment.happening for moment in one.moments}:
        colour = rgb(_COLOUR[happening.name])
        points = rr.SeriesPoints(names=happening.value, colors=[colour], markers="diamond", marker_sizes=7.0)
        recording.log(_marker(happening), points, static=True)
    for moment in one.moments:
        recording.set_time("time", duration=moment.time_s)
        colour = rgb(_COLOUR[moment.happening.name])
        text = f"{moment.happening.value}: {moment.text}"
        recording.log("flight/moments", rr.TextLog(text, level=rr.TextLogLevel.INFO, color=colour))
        height = float(np.interp(moment.time_s, time, np.nan_to_num(error, posinf=0.0)))
        recording.log(_marker(moment.happening), rr.Scalars(height))
    recording.reset_time()


def _marker(happening: Happening) -> str:
    return f"flight/error/moments/{happening.name.lower()}"
