"""Which vehicles are flown: an ArduSub whose version, frame and settings are understood. All others are left alone."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from auv_torchrl.autopilot import FRAMES, frame_scale
from auv_torchrl.fly.channels import ALONG, Channels, Interface, parameters_of, travel_of
from auv_torchrl.quantities import counted

SUBMARINE, ARDUPILOT = 12, 3  # HEARTBEAT.type and .autopilot
MANUAL = 19  # number of ArduSub's mode in which inputs go straight to the mixer
ARMED = 128  # of HEARTBEAT.base_mode
KNOWN = (4, 1), (4, 7)  # oldest and newest version of ArduSub whose inputs are those of channels.py
GROUND_STATION = ("MAV_GCS_SYSID", "SYSID_MYGCS")  # 4.7 and before: whose inputs are obeyed
_ROLES = ("pitch", "roll", "throttle", "yaw", "forward", "lateral")
NEEDED = ("FRAME_CONFIG", "ACRO_YAW_P", *(name for number in range(1, 7) for name in parameters_of(number)))
OF_MANUAL = ("JS_THR_GAIN", "JS_GAIN_DEFAULT")  # what MANUAL_CONTROL passes
FAILSAFE = "FS_PILOT_INPUT"


class UnknownVehicle(ValueError):
    """A vehicle that is not flown; the message says what is not as it has to be, and what to do."""


@dataclass(frozen=True)
class Identity:
    """What a vehicle said of itself."""

    kind: int  # HEARTBEAT.type
    autopilot: int
    version: tuple[int, int] | None  # of the firmware
    parameters: Mapping[str, float]


def check_heartbeat(kind: int, autopilot: int) -> None:
    """Refuse what is no ArduSub.

    Raises:
        UnknownVehicle: for another vehicle or another firmware.
    """
    if (kind, autopilot) != (SUBMARINE, ARDUPILOT):
        raise UnknownVehicle(
            f"the vehicle is of type {kind} with autopilot {autopilot}, a submarine (12) with ArduPilot (3) is flown: "
            "give the connection of an ArduSub"
        )


def check_version(version: tuple[int, int] | None, tried: str | None) -> None:
    """Refuse a version that nobody has looked at.

    Args:
        version: of the firmware; None where it did not say.
        tried: another version that the user vouches for, as "4.8".

    Raises:
        UnknownVehicle: for another one.
    """
    if version is None:
        raise UnknownVehicle("the vehicle does not tell its version (AUTOPILOT_VERSION): give the connection once more")
    found = "{}.{}".format(*version)
    if not KNOWN[0] <= version <= KNOWN[1] and found != tried:
        raise UnknownVehicle(
            f"the vehicle has ArduSub {found}, {'{}.{}'.format(*KNOWN[0])} to {'{}.{}'.format(*KNOWN[1])} are flown: "
            f"install one of these, or try it in ArduSub's simulator and give firmware='\"{found}\"'"
        )


def scale_of(frame: float, mixer: Sequence[Sequence[float]]) -> tuple[float, ...]:
    """(4,) what a command of 1 is of the full travel of its input, for a policy whose vehicle has this mixer (n, 4).

    Raises:
        UnknownVehicle: for another frame, or a mixer that does not share commands out as the frame does.
    """
    known = ", ".join(f"{number} ({name})" for number, (name, _) in FRAMES.items())
    if frame not in FRAMES:
        raise UnknownVehicle(f"the vehicle has FRAME_CONFIG {frame:g}, flown are {known}: fly one of these")
    name, factors = FRAMES[int(frame)]
    trained = f"the policy was trained for a vehicle with {counted(len(mixer), 'thruster')}"
    wanted = f"{trained}, and the vehicle's frame is {name}"
    if len(mixer) != len(factors):
        raise UnknownVehicle(f"{wanted}, which has {len(factors)}: give a policy that was trained for such a vehicle")
    scale = frame_scale(int(frame), mixer)
    if scale is None:
        raise UnknownVehicle(
            f"{wanted}, which shares commands out otherwise: give a policy that was trained for vehicle=bluerov2 "
            "(vectored) or vehicle=bluerov2_heavy (vectored_6dof)"
        )
    return scale


def channels_of(
    heard: Identity, contract: Mapping[str, Any], interface: Interface, system: int, tried: str | None
) -> Channels:
    """How commands reach this vehicle.

    Args:
        heard: what the vehicle says of itself.
        contract: of the policy.
        interface: by which message commands are sent.
        system: the number of ours.
        tried: see :func:`check_version`.

    Raises:
        UnknownVehicle: where the vehicle is not one that is flown.
    """
    check_heartbeat(heard.kind, heard.autopilot)
    check_version(heard.version, tried)
    parameters = heard.parameters
    obeyed = [parameters[name] for name in GROUND_STATION if name in parameters]
    needed = (*NEEDED, *(OF_MANUAL if interface is Interface.MANUAL else ()))
    missing = [name for name in needed if not math.isfinite(parameters.get(name, math.nan))]
    if missing or not obeyed:
        raise UnknownVehicle(
            f"the vehicle does not tell {', '.join(missing or GROUND_STATION[:1])}: look at the connection, and give "
            "it once more"
        )
    if system not in obeyed:
        raise UnknownVehicle(f"the vehicle obeys the ground station {obeyed[0]:g}: give system={obeyed[0]:g}")
    scale = scale_of(parameters["FRAME_CONFIG"], contract["vehicle"]["mixer"])
    yaw_gain = parameters["ACRO_YAW_P"]
    if not yaw_gain > 0:
        raise UnknownVehicle(f"ACRO_YAW_P is {yaw_gain:g}, and scales yaw in MANUAL: set it above 0, as 3.375")
    try:
        travels = {number: travel_of(number, parameters) for number in range(1, 7)}
    except ValueError as error:
        raise UnknownVehicle(str(error)) from error
    return Channels(interface, scale, travels, yaw_gain, parameters.get("JS_THR_GAIN", 1.0))


def weakest(channels: Channels, gain: float) -> tuple[str, float]:
    """The input with the least authority, and how much of a command of 1 reaches it."""
    reached = {}
    for number, (channel, _) in ALONG.items():
        command = [0.0] * len(ALONG)
        command[channel] = 1.0
        reached[_ROLES[number - 1]] = abs(channels.sent(command, gain).command[channel])
    name = min(reached, key=lambda role: reached[role])
    return name, reached[name]
