"""A vehicle as a tensorclass of physical parameters, batch first.

Frames: earth NED, body FRD. Degrees of freedom are ordered surge, sway, heave, roll, pitch, yaw
(Fossen 2021). Every effect of :mod:`auv_torchrl.effects` is a change of these parameters, and at the
value that :func:`load_vehicle` gives, every term that only an effect uses does nothing.
"""

import logging
from collections.abc import Mapping
from pathlib import Path
from reprlib import repr as short
from typing import Any

import numpy as np
import torch
from tensordict import TensorClass
from torch import Tensor

from auv_torchrl.paths import config_path
from auv_torchrl.quantities import counted
from auv_torchrl.settings import choices
from auv_torchrl.vehicle_checks import doubts, impossible
from auv_torchrl.vehicle_entries import bounded, drag_matrix, each_thruster, matrix, numbers
from auv_torchrl.vehicle_fields import BY_LABEL, CONTROLLED, DEGREES_OF_FREEDOM, FIELDS, MIXER, Field, label
from auv_torchrl.yaml_file import read_yaml

log = logging.getLogger(__name__)

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


_NOTHING = ("payload_mass", "payload_weight", "vertical_force", "tether_stiffness", "tether_slack", "battery_sag",
            "compass_per_load", "position_noise", "attitude_noise")  # fmt: skip
_NOWHERE = ("payload_position", "current", "tether_anchor", "gyro_bias")
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

    What is possible and hardly plausible is logged as a warning, with the unit that it looks like.

    Raises:
        FileNotFoundError: for an unknown name.
        ValueError: for a missing, unknown, misshapen or impossible entry, naming it and the file.
    """
    content = read_vehicle_file(vehicle)
    source = "vehicle" if isinstance(vehicle, Mapping) else f"{_file(vehicle)}: vehicle"
    try:
        loaded = _nominal(content)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from error
    for doubt in vehicle_doubts(loaded):
        log.warning("%s: %s", source, doubt)
    return loaded.to(dtype).clone()


def vehicle_doubts(vehicle: Vehicle) -> tuple[str, ...]:
    """What is implausible about a nominal vehicle (empty batch), a sentence each with the unit that it looks like."""
    return doubts(_by_label(vehicle))


def _by_label(vehicle: Vehicle) -> dict[str, np.ndarray]:
    """What a vehicle's file says of it, by the labels of the entries, thrusters one by one."""
    field_of = {"thrusters.position": "thruster_position", "thrusters.direction": "thruster_direction"}
    return {name: vehicle.get(field_of.get(name, name.rpartition(".")[2])).numpy() for name in BY_LABEL}


def _nominal(content: Mapping[str, Any]) -> Vehicle:
    known = {*FIELDS, *FIELDS[""], "mixer", *_SAID_OF_IT} - {""}
    if odd := sorted(map(str, set(content) - known)):
        raise ValueError(f"unknown entries {odd}: {choices(odd, sorted(known))}")
    if not isinstance(content.get("name", ""), str):
        raise ValueError(f"name is {short(content['name'])}: give a word, in quotes if need be")
    fields: dict[str, Any] = {}
    for section in FIELDS:
        fields |= _read_section(section, content)
    if "mixer" not in content:
        raise ValueError("mixer is missing")
    mixer = matrix("mixer", content["mixer"], MIXER.length)
    position, direction = fields.pop("position"), fields.pop("direction")
    n = len(position)
    if not len(direction) == len(mixer) == n:
        raise ValueError(
            f"thrusters.position has {counted(n, 'row')}, thrusters.direction {len(direction)}, mixer {len(mixer)}: "
            "give one row per thruster in each"
        )
    if ((length := direction.norm(dim=-1, keepdim=True)) < 1e-9).any():
        raise ValueError("a row of thrusters.direction is zero: give the direction of its force")
    per_thruster: dict[str, Any] = {
        key: fields.pop(key).expand(n) for key, kind in FIELDS["thrusters"].items() if kind.each
    }
    zero, one = torch.tensor([0.0, 1.0], dtype=torch.float64)
    vehicle = Vehicle(
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
        batch_size=[],
    )
    if wrong := impossible(_by_label(vehicle)):
        raise ValueError(wrong)
    return vehicle


def _read_section(section: str, content: Mapping[str, Any]) -> dict[str, Tensor]:
    """The entries of a section, checked one by one."""
    kinds = FIELDS[section]
    block = content.get(section, {}) if section else {key: content[key] for key in kinds if key in content}
    if not isinstance(block, Mapping):
        raise ValueError(f"{section} is {short(block)}: give a mapping with {', '.join(kinds)}")
    if odd := sorted(map(str, set(block) - set(kinds))):
        raise ValueError(f"unknown entries {odd} in {section}: {choices(odd, sorted(kinds))}")
    if missing := [key for key, kind in kinds.items() if kind.default is ... and key not in block]:
        raise ValueError(f"{', '.join(label(section, key) for key in missing)} {_is(missing)} missing")
    return {
        key: _read_entry(label(section, key), kind, block.get(key, kind.default), block.get("position"))
        for key, kind in kinds.items()
    }


def _read_entry(name: str, kind: Field, value: Any, position: Any) -> Tensor:
    if kind.rows:
        return bounded(name, value, matrix(name, value, kind.length))
    if kind.each and isinstance(value, list | tuple):
        return bounded(name, value, each_thruster(name, value, position))
    if name == "linear_drag":
        return bounded(name, value, drag_matrix(value))
    return bounded(name, value, numbers(name, value, (kind.length,) if kind.length else ()))


def _is(names: list[str]) -> str:
    return "is" if len(names) == 1 else "are"
