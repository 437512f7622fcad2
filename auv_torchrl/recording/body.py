"""A vehicle in the viewer: hull, thrusters, and the force of each as an arrow, moving along a flight."""

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from auv_torchrl.palette import rgb
from auv_torchrl.recording.series import thruster_series, time_of
from auv_torchrl.vehicle import Vehicle

if TYPE_CHECKING:
    from auv_torchrl.flight import Flight

ARROW_M_PER_N = 0.006  # 50 N is drawn 0.3 m long
HULL_MARGIN_M = 0.05  # the hull encloses the thrusters and this much more
HULL_HEIGHT_M = 0.20  # at least; a BlueROV2 is 0.25 m high
THRUSTER_M = (0.04, 0.1)  # radius and length of a T200, rounded


def record_vehicle(recording: rr.RecordingStream, entity: str, vehicle: Vehicle, flight: "Flight", colour: str) -> None:
    """Log a vehicle under ``entity`` with its pose and thruster forces over time.

    Args:
        recording: stream to log to.
        entity: path of the vehicle, e.g. ``world/u_t/start_1``.
        vehicle: one vehicle (no batch), for the places and directions of its thrusters.
        flight: one start, batch (T + 1).
        colour: of the hull, ``#RRGGBB``.
    """
    record_hull(recording, entity, vehicle, colour)
    pose = flight.position.numpy(), flight.quaternion.double().numpy()
    record_motion(recording, entity, vehicle, time_of(flight), *pose, flight.thrust.double().numpy())


def record_hull(recording: rr.RecordingStream, entity: str, vehicle: Vehicle, colour: str) -> None:
    """Log what of a vehicle does not change: hull and thrusters, and where the arrows of its forces begin."""
    position = vehicle.thruster_position
    direction = vehicle.thruster_direction
    half = np.abs(position).max(axis=0) + HULL_MARGIN_M
    half[2] = max(half[2], HULL_HEIGHT_M / 2)
    _, thruster_colours = thruster_series(len(position))
    recording.log(
        f"{entity}/hull", rr.Boxes3D(half_sizes=[half], colors=[rgb(colour)], fill_mode="majorwireframe"), static=True
    )
    nose = rr.Arrows3D(vectors=[[half[0] + 0.1, 0, 0]], colors=[rgb(colour)], radii=0.012)
    recording.log(f"{entity}/nose", nose, static=True)
    radius, length = THRUSTER_M
    recording.log(
        f"{entity}/thrusters",
        rr.Cylinders3D(
            radii=radius,
            lengths=length,
            centers=position,
            quaternions=[rr.Quaternion(xyzw=_from_z_to(axis)) for axis in direction],
            colors=thruster_colours,
            fill_mode="solid",
        ),
        static=True,
    )
    static = rr.Arrows3D.from_fields(origins=position, colors=thruster_colours, radii=[0.015] * len(position))
    recording.log(f"{entity}/force", static, static=True)


def record_motion(
    recording: rr.RecordingStream,
    entity: str,
    vehicle: Vehicle,
    time: rr.TimeColumn,
    position: np.ndarray,
    quaternion: np.ndarray,
    thrust: np.ndarray,
) -> None:
    """Log where a vehicle is, ``position`` (T, 3) and ``quaternion`` (T, 4), and what thrusters give, (T, n) in N."""
    turned = np.roll(quaternion, -1, axis=-1)
    recording.send_columns(entity, [time], rr.Transform3D.columns(translation=position, quaternion=turned))
    force = thrust[..., None] * vehicle.thruster_direction * ARROW_M_PER_N
    samples, thrusters, _ = force.shape
    arrows = rr.Arrows3D.columns(vectors=force.reshape(-1, 3)).partition([thrusters] * samples)
    recording.send_columns(f"{entity}/force", [time], arrows)


def _from_z_to(axis: np.ndarray) -> np.ndarray:
    """Quaternion (x, y, z, w) that turns the z axis into a unit vector."""
    if axis[2] < -1 + 1e-9:
        return np.array([1.0, 0.0, 0.0, 0.0])
    half = np.array([-axis[1], axis[0], 0.0, 1.0 + axis[2]])
    return half / np.linalg.norm(half)
