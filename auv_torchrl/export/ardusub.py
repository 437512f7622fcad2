"""What ArduSub has to be told for a vehicle: parameters. Its own simulator takes no mass and no drag from outside.

The firmware's built-in vehicle has its coefficients in its source. This vehicle flies behind it with ``auv-sim``.
"""

from auv_torchrl.autopilot import FRAMES, frame_scale, function_of
from auv_torchrl.export.marks import Described
from auv_torchrl.vehicle import CONTROLLED_INDEX


def ardusub(described: Described) -> str:
    """A file of parameters.

    Raises:
        ValueError: for a vehicle whose mixer is that of no frame that is known.
    """
    vehicle = described.vehicle
    mixer = vehicle.mixer[:, list(CONTROLLED_INDEX)]
    frame = next((number for number in FRAMES if frame_scale(number, mixer.tolist()) is not None), None)
    names = {1: "bluerov2", 2: "bluerov2_heavy"}
    if frame is None:
        raise ValueError(
            f"vehicle={described.source} shares commands out as none of ArduSub's frames that are known, "
            f"{', '.join(name for name, _ in FRAMES.values())}: give thrusters in the order and mixer of "
            f"{' or '.join(names.values())}"
        )
    lines = [
        f"# {described.name}, written by auv-export from {described.source}",
        *(f"# {line}" for line in described.remarks),
        "# ArduSub's own simulator has its mass, drag and thrust in its source; to fly those of this vehicle:",
        f"#   auv-sim --vehicle {described.source}",
        "#   ardusub --model JSON:127.0.0.1 --home 33.81,-118.39,0,0 --defaults sub.parm,vehicle.parm",
        f"FRAME_CONFIG {frame}  # {FRAMES[frame][0]}",
        "SIM_RATE_HZ 400",
        "BARO_SPEC_GRAV 1.024  # sea water, which ArduSub simulates",
        "BATT_MONITOR 0  # thrust does not follow the volts that it would simulate",
    ]
    for number in range(1, vehicle.thrusters + 1):
        lines.append(f"SERVO{number}_FUNCTION {function_of(number)}")
        lines.append(f"MOT_{number}_DIRECTION 1")
    return "\n".join([*lines, ""])
