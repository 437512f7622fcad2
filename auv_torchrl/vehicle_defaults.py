"""What a vehicle file need not say, and what it then means; here for who reads a command line and loads no torch."""

SENSORS = {  # what a vehicle's own sensors are off by, where that is known; the nominal values are those of true ones
    "heading_bias": 0.0, "pose_delay": 0.0, "position_scale": 1.0, "depth_scale": 1.0, "depth_bias": 0.0,
    "velocity_scale": 1.0, "dvl_position": (0.0,) * 3, "dvl_turn": 0.0,
    "accelerometer_position": (0.0,) * 3, "accelerometer_bias": (0.0,) * 3,
}  # fmt: skip
LEFT_OUT = {  # by section, but the sensors
    "": {"mass_scale": [1.0] * 6, "drag_asymmetry": [0.0] * 6, "surface": 0.0, "air": 0.0},
    "rigid_body": {"hull_height": 0.0},
    "thrusters": {"reaction": 0.0, "volts": 0.0},
}


def may_be_left_out(key: str) -> bool:
    """Whether it is the key of such an entry on a command line: ``vehicle.thrusters.volts``."""
    root, _, entry = key.partition(".")
    section, _, name = entry.rpartition(".")
    return root == "vehicle" and name in {**LEFT_OUT, "sensors": SENSORS}.get(section, {})
