"""Whether the vehicle that people name can be the one that a log was written by."""

import numpy as np

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.streams.stream import Streams
from auv_torchrl.flightlog.tables.columns import DEMANDS
from auv_torchrl.flightlog.tables.table import Table
from auv_torchrl.paths import config_names
from auv_torchrl.quantities import counted
from auv_torchrl.vehicle import Vehicle, load_vehicle

_LEVEL = (  # of the horizontal motors: what a positive command does along surge, sway, heave, roll, pitch, yaw
    (-1, 1, 0, 0, 0, 1),
    (-1, -1, 0, 0, 0, -1),
    (1, 1, 0, 0, 0, -1),
    (1, -1, 0, 0, 0, 1),
)
_PUSHES = {  # the signs of ArduSub's AP_Motors6DOF, down positive; 0 is not compared
    "vectored": (*_LEVEL, (0, 0, 1, 1, 0, 0), (0, 0, 1, -1, 0, 0)),
    "vectored_6dof": (*_LEVEL, (0, 0, 1, 1, -1, 0), (0, 0, 1, -1, -1, 0), (0, 0, 1, 1, 1, 0), (0, 0, 1, -1, 1, 0)),
}
_NEXT_TO_NOTHING = 0.02  # m or 1, of a direction or arm: mounted so on purpose, or a rounding


def check_frame(streams: Streams, table: Table, vehicle: Vehicle) -> list[Finding]:
    """A finding where thrusters of the vehicle point another way than the motors of the frame that was flown.

    Raises:
        FlightLogError: for another number of thrusters than motors, naming the vehicles that have as many.
    """
    motors = sum(name.startswith("cmd_") and name not in DEMANDS for name in table.columns)
    frame = streams.vehicle.frame
    if motors and motors != vehicle.thrusters:
        fitting = [name for name in config_names("vehicle") if _fits(load_vehicle(name), motors, frame)]
        named = " or ".join(f"vehicle={name}" for name in fitting)
        raise FlightLogError(
            f"{streams.name} was written by a vehicle with {f'the frame {frame}, ' if frame else ''}"
            f"{counted(motors, 'motor')}, the vehicle file has {counted(vehicle.thrusters, 'thruster')}: give "
            f"{named + ', or ' if named else ''}a vehicle file of yours"
        )
    if not (other := _other_way(vehicle, frame)):
        return []
    which = ", ".join(map(str, other))
    sentence = f"thrusters {which} of the vehicle file point another way than these motors of the frame {frame}"
    remedy = "Number and direct the thrusters of the vehicle file as the frame does"
    return [Finding(Severity.WARNING, "other_frame", sentence, remedy, limits=True)]


def _fits(vehicle: Vehicle, motors: int, frame: str) -> bool:
    return vehicle.thrusters == motors and not _other_way(vehicle, frame)


def _other_way(vehicle: Vehicle, frame: str) -> list[int]:
    """Thrusters, from 1, whose force or moment has another sign than the frame says."""
    expected = _PUSHES.get(frame)
    if expected is None or len(expected) != vehicle.thrusters:
        return []
    direction = vehicle.thruster_direction
    moment = np.cross(vehicle.thruster_position, direction)
    pushes = np.concatenate((direction, moment), axis=-1)
    pushes = np.where(np.abs(pushes) < _NEXT_TO_NOTHING, 0, np.sign(pushes))
    wanted = np.array(expected)
    return (np.flatnonzero(((wanted != 0) & (pushes != wanted)).any(axis=-1)) + 1).tolist()
