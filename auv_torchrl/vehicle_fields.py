"""Every number of a vehicle file: its unit, what it may be, what is usual, and the units that people mistake it in.

The reader of vehicle files, its checks, the writer of vehicle files and the command line all read this table. It loads
neither torch nor numpy, because the command line asks it what may be left out.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from auv_torchrl.settings import In

DEGREES_OF_FREEDOM = ("surge", "sway", "heave", "roll", "pitch", "yaw")
CONTROLLED = ("surge", "sway", "heave", "yaw")  # the four channels of an action
GRAVITY = 9.81  # m/s^2, standard gravity to the precision of the published weights
WATER_DENSITY = 1000.0  # kg/m^3, fresh; salt changes the side of a cube by 1 %
POUND = 0.45359237  # kg, by definition
INCH = 0.0254  # m, by definition

Factor = float | tuple[float, ...]  # by which a number in a mistaken unit becomes SI; one per entry of a vector
_ANY, _POSITIVE, _NOT_NEGATIVE = In("(-inf, inf)"), In("(0, inf)"), In("[0, inf)")
_SHARE, _WAIT = In("(-1, 1)"), In("[0, 60]", "s")  # beyond a minute nothing that answers is a thruster or a sensor
_LENGTH = {"mm": 1e-3, "cm": 1e-2}
_UP = {"m with z pointing up": (1.0, 1.0, -1.0)}  # the body frame is front, right, down
_TIME = {"ms": 1e-3}
_FORCE = {"kgf": GRAVITY, "gf": GRAVITY / 1e3, "kN": 1e3}
_PERCENT = {"%": 1e-2}


@dataclass(frozen=True)
class Field:
    """One entry of a vehicle file."""

    unit: str
    length: int = 0  # of a vector; 0 for a number
    given: In = _ANY  # what is possible
    usual: In = _ANY  # what is plausible for a vehicle of any size; :mod:`vehicle_checks` has what depends on the size
    mistaken: Mapping[str, Factor] = field(default_factory=dict)  # units, and their factors to SI
    default: Any = ...  # what leaving the entry out means; ... where it must be there
    each: bool = False  # one number for all thrusters, or a list with one each
    rows: bool = False  # one vector for each thruster
    note: str = ""  # behind the unit, where a file is written


_PLACE = Field("m", 3, mistaken=_LENGTH, default=(0.0,) * 3)
FIELDS: dict[str, dict[str, Field]] = {  # section -> entry; "" holds what stands in no section
    "rigid_body": {
        "mass": Field(
            "kg", given=_POSITIVE, usual=In("[0.1, 1e5]", "kg"),
            mistaken={"g": 1e-3, "lb": POUND, "N": 1 / GRAVITY, "t": 1e3},
        ),
        "inertia": Field(
            "kg m^2", 3, given=_POSITIVE,
            mistaken={"kg cm^2": 1e-4, "kg mm^2": 1e-6, "g cm^2": 1e-7, "lb in^2": POUND * INCH**2},
        ),
        "centre_of_mass": Field("m", 3, mistaken=_LENGTH | _UP),
        "centre_of_buoyancy": Field("m", 3, mistaken=_LENGTH | _UP),
        "buoyancy": Field(
            "N", given=_POSITIVE, mistaken={"kg": GRAVITY, "lb": POUND * GRAVITY, "g": GRAVITY / 1e3, "kN": 1e3}
        ),
        "hull_height": Field(
            "m", given=_NOT_NEGATIVE, mistaken=_LENGTH, default=0.0, note=", over which it leaves the water"
        ),
    },
    "": {
        "added_mass": Field(
            "kg, kg m^2", 6, given=_NOT_NEGATIVE,
            mistaken={"g, g m^2": 1e-3, "kg, kg cm^2": (1.0,) * 3 + (1e-4,) * 3},
        ),
        "mass_scale": Field(
            "", 6, given=_POSITIVE, usual=In("[0.1, 10]"), mistaken=_PERCENT, default=(1.0,) * 6,
            note="on the total of rigid body and added mass",
        ),
        "linear_drag": Field(
            "kg/s, kg m^2/s", 6, given=_NOT_NEGATIVE, mistaken={"g/s, g m^2/s": 1e-3},
            note="; rows of 6: drag in each degree of freedom by speed in all",
        ),
        "quadratic_drag": Field("kg/m, kg m^2", 6, mistaken={"g/m, g m^2": 1e-3}, given=_NOT_NEGATIVE),
        "drag_asymmetry": Field(
            "", 6, given=_SHARE, mistaken=_PERCENT, default=(0.0,) * 6,
            note="share by which it is larger ahead, to starboard or down",
        ),
        "coriolis": Field("", given=_NOT_NEGATIVE, usual=In("[0, 2]"), mistaken=_PERCENT, note="0 none, 1 all"),
        "surface": Field(
            "m", usual=In("[-1000, 1000]", "m"), mistaken={"mm": 1e-3}, default=0.0,
            note=", z of the surface of the water",
        ),
        "air": Field("", given=In("[0, 1]"), mistaken=_PERCENT, default=0.0, note="above it: 0 water, 1 air"),
    },
    "thrusters": {
        "position": Field("m", 3, mistaken=_LENGTH | {"in": INCH}, rows=True),
        "direction": Field("", 3, given=In("[-10, 10]"), rows=True),
        "full_thrust": Field("N", given=_POSITIVE, mistaken=_FORCE, each=True, note=" at command +1"),
        "asymmetry": Field(
            "", given=_SHARE, mistaken=_PERCENT, each=True, note="reverse thrust is weaker by this share"
        ),
        "exponent": Field(
            "", given=_POSITIVE, usual=In("[0.3, 4]"), each=True, note="thrust = full x sign(c) |c|^exponent"
        ),
        "dead_band": Field("N", given=_NOT_NEGATIVE, mistaken={"gf": GRAVITY / 1e3, "mN": 1e-3}, each=True),
        "limit": Field("N", given=_POSITIVE, mistaken=_FORCE, each=True),
        "lag": Field("s", given=_WAIT, usual=In("[0, 2]", "s"), mistaken=_TIME, each=True),
        "delay": Field("s", given=_WAIT, usual=In("[0, 2]", "s"), mistaken=_TIME),
        "reaction": Field(
            "m", mistaken=_LENGTH, each=True, default=0.0, note=", moment about its direction per newton of thrust"
        ),
        "volts": Field(
            "V", given=_NOT_NEGATIVE, usual=In("[0, 1000]", "V"), mistaken={"mV": 1e-3}, default=0.0,
            note=" at which full_thrust holds",
        ),
    },
    "sensors": {  # what a vehicle's own sensors are off by, where that is known; those of a nominal one are true
        "heading_bias": Field(
            "rad", usual=In("[-0.8, 0.8]", "rad"), mistaken={"degrees": 0.017453292519943295}, default=0.0
        ),
        "pose_delay": Field("s", given=_WAIT, usual=In("[0, 2]", "s"), mistaken=_TIME, default=0.0),
        "position_scale": Field("", given=_POSITIVE, usual=In("[0.2, 5]"), mistaken=_PERCENT, default=1.0),
        "depth_scale": Field("", given=_POSITIVE, usual=In("[0.2, 5]"), mistaken=_PERCENT, default=1.0),
        "depth_bias": Field("m", usual=In("[-20, 20]", "m"), mistaken={"mm": 1e-3}, default=0.0),
        "velocity_scale": Field("", given=_POSITIVE, usual=In("[0.2, 5]"), mistaken=_PERCENT, default=1.0),
        "dvl_position": _PLACE,
        "dvl_turn": Field(
            "rad", usual=In("[-3.2, 3.2]", "rad"), mistaken={"degrees": 0.017453292519943295}, default=0.0,
            note=" about body z, from the axes of the body to those of the Doppler log",
        ),
        "accelerometer_position": _PLACE,
        "accelerometer_bias": Field(
            "m/s^2", 3, usual=In("[-2, 2]", "m/s^2"), mistaken={"mg": GRAVITY / 1e3}, default=(0.0,) * 3
        ),
    },
}  # fmt: skip
MIXER = Field(
    "", 6, usual=In("[-2, 2]"), mistaken=_PERCENT, rows=True,
    note="columns surge, sway, heave, roll, pitch, yaw; rows thrusters",
)  # fmt: skip


def label(section: str, entry: str) -> str:
    """What messages call an entry: ``rigid_body.mass``."""
    return f"{section}.{entry}" if section else entry


BY_LABEL = {
    **{label(section, entry): kind for section, entries in FIELDS.items() for entry, kind in entries.items()},
    "mixer": MIXER,
}
COMMENTS = {name.rpartition(".")[2]: kind.unit + kind.note for name, kind in BY_LABEL.items() if kind.unit + kind.note}


def may_be_left_out(key: str) -> bool:
    """Whether it is the key of such an entry on a command line: ``vehicle.thrusters.volts``."""
    root, _, name = key.partition(".")
    return root == "vehicle" and name in BY_LABEL and BY_LABEL[name].default is not ...
