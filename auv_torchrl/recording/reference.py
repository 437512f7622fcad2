"""Where the vehicle should be, in the viewer: a point, and the path of one that moves."""

import rerun as rr

from auv_torchrl.flight import Flight

_BLACK = (0, 0, 0)
_FAINT = (0, 0, 0, 90)


def record_reference(recording: rr.RecordingStream, entity: str, flight: Flight) -> None:
    """Log the reference of one flight, batch (T + 1)."""
    place = flight.reference_position.double().numpy()
    recording.log(f"{entity}/point", rr.Points3D([[0, 0, 0]], radii=0.03, colors=[_BLACK]), static=True)
    if not flight.moving:
        recording.log(f"{entity}/point", rr.Transform3D(translation=place[0]), static=True)
        return
    recording.log(f"{entity}/path", rr.LineStrips3D([place], colors=[_FAINT], radii=0.012), static=True)
    time = rr.TimeColumn("time", duration=flight.time.double().numpy())
    recording.send_columns(f"{entity}/point", [time], rr.Transform3D.columns(translation=place))
