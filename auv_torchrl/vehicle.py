"""A vehicle as a tensorclass of physical parameters, batch first.

Frames: earth NED, body FRD. Degrees of freedom are ordered surge, sway, heave, roll, pitch, yaw
(Fossen 2021). Every effect of :mod:`auv_torchrl.effects` is a change of these parameters, and at the
value that :func:`load_vehicle` gives, every term that only an effect uses does nothing.
"""

import logging
from collections.abc import Mapping
from pathlib import Path
from reprlib import repr as short
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from tensordict import TensorClass
from torch import Tensor

from auv_torchrl.paths import config_path
from auv_torchrl.quantities import counted
from auv_torchrl.settings import choices
from auv_torchrl.vehicle_checks import doubts, impossible
from auv_torchrl.vehicle_entries import read_entry
from auv_torchrl.vehicle_fields import BY_LABEL, CONTROLLED, DEGREES_OF_FREEDOM, FIELD_OF, SECTIONS, Field, label
from auv_torchrl.vehicle_fields import VEHICLE_FIELDS as FIELDS
from auv_torchrl.yaml_file import read_yaml

log = logging.getLogger(__name__)

CONTROLLED_INDEX = tuple(DEGREES_OF_FREEDOM.index(name) for name in CONTROLLED)


class Vehicle(TensorClass):
    """Physical parameters of a batch of vehicles.

    The fields are those of :data:`auv_torchrl.vehicle_fields.VEHICLE_FIELDS`, which says the shape behind the batch,
    the unit and the meaning of each.
    """

    if TYPE_CHECKING:

        def __init__(self, **fields: Any) -> None: ...

        def __getattr__(self, name: str) -> Tensor: ...

        def __setattr__(self, name: str, value: Tensor) -> None: ...
    else:
        __annotations__ = dict.fromkeys(FIELDS, Tensor)

    @property
    def thrusters(self) -> int:
        """Number of thrusters."""
        return self.gain.shape[-1]


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
    """The numbers of a vehicle by the labels of the entries of its file, thrusters one by one."""
    return {entry: vehicle.get(name).numpy() for entry, name in FIELD_OF.items()}


def _nominal(content: Mapping[str, Any]) -> Vehicle:
    known = {*SECTIONS, *SECTIONS[""], *_SAID_OF_IT} - {""}
    if odd := sorted(map(str, set(content) - known)):
        raise ValueError(f"unknown entries {odd}: {choices(odd, sorted(known))}")
    if not isinstance(content.get("name", ""), str):
        raise ValueError(f"name is {short(content['name'])}: give a word, in quotes if need be")
    given: dict[str, Tensor] = {}
    for section in SECTIONS:
        given |= _read_section(section, content)
    rows = {name: len(value) for name, value in given.items() if FIELDS[name].rows}
    n = rows["thruster_position"]
    if set(rows.values()) != {n}:
        raise ValueError(
            f"thrusters.position has {counted(n, 'row')}, thrusters.direction {rows['thruster_direction']}, mixer "
            f"{rows['mixer']}: give one row per thruster in each"
        )
    direction = given["thruster_direction"]
    if ((length := direction.norm(dim=-1, keepdim=True)) < 1e-9).any():
        raise ValueError("a row of thrusters.direction is zero: give the direction of its force")
    given["thruster_direction"] = direction / length
    fields = {
        name: given[name].expand(kind.shape_of(n)) if name in given else _without_entry(kind, n)
        for name, kind in FIELDS.items()
    }
    vehicle = Vehicle(**fields, batch_size=[])
    if wrong := impossible(_by_label(vehicle)):
        raise ValueError(wrong)
    return vehicle


def _without_entry(kind: Field, thrusters: int) -> Tensor:
    """The nominal value of a parameter of which vehicle files have no entry."""
    shape = kind.shape_of(thrusters)
    value = torch.tensor(kind.default, dtype=torch.float64)
    return value * torch.eye(shape[0], dtype=torch.float64) if kind.square else value.expand(shape)


def _read_section(section: str, content: Mapping[str, Any]) -> dict[str, Tensor]:
    """The parameters that a section has, checked entry by entry."""
    names = SECTIONS[section]
    block = content.get(section, {}) if section else {key: content[key] for key in names if key in content}
    if not isinstance(block, Mapping):
        raise ValueError(f"{section} is {short(block)}: give a mapping with {', '.join(names)}")
    if odd := sorted(map(str, set(block) - set(names))):
        raise ValueError(f"unknown entries {odd} in {section}: {choices(odd, sorted(names))}")
    entries = {entry: label(section, entry) for entry in names}
    if missing := [name for key, name in entries.items() if BY_LABEL[name].default is ... and key not in block]:
        raise ValueError(f"{', '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing")
    return {
        names[key]: read_entry(name, block.get(key, BY_LABEL[name].left_out), block.get("position"))
        for key, name in entries.items()
    }
