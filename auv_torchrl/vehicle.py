"""A vehicle as a tensorclass of physical parameters, batch first.

Frames: earth NED, body FRD. Degrees of freedom are ordered surge, sway, heave, roll, pitch, yaw
(Fossen 2021). Every effect of :mod:`auv_torchrl.effects` is a change of these parameters, and at the
value that :func:`load_vehicle` gives, every term that only an effect uses does nothing.
"""

from collections.abc import Mapping
from pathlib import Path
from reprlib import repr as short
from typing import Any

import torch
from tensordict import TensorClass
from torch import Tensor

from auv_torchrl.paths import config_path
from auv_torchrl.settings import choices
from auv_torchrl.vehicle_defaults import LEFT_OUT, SENSORS
from auv_torchrl.vehicle_entries import drag_matrix, each_thruster, matrix, numbers
from auv_torchrl.yaml_file import read_yaml

GRAVITY = 9.81  # m/s^2, standard gravity to the precision of the published weights
DEGREES_OF_FREEDOM = ("surge", "sway", "heave", "roll", "pitch", "yaw")
CONTROLLED = ("surge", "sway", "heave", "yaw")  # the four channels of an action
CONTROLLED_INDEX = tuple(DEGREES_OF_FREEDOM.index(name) for name in CONTROLLED)


class Vehicle(TensorClass):
    """Physical parameters of a batch of vehicles, shapes behind the batch in each comment."""

    # rigid body
    mass: Tensor  # () kg
    inertia: Tensor  # (3,) kg m^2, principal, about the centre of mass
    centre_of_mass: Tensor  # (3,) m
    centre_of_buoyancy: Tensor  # (3,) m
    buoyancy: Tensor  # () N, all of it in the water
    hull_height: Tensor  # () m, over which it leaves the water, about that centre; 0 that of a cube of its volume
    free: Tensor  # (6,) 1 where a degree of freedom moves, 0 where it is held
    payload_mass: Tensor  # () kg, carried rigidly
    payload_weight: Tensor  # () N, its weight in water, down positive
    payload_position: Tensor  # (3,) m
    vertical_force: Tensor  # () N along earth z, down positive
    # water
    added_mass: Tensor  # (6,) kg, kg m^2, positive
    mass_scale: Tensor  # (6,) on the total of rigid body and added mass
    linear_drag: Tensor  # (6, 6) kg/s, kg m^2/s
    quadratic_drag: Tensor  # (6,) kg/m, kg m^2
    drag_asymmetry: Tensor  # (6,) it is 1 + this times that ahead, to starboard or down, and 1 - this the other way
    coriolis: Tensor  # () 0 none, 1 the full rigid-body and added-mass Coriolis terms
    current: Tensor  # (3,) m/s, north, east, down
    tether_anchor: Tensor  # (3,) m, earth
    tether_stiffness: Tensor  # () N/m
    tether_slack: Tensor  # () m
    surface: Tensor  # () m, z of the surface of the water
    air: Tensor  # () share of the water's density that is missing above it: 0 water everywhere, 1 air
    # thrusters, n of them
    thruster_position: Tensor  # (n, 3) m
    thruster_direction: Tensor  # (n, 3) unit vectors of the force at a positive command
    mixer: Tensor  # (n, 6) commands per unit demand in each degree of freedom
    routing: Tensor  # (n, n) which command reaches which thruster
    full_thrust: Tensor  # (n,) N at command +1
    asymmetry: Tensor  # (n,) reverse thrust is weaker by this share, stronger where it is below 0
    exponent: Tensor  # (n,) of the thrust curve
    dead_band: Tensor  # (n,) N
    limit: Tensor  # (n,) N
    gain: Tensor  # (n,) on the thrust, after the limit
    reaction: Tensor  # (n,) m, moment about its direction per newton of its thrust: the propeller turns the other way
    volts: Tensor  # () V at which full_thrust holds and from which thrust follows logged volts; 0 where it does not
    lag: Tensor  # (n,) s
    delay: Tensor  # () s
    battery_sag: Tensor  # () share of the thrust lost per minute
    # sensors
    heading_bias: Tensor  # () rad, measured yaw minus true yaw
    pose_delay: Tensor  # () s
    position_scale: Tensor  # () reported positions are the true ones times this
    depth_scale: Tensor  # () and depths times this, too
    depth_bias: Tensor  # () m, reported depth minus true depth
    velocity_scale: Tensor  # () reported linear velocities are the true ones times this
    dvl_position: Tensor  # (3,) m, where the Doppler log feels them
    dvl_turn: Tensor  # () rad, about body z from the axes of the body to those of the Doppler log
    gyro_bias: Tensor  # (3,) rad/s, reported angular rates minus true ones
    accelerometer_bias: Tensor  # (3,) m/s^2, reported specific force minus the true one
    accelerometer_position: Tensor  # (3,) m, where it is felt
    compass_per_load: Tensor  # () rad that the measured yaw turns by while all thrusters give their full thrust
    position_noise: Tensor  # () m, standard deviation per axis
    attitude_noise: Tensor  # () rad, standard deviation per axis

    @property
    def thrusters(self) -> int:
        """Number of thrusters."""
        return self.gain.shape[-1]


_VECTORS = {  # section -> key -> length; 0 is a scalar
    "rigid_body": {
        "mass": 0,
        "inertia": 3,
        "centre_of_mass": 3,
        "centre_of_buoyancy": 3,
        "buoyancy": 0,
        "hull_height": 0,
    },
    "": {
        "added_mass": 6,
        "mass_scale": 6,
        "linear_drag": 6,
        "quadratic_drag": 6,
        "drag_asymmetry": 6,
        "coriolis": 0,
        "surface": 0,
        "air": 0,
    },
    "thrusters": dict.fromkeys(
        ("full_thrust", "asymmetry", "exponent", "dead_band", "limit", "lag", "delay", "reaction", "volts"), 0
    ),
}
_NOTHING = ("payload_mass", "payload_weight", "vertical_force", "tether_stiffness", "tether_slack", "battery_sag",
            "compass_per_load", "position_noise", "attitude_noise")  # fmt: skip
_NOWHERE = ("payload_position", "current", "tether_anchor", "gyro_bias")
_PER_THRUSTER = _VECTORS["thrusters"].keys() - {"delay", "volts"}  # one number for all, or one each
_POSITIVE = {"mass", "inertia", "buoyancy", "mass_scale", "full_thrust", "exponent", "limit"}
_NON_NEGATIVE = {"added_mass", "linear_drag", "quadratic_drag", "coriolis", "dead_band", "lag", "delay", "volts",
                 "hull_height", "air"}  # fmt: skip
_SAID_OF_IT = {"name", "uncertainty", "calibration"}  # what the diagnosis and the training read besides


def read_vehicle_file(vehicle: str | Path | Mapping[str, Any]) -> Mapping[str, Any]:
    """The sections of a vehicle from a name in ``conf/vehicle`` or a YAML file; a mapping is what it is.

    Raises:
        FileNotFoundError: for an unknown name, or a file that does not exist.
        ValueError: for a file that :func:`auv_torchrl.yaml_file.read_yaml` refuses.
    """
    return vehicle if isinstance(vehicle, Mapping) else read_yaml(_file(vehicle), "vehicle")


def _file(vehicle: str | Path) -> Path:
    return Path(vehicle) if str(vehicle).endswith((".yaml", ".yml")) else config_path("vehicle", str(vehicle))


def load_vehicle(vehicle: str | Path | Mapping[str, Any], dtype: torch.dtype = torch.float64) -> Vehicle:
    """One nominal vehicle (empty batch) from a name in ``conf/vehicle``, a YAML file or a mapping.

    Raises:
        FileNotFoundError: for an unknown name.
        ValueError: for a missing, unknown, misshapen or unphysical entry, naming it and the file.
    """
    content = read_vehicle_file(vehicle)
    try:
        return _nominal(content).to(dtype).clone()
    except ValueError as error:
        if isinstance(vehicle, Mapping):
            raise
        raise ValueError(f"{_file(vehicle)}: {error}") from error


def _nominal(vehicle: Mapping[str, Any]) -> Vehicle:
    fields: dict[str, Any] = _read_fields(vehicle)
    rows = vehicle["thrusters"]
    position = matrix("thrusters.position", rows.get("position"), 3)
    direction = matrix("thrusters.direction", rows.get("direction"), 3)
    mixer = matrix("mixer", vehicle["mixer"], 6)
    n = len(position)
    if not len(direction) == len(mixer) == n:
        raise ValueError(
            f"vehicle: thrusters.position has {n} rows, thrusters.direction {len(direction)}, mixer {len(mixer)}: "
            "give one row per thruster in each"
        )
    if ((length := direction.norm(dim=-1, keepdim=True)) < 1e-9).any():
        raise ValueError("vehicle: a row of thrusters.direction is zero: give the direction of its force")
    per_thruster: dict[str, Any] = {key: fields.pop(key).expand(n) for key in _PER_THRUSTER}
    zero, one = torch.tensor([0.0, 1.0], dtype=torch.float64)
    return Vehicle(
        **fields,
        **per_thruster,
        free=one.expand(6),
        **dict.fromkeys(_NOTHING, zero),
        **dict.fromkeys(_NOWHERE, zero.expand(3)),
        thruster_position=position,
        thruster_direction=direction / length,
        mixer=mixer,
        routing=torch.eye(n, dtype=torch.float64),
        gain=one.expand(n),
        **_read_sensors(vehicle.get("sensors", {})),
        batch_size=[],
    )


def _read_fields(vehicle: Mapping[str, Any]) -> dict[str, Tensor]:
    known = {"rigid_body", "thrusters", "mixer", "sensors", *_SAID_OF_IT, *_VECTORS[""]}
    if odd := sorted(map(str, set(vehicle) - known)):
        raise ValueError(f"vehicle: unknown entries {odd}: {choices(odd, sorted(known))}")
    fields = {}
    for section, keys in _VECTORS.items():
        block = vehicle.get(section, {}) if section else {key: vehicle[key] for key in keys if key in vehicle}
        if not isinstance(block, Mapping):
            raise ValueError(f"vehicle: {section} is {short(block)}: give a mapping with {', '.join(keys)}")
        block = LEFT_OUT[section] | dict(block)
        allowed = set(keys) | ({"position", "direction"} if section == "thrusters" else set())
        if odd := sorted(map(str, set(block) - allowed)):
            raise ValueError(f"vehicle: unknown entries {odd} in {section}: {choices(odd, sorted(allowed))}")
        for key, length in keys.items():
            label = f"{section}.{key}" if section else key
            if key not in block:
                raise ValueError(f"vehicle: {label} is missing")
            if key in _PER_THRUSTER and isinstance(block[key], list | tuple):
                fields[key] = each_thruster(label, block[key], block.get("position"))
            elif key == "linear_drag":
                fields[key] = drag_matrix(block[key])
            else:
                fields[key] = numbers(label, block[key], (length,) if length else ())
            if key in _POSITIVE and not (fields[key] > 0).all():
                raise ValueError(f"vehicle: {label} is {short(block[key])}: give values above 0")
            if key.endswith("asymmetry") and not (fields[key].abs() < 1).all():
                raise ValueError(f"vehicle: {label} is {short(block[key])}: give a share below 1, and above -1")
            if key == "air" and not fields[key] <= 1:
                raise ValueError(f"vehicle: {label} is {short(block[key])}: give 1 for air, 0 for water everywhere")
            sizes = fields[key].diagonal() if key == "linear_drag" else fields[key]
            if key in _NON_NEGATIVE and not (sizes >= 0).all():
                raise ValueError(f"vehicle: {label} is {short(block[key])}: give values of 0 or more")
    if "mixer" not in vehicle:
        raise ValueError("vehicle: mixer is missing")
    return fields


def _read_sensors(block: Any) -> dict[str, Any]:
    if not isinstance(block, Mapping):
        raise ValueError(f"vehicle: sensors is {short(block)}: give a mapping with some of {', '.join(SENSORS)}")
    if odd := sorted(map(str, set(block) - set(SENSORS))):
        raise ValueError(f"vehicle: unknown entries {odd} in sensors: {choices(odd, sorted(SENSORS))}")
    found = {key: numbers(f"sensors.{key}", block.get(key, v), torch.tensor(v).shape) for key, v in SENSORS.items()}
    if not found["pose_delay"] >= 0 or any(found[key] == 0 for key in SENSORS if key.endswith("_scale")):
        raise ValueError("vehicle: sensors has a delay below 0 or a scale of 0: give what the sensors report")
    return found
