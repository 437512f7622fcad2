"""Which vehicle a log may come from: what its frame and its thrusters say."""

from collections.abc import Mapping
from typing import Any

from auv_torchrl.quantities import counted

_OF_FRAME = {"vectored": "bluerov2", "vectored_6dof": "bluerov2_heavy"}  # of ArduSub, as conf/vehicle has them
_OF_THRUSTERS = {6: "bluerov2", 8: "bluerov2_heavy"}
EXAMPLE_AXES = {"x", "y", "z", "yaw"}  # measured in a log of the paper's vehicle, which neither rolls nor pitches


def propose(about: Mapping[str, Any], earlier: str = "") -> tuple[str, str]:
    """A vehicle and why; two empty texts where nothing says which.

    Args:
        about: what was read of the log.
        earlier: the vehicle of the last dive with this frame and as many thrusters; empty for none.
    """
    frame, thrusters, axes = about.get("frame", ""), about.get("thrusters"), set(about.get("axes", ()))
    if earlier:
        return (
            earlier,
            "as for the last dive with this frame"
            if frame
            else f"as for the last dive with {counted(thrusters or 0, 'thruster')}",
        )
    if frame in _OF_FRAME:
        return _OF_FRAME[frame], f"the frame is {frame}"
    if thrusters == 6 and axes == EXAMPLE_AXES:
        return "paper", "it has 6 thrusters and is measured level"
    if thrusters in _OF_THRUSTERS:
        return _OF_THRUSTERS[thrusters], f"it has {counted(thrusters, 'thruster')}"
    return "", ""
