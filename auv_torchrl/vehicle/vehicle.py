"""A vehicle as a batch of physical parameters, batch first, on numpy or torch.

Frames: earth NED, body FRD. Degrees of freedom are ordered surge, sway, heave, roll, pitch, yaw
(Fossen 2021). Every effect of :mod:`auv_torchrl.effects` is a change of these parameters, and at the
value that :func:`load_vehicle` gives, every term that only an effect uses does nothing.
"""

import logging
from collections.abc import Callable, ItemsView, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
from reprlib import repr as short
from typing import TYPE_CHECKING, Any

import numpy as np
from array_api_compat import array_namespace

from auv_torchrl.array_api import copied, host
from auv_torchrl.paths import config_path
from auv_torchrl.quantities import counted
from auv_torchrl.settings import choices
from auv_torchrl.vehicle.checks import doubts, impossible
from auv_torchrl.vehicle.entries import read_entry
from auv_torchrl.vehicle.fields import BY_LABEL, CONTROLLED, DEGREES_OF_FREEDOM, FIELD_OF, OLDER, SECTIONS, Field, label
from auv_torchrl.vehicle.fields import VEHICLE_FIELDS as FIELDS
from auv_torchrl.yaml_file import read_yaml

log = logging.getLogger(__name__)

CONTROLLED_INDEX = tuple(DEGREES_OF_FREEDOM.index(name) for name in CONTROLLED)
Array = Any


def index_of(axes: Sequence[str]) -> list[int]:
    """Places of degrees of freedom in a wrench, a velocity or a row of the mixer."""
    return [DEGREES_OF_FREEDOM.index(axis) for axis in axes]


class Actuators:
    """Which of the actuators of a batch of vehicles are what: all stand among the thrusters, one row of each field."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

    @property
    def thrusters(self) -> int:
        """Number of thrusters, fins and servos of azimuth thrusters among them."""
        return self.gain.shape[-1]

    @property
    def fins(self) -> tuple[int, ...]:
        """Which of them are fins, counted from 0; the same throughout a batch."""
        return self._above_zero("fin_area")

    @property
    def azimuths(self) -> tuple[int, ...]:
        """Which of them are servos that turn a thruster, likewise."""
        return self._above_zero("turns")

    @property
    def servos(self) -> tuple[int, ...]:
        """Fins and servos that turn a thruster: their commands are angles."""
        return tuple(sorted((*self.fins, *self.azimuths)))

    def _above_zero(self, name: str) -> tuple[int, ...]:
        each = getattr(self, name)[(0,) * self.batch_dims]
        return tuple(np.flatnonzero(host(each) > 0).tolist()) if bool((each > 0).any()) else ()


@dataclass(frozen=True, eq=False, repr=False)
class Vehicle(Actuators):
    """Physical parameters of a batch of vehicles: arrays of one library, of one precision.

    The fields are those of :data:`auv_torchrl.vehicle.fields.VEHICLE_FIELDS`, which says the shape behind the batch,
    the unit and the meaning of each. Fields are never replaced, :meth:`replace` makes another vehicle; what is in them
    is, by :meth:`write_rows` of a vehicle that :meth:`clone` made.
    """

    if TYPE_CHECKING:

        def __init__(self, **fields: Array) -> None: ...

        def __getattr__(self, name: str) -> Array: ...
    else:
        __annotations__ = dict.fromkeys(FIELDS, Any)

    @property
    def batch_size(self) -> tuple[int, ...]:
        """Shape of the batch; empty for one vehicle."""
        return tuple(self.mass.shape)

    @property
    def batch_dims(self) -> int:
        """Number of axes of the batch."""
        return len(self.mass.shape)

    def __len__(self) -> int:
        return self.batch_size[0]

    def __repr__(self) -> str:
        return f"Vehicle(batch {list(self.batch_size)}, {counted(self.thrusters, 'thruster')}, {self.mass.dtype})"

    def __getitem__(self, index: Any) -> "Vehicle":
        """The vehicles at an index of the batch."""
        if not self.batch_dims:
            raise IndexError("one vehicle is no batch: it has no rows")
        return self.map(lambda field: field[index])

    def get(self, name: str) -> Array:
        """The field of that name."""
        return self.__dict__[name]

    def items(self) -> ItemsView[str, Array]:
        """Every field by name."""
        return self.__dict__.items()

    def map(self, change: Callable[[Array], Array]) -> "Vehicle":
        """The vehicle that a change of every field makes, the other library and the other precision included."""
        return _vehicle({name: change(field) for name, field in self.__dict__.items()})

    def replace(self, **fields: Array) -> "Vehicle":
        """A vehicle with other arrays in some fields, shaped as these; it shares the others."""
        return _vehicle({**self.__dict__, **fields})

    def clone(self) -> "Vehicle":
        """A copy with memory of its own."""
        return self.map(copied)

    def expand(self, *batch: int) -> "Vehicle":
        """The vehicles as a larger batch, in the same memory."""
        xp, axes = array_namespace(self.mass), self.batch_dims
        return self.map(lambda field: xp.broadcast_to(field, (*batch, *field.shape[axes:])))

    def reshape(self, *batch: int) -> "Vehicle":
        """The same vehicles in another shape of batch; one entry may be -1."""
        axes = self.batch_dims
        if -1 in batch:
            rest = prod(size for size in batch if size != -1)
            batch = tuple(prod(self.batch_size) // rest if size == -1 else size for size in batch)
        return self.map(lambda field: field.reshape((*batch, *field.shape[axes:])))

    def write_rows(self, index: Any, rows: "Vehicle") -> None:
        """Replace some vehicles of the batch in place."""
        for name, field in self.__dict__.items():
            field[index] = rows.get(name)


def _vehicle(fields: dict[str, Array]) -> Vehicle:
    """A vehicle of these fields, in a tenth of the time that ``Vehicle(**fields)`` takes: effects make thousands."""
    made = object.__new__(Vehicle)
    made.__dict__.update(fields)
    return made


def stacked(vehicles: Sequence[Vehicle]) -> Vehicle:
    """Vehicles of one shape as a batch, along a new first axis."""
    xp = array_namespace(vehicles[0].mass)
    return _vehicle({name: xp.stack([vehicle.get(name) for vehicle in vehicles]) for name in FIELDS})


_BESIDES = {"name", "uncertainty", "calibration"}  # what the diagnosis and the training read besides


def read_vehicle_file(vehicle: str | Path | Mapping[str, Any]) -> Mapping[str, Any]:
    """The sections of a vehicle from a name in ``conf/vehicle`` or a YAML file; a mapping is what it is.

    Raises:
        FileNotFoundError: for an unknown name, or a file that does not exist.
        ValueError: for a file that :func:`auv_torchrl.yaml_file.read_yaml` refuses.
    """
    return vehicle if isinstance(vehicle, Mapping) else read_yaml(_file(vehicle), "vehicle")


def _file(vehicle: str | Path) -> Path:
    return Path(vehicle) if str(vehicle).endswith((".yaml", ".yml")) else config_path("vehicle", str(vehicle))


def load_vehicle(vehicle: str | Path | Mapping[str, Any]) -> Vehicle:
    """One nominal vehicle from a name in ``conf/vehicle``, a YAML file or a mapping: no batch, numpy, float64.

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
    return loaded.clone()


def vehicle_doubts(vehicle: Vehicle) -> tuple[str, ...]:
    """What is implausible about a nominal vehicle (empty batch), a sentence each with the unit that it looks like."""
    return doubts(_by_label(vehicle))


def _by_label(vehicle: Vehicle) -> dict[str, np.ndarray]:
    """The numbers of a vehicle by the labels of the entries of its file, thrusters one by one."""
    return {entry: host(vehicle.get(name)) for entry, name in FIELD_OF.items()}


def _with_present_names(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """The sections of a file with those entries under their present names that older files have elsewhere."""
    for older, entry in OLDER.items():
        (was, key), (section, name) = older.split("."), entry.split(".")
        if not isinstance(content.get(was), Mapping) or key not in content[was]:
            continue
        block = content.get(section, {})
        if not isinstance(block, Mapping) or name in block:
            raise ValueError(f"{entry} is given as {older}, too: give it in section {section} alone")
        rest = {other: value for other, value in content[was].items() if other != key}
        content = {**content, was: rest, section: {**block, name: content[was][key]}}
    return content


def _nominal(content: Mapping[str, Any]) -> Vehicle:
    content = _with_present_names(content)
    known = {*SECTIONS, *SECTIONS[""], *_BESIDES} - {""}
    if odd := sorted(map(str, set(content) - known)):
        raise ValueError(f"unknown entries {odd}: {choices(odd, sorted(known))}")
    if not isinstance(content.get("name", ""), str):
        raise ValueError(f"name is {short(content['name'])}: give a word, in quotes if need be")
    given: dict[str, np.ndarray] = {}
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
    if ((length := np.linalg.norm(direction, axis=-1, keepdims=True)) < 1e-9).any():
        raise ValueError("a row of thrusters.direction is zero: give the direction of its force")
    given["thruster_direction"] = direction / length
    fields = {
        name: np.broadcast_to(given[name], kind.shape_of(n)) if name in given else without_entry(kind, n)
        for name, kind in FIELDS.items()
    }
    vehicle = Vehicle(**fields)
    if wrong := impossible(_by_label(vehicle)):
        raise ValueError(wrong)
    return vehicle


def without_entry(kind: Field, thrusters: int) -> np.ndarray:
    """The nominal value of a parameter of which vehicle files have no entry."""
    shape = kind.shape_of(thrusters)
    default = np.array(kind.default, np.float64)
    return default * np.eye(shape[0]) if kind.square else np.full(shape, default)


def _read_section(section: str, content: Mapping[str, Any]) -> dict[str, np.ndarray]:
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
    thrusters = content.get("thrusters")
    position = thrusters.get("position") if isinstance(thrusters, Mapping) else None
    return {
        names[key]: read_entry(name, block.get(key, BY_LABEL[name].left_out), position) for key, name in entries.items()
    }
