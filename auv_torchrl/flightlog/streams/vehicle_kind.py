"""Whether a log was written by an underwater vehicle: what its firmware's text, its build and its type say together."""

import re
from collections.abc import Iterable

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.streams.stream import Kind, Streams

_FIRMWARE = {  # names that ArduPilot's firmware gave itself; "APM:Copter" and "APMrover2" are older ones
    "ArduSub": True, "APM:Sub": True,
    **dict.fromkeys(("ArduCopter", "APM:Copter", "ArduPlane", "APM:Plane", "ArduRover", "APM:Rover", "APMrover2",
                     "AntennaTracker", "Blimp"), False),
}  # fmt: skip
_NAMES = "|".join(map(re.escape, _FIRMWARE))
_TEXT = re.compile(rf"^({_NAMES})\b|\b({_NAMES}) V[0-9]", re.ASCII)  # "[ArduSub V4.1]" in custom builds
_MAV_TYPES: dict[float, str] = {  # https://mavlink.io/en/messages/minimal.html#MAV_TYPE
    1: "a fixed-wing aircraft", 2: "a quadrotor", 3: "a coaxial helicopter", 4: "a helicopter", 5: "an antenna tracker",
    7: "an airship", 8: "a balloon", 9: "a rocket", 10: "a ground rover", 11: "a surface boat", 12: "a submarine",
    13: "a hexarotor", 14: "an octorotor", 15: "a tricopter", 16: "a flapping wing", 17: "a kite",
    **dict.fromkeys(range(19, 26), "a VTOL aircraft"), 28: "a parafoil", 29: "a dodecarotor", 35: "a decarotor",
    43: "a multirotor", 44: "a multirotor",
}  # fmt: skip
_SUBMARINE = 12
_BUILDS: dict[float, str] = {  # APM_BUILD_DIRECTORY of ArduPilot's AP_Vehicle_Type.h; others are no vehicles
    1: "ArduRover", 2: "ArduCopter", 3: "ArduPlane", 4: "AntennaTracker", 7: "ArduSub", 12: "Blimp",
    13: "a helicopter of ArduCopter",
}  # fmt: skip


def kind_of_text(text: str, source: str) -> Kind | None:
    """The kind of vehicle that a text of ArduPilot names with its version; None if it names none."""
    named = _TEXT.search(text)
    if named is None:
        return None
    name = named[1] or named[2]
    return Kind(source, name, _FIRMWARE[name])


def kind_of_type(mav_type: float, source: str) -> Kind | None:
    """The kind of vehicle of a MAV_TYPE; None for a generic or unknown one."""
    named = _MAV_TYPES.get(mav_type)
    return None if named is None else Kind(source, named, mav_type == _SUBMARINE)


def kind_of_build(build: float, source: str) -> Kind | None:
    """The kind of vehicle for which a firmware of ArduPilot was built; None for what is no vehicle."""
    named = _BUILDS.get(build)
    return None if named is None else Kind(source, named, _FIRMWARE.get(named, False))


def other_kind(kinds: Iterable[Kind]) -> str:
    """What the vehicle is, and what says so, where nothing says that it goes under water; empty otherwise."""
    kinds = tuple(kinds)
    if not kinds or any(kind.underwater for kind in kinds):
        return ""
    sources: dict[str, list[str]] = {}
    for kind in kinds:
        sources.setdefault(kind.name, []).append(kind.source)
    return " and ".join(f"{name} ({', '.join(names)})" for name, names in sources.items())


def check_kind(streams: Streams) -> list[Finding]:
    """A finding where one thing says that the vehicle goes under water and another that it does not.

    Raises:
        FlightLogError: where all that is said names other vehicles.
    """
    kinds = streams.vehicle.kinds
    if other := other_kind(kinds):
        raise FlightLogError(
            f"{streams.name} was written by {other}: no underwater vehicle, and only those are diagnosed: give the log "
            "of one"
        )
    if all(kind.underwater for kind in kinds):
        return []
    listed = " and ".join(f"{kind.name} ({kind.source})" for kind in kinds)
    sentence = f"the file names more than one kind of vehicle, {listed}; it is read as that of an underwater vehicle"
    return [Finding(Severity.WARNING, "vehicle_kind", sentence, "Give another log if it is none")]
