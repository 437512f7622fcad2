"""Vehicle files with fewer thrusters than station keeping needs."""

import copy
from typing import Any

from auv_torchrl.vehicle import read_vehicle_file

AHEAD, DOWN = [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]
TURNING = [[1, 0, 0, 0, 0, -1], [1, 0, 0, 0, 0, 1]]  # of two propellers side by side


def with_thrusters(name: str, position: list, direction: list, mixer: list, **entries: Any) -> dict[str, Any]:
    """A bluerov2 with other thrusters."""
    content = copy.deepcopy(dict(read_vehicle_file("bluerov2")))
    del content["uncertainty"]  # it says how sure the angles of six thrusters are
    content["thrusters"] |= {"position": position, "direction": direction, **entries}
    return content | {"name": name, "mixer": mixer}


def without_sway() -> dict[str, Any]:
    """Two propellers at the stern, and one amidships that pushes down."""
    return with_thrusters(
        "three", [[-0.2, 0.2, 0.0], [-0.2, -0.2, 0.0], [0.0, 0.0, 0.0]], [AHEAD, AHEAD, DOWN],
        [*TURNING, [0, 0, 1, 0, 0, 0]],
    )  # fmt: skip


FEW = {  # with what they push
    "torpedo": (with_thrusters("torpedo", [[-0.5, 0.0, 0.0]], [AHEAD], [[1, 0, 0, 0, 0, 0]]), ("surge",)),
    "catamaran": (
        with_thrusters("catamaran", [[-0.5, 0.3, 0.0], [-0.5, -0.3, 0.0]], [AHEAD, AHEAD], TURNING),
        ("surge", "yaw"),
    ),
    "three": (without_sway(), ("surge", "heave", "yaw")),
    "lift": (
        with_thrusters(
            "lift", [[x, y, 0.0] for x in (-0.2, -0.1, 0.1, 0.2) for y in (-0.2, 0.2)], [DOWN] * 8,
            [[0, 0, 1, 0, 0, 0]] * 8,
        ),
        ("heave",),
    ),
}  # fmt: skip
