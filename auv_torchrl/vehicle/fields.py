"""Every parameter of a vehicle in one table: its shape, unit and meaning, and its entry in vehicle files.

The class of vehicles, the reader, the writer and the checks of vehicle files, the coefficients of the equations of
motion and the command line all read :data:`VEHICLE_FIELDS`: a new parameter is one entry there. The table loads neither
torch nor numpy, because the command line asks it which entries may be left out.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import EllipsisType

from auv_torchrl.settings import In

DEGREES_OF_FREEDOM = ("surge", "sway", "heave", "roll", "pitch", "yaw")
CONTROLLED = ("surge", "sway", "heave", "yaw")  # the four channels of an action
GRAVITY = 9.81  # m/s^2, standard gravity to the precision of the published weights
WATER_DENSITY = 1000.0  # kg/m^3, fresh; salt changes the side of a cube by 1 %
POUND = 0.45359237  # kg, by definition
INCH = 0.0254  # m, by definition
DEGREE = 0.017453292519943295  # rad

Factor = float | tuple[float, ...]  # by which a number in a mistaken unit becomes SI; one per entry of a vector
_ANY, _POSITIVE, _NOT_NEGATIVE = In("(-inf, inf)"), In("(0, inf)"), In("[0, inf)")
_SHARE, _WAIT = In("(-1, 1)"), In("[0, 60]", "s")  # beyond a minute nothing that answers is a thruster or a sensor
_SCALE = In("[0.2, 5]")
_LENGTH = {"mm": 1e-3, "cm": 1e-2}
_UP = {"m with z pointing up": (1.0, 1.0, -1.0)}  # the body frame is front, right, down
_TIME = {"ms": 1e-3}
_FORCE = {"kgf": GRAVITY, "gf": GRAVITY / 1e3, "kN": 1e3}
_PERCENT = {"%": 1e-2}
_ANGLE = {"degrees": DEGREE}

N = "n"  # in a shape: the number of thrusters
_NUMBER, _VECTOR, _SIX, _EACH = (), (3,), (6,), (N,)


@dataclass(frozen=True)
class Field:
    """One parameter of a vehicle, and its entry in vehicle files where it has one."""

    shape: tuple[int | str, ...]  # behind the batch
    unit: str
    meaning: str
    section: str | None = None  # of vehicle files, "" for an entry outside of sections; None: files have no entry
    entry: str = ""  # name in the section, where it is another than that of the field
    older: str = ""  # label under which older files have the entry
    default: float | EllipsisType = ...  # of a nominal vehicle without an entry, in every place, or on the diagonal of
    # a square matrix; ... where the file must have the entry
    given: In = _ANY  # what is possible
    usual: In = _ANY  # what is plausible for a vehicle of any size; ``checks`` has what depends on the size
    mistaken: Mapping[str, Factor] = field(default_factory=dict)  # units, and their factors to SI
    note: str = ""  # behind the unit, where a file is written
    brief: bool = False  # a written file leaves the entry out where it is 0
    later: bool = False  # hashes under which results are kept leave out the default, so that older ones are found
    copied: bool = True  # into the coefficients of the equations of motion and sensors; else worked into others
    true: float | None = None  # of a sensor: the value at which it reports the motion as it is

    def shape_of(self, thrusters: int) -> tuple[int, ...]:
        """Behind the batch, for a number of thrusters."""
        return tuple(size if isinstance(size, int) else thrusters for size in self.shape)

    @property
    def length(self) -> int:
        """Of a vector, or of each row; 0 for a number, or one number per thruster."""
        last = self.shape[-1] if self.shape else 0
        return last if isinstance(last, int) else 0

    @property
    def each(self) -> bool:
        """Whether a file has one number for all thrusters, or a list with one each."""
        return self.shape == _EACH

    @property
    def rows(self) -> bool:
        """Whether a file has one vector for each thruster."""
        return len(self.shape) == 2 and self.shape[0] == N

    @property
    def square(self) -> bool:
        """Whether a file has a vector, the diagonal, or all rows of a matrix."""
        return len(self.shape) == 2 and self.shape[0] == self.shape[1]

    @property
    def left_out(self) -> float | tuple[float, ...] | None:
        """What an entry that is left out of a file stands for; None where it must be there."""
        if isinstance(self.default, EllipsisType):
            return None
        return (self.default,) * self.length if self.length else self.default


VEHICLE_FIELDS: dict[str, Field] = {  # in the order of the class, which hashes of kept results have, too
    # rigid body
    "mass": Field(
        _NUMBER, "kg", "mass", "rigid_body", given=_POSITIVE, usual=In("[0.1, 1e5]", "kg"),
        mistaken={"g": 1e-3, "lb": POUND, "N": 1 / GRAVITY, "t": 1e3}, copied=False,
    ),
    "inertia": Field(
        _VECTOR, "kg m^2", "principal moments about the centre of mass", "rigid_body", given=_POSITIVE,
        mistaken={"kg cm^2": 1e-4, "kg mm^2": 1e-6, "g cm^2": 1e-7, "lb in^2": POUND * INCH**2}, copied=False,
    ),
    "centre_of_mass": Field(
        _VECTOR, "m", "place of the centre of mass", "rigid_body", mistaken=_LENGTH | _UP, copied=False
    ),
    "centre_of_buoyancy": Field(_VECTOR, "m", "place of the centre of buoyancy", "rigid_body", mistaken=_LENGTH | _UP),
    "buoyancy": Field(
        _NUMBER, "N", "buoyancy, all of it in the water", "rigid_body", given=_POSITIVE,
        mistaken={"kg": GRAVITY, "lb": POUND * GRAVITY, "g": GRAVITY / 1e3, "kN": 1e3},
    ),
    "hull_height": Field(
        _NUMBER, "m", "height over which it leaves the water, about that centre; 0 that of a cube of its volume",
        "rigid_body", default=0.0, given=_NOT_NEGATIVE, mistaken=_LENGTH, note=", over which it leaves the water",
        brief=True, later=True, copied=False,
    ),
    "free": Field(_SIX, "", "1 where a degree of freedom moves, 0 where it is held", default=1.0, copied=False),
    "payload_mass": Field(_NUMBER, "kg", "mass that is carried rigidly", default=0.0, copied=False),
    "payload_weight": Field(_NUMBER, "N", "its weight in water, down positive", default=0.0, copied=False),
    "payload_position": Field(_VECTOR, "m", "its place", default=0.0, copied=False),
    "vertical_force": Field(_NUMBER, "N", "force along earth z, down positive", default=0.0, copied=False),
    # water
    "added_mass": Field(
        _SIX, "kg, kg m^2", "added mass, positive", "", given=_NOT_NEGATIVE,
        mistaken={"g, g m^2": 1e-3, "kg, kg cm^2": (1.0,) * 3 + (1e-4,) * 3}, copied=False,
    ),
    "mass_scale": Field(
        _SIX, "", "on the total of rigid body and added mass", "", default=1.0, given=_POSITIVE,
        usual=In("[0.1, 10]"), mistaken=_PERCENT, note="on the total of rigid body and added mass", copied=False,
    ),
    "linear_drag": Field(
        (6, 6), "kg/s, kg m^2/s", "linear drag", "", given=_NOT_NEGATIVE, mistaken={"g/s, g m^2/s": 1e-3},
        note="; rows of 6: drag in each degree of freedom by speed in all",
    ),
    "quadratic_drag": Field(
        _SIX, "kg/m, kg m^2", "quadratic drag", "", given=_NOT_NEGATIVE, mistaken={"g/m, g m^2": 1e-3}
    ),
    "drag_asymmetry": Field(
        _SIX, "", "quadratic drag is 1 + this times that ahead, to starboard or down, and 1 - this the other way", "",
        default=0.0, given=_SHARE, mistaken=_PERCENT, note="share by which it is larger ahead, to starboard or down",
        brief=True, later=True,
    ),
    "current": Field(_VECTOR, "m/s", "velocity of the water, north, east, down", default=0.0),
    "tether_anchor": Field(_VECTOR, "m", "in earth axes", default=0.0),
    "tether_stiffness": Field(_NUMBER, "N/m", "beyond its slack", default=0.0),
    "tether_slack": Field(_NUMBER, "m", "length up to which it does not pull", default=0.0),
    "surface": Field(
        _NUMBER, "m", "z of the surface of the water", "", default=0.0, usual=In("[-1000, 1000]", "m"),
        mistaken={"mm": 1e-3}, note=", z of the surface of the water", brief=True, later=True,
    ),
    "air": Field(
        _NUMBER, "", "share of the water's density that is missing above it: 0 water everywhere, 1 air", "",
        default=0.0, given=In("[0, 1]"), mistaken=_PERCENT, note="above it: 0 water, 1 air", brief=True, later=True,
    ),
    "coriolis": Field(
        _NUMBER, "", "0 none, 1 the full rigid-body and added-mass Coriolis terms", "", given=_NOT_NEGATIVE,
        usual=In("[0, 2]"), mistaken=_PERCENT, note="0 none, 1 all",
    ),
    # thrusters
    "thruster_position": Field(
        (N, 3), "m", "place", "thrusters", "position", mistaken=_LENGTH | {"in": INCH}
    ),
    "thruster_direction": Field(
        (N, 3), "", "unit vector of the force at a positive command", "thrusters", "direction", given=In("[-10, 10]"),
        copied=False,
    ),
    "mixer": Field(
        (N, 6), "", "commands per unit demand in each degree of freedom", "", usual=In("[-2, 2]"), mistaken=_PERCENT,
        note="columns surge, sway, heave, roll, pitch, yaw; rows thrusters", copied=False,
    ),
    "routing": Field((N, N), "", "which command reaches which thruster", default=1.0),
    "full_thrust": Field(
        _EACH, "N", "thrust at command +1", "thrusters", given=_POSITIVE, mistaken=_FORCE, note=" at command +1"
    ),
    "asymmetry": Field(
        _EACH, "", "reverse thrust is weaker by this share, stronger where it is below 0", "thrusters", given=_SHARE,
        mistaken=_PERCENT, note="reverse thrust is weaker by this share",
    ),
    "exponent": Field(
        _EACH, "", "of the thrust curve", "thrusters", given=_POSITIVE, usual=In("[0.3, 4]"),
        note="thrust = full x sign(c) |c|^exponent",
    ),
    "dead_band": Field(
        _EACH, "N", "thrust below which there is none", "thrusters", given=_NOT_NEGATIVE,
        mistaken={"gf": GRAVITY / 1e3, "mN": 1e-3},
    ),
    "limit": Field(_EACH, "N", "largest thrust", "thrusters", given=_POSITIVE, mistaken=_FORCE),
    "gain": Field(_EACH, "", "on the thrust, after the limit", default=1.0),
    "forward_gain": Field(_EACH, "", "likewise, of thrust forwards alone", default=1.0, later=True),
    "reverse_gain": Field(_EACH, "", "likewise, of thrust backwards alone", default=1.0, later=True),
    "neutral_offset": Field(_EACH, "", "command at which a thruster gives nothing", default=0.0, later=True),
    "lag": Field(
        _EACH, "s", "time constant of first order", "thrusters", given=_WAIT, usual=In("[0, 2]", "s"), mistaken=_TIME
    ),
    "reaction": Field(
        _EACH, "m", "moment about its direction per newton of its thrust: the propeller turns the other way",
        "thrusters", default=0.0, mistaken=_LENGTH, note=", moment about its direction per newton of thrust",
        brief=True,
    ),
    "volts": Field(
        _NUMBER, "V", "at which full_thrust holds and from which thrust follows logged volts; 0 where it does not",
        "thrusters", default=0.0, given=_NOT_NEGATIVE, usual=In("[0, 1000]", "V"), mistaken={"mV": 1e-3},
        note=" at which full_thrust holds", brief=True,
    ),
    "delay": Field(
        _NUMBER, "s", "from command to thruster", "thrusters", given=_WAIT, usual=In("[0, 2]", "s"), mistaken=_TIME
    ),
    "battery_sag": Field(_NUMBER, "1/min", "share of the thrust lost per minute", default=0.0),
    # fins: actuators with an area, whose full_thrust, limit and dead_band are deflections in rad
    "fin_area": Field(
        _EACH, "m^2", "area of a fin; 0 of a thruster", "fins", "area", default=0.0, given=_NOT_NEGATIVE,
        usual=In("[0, 10]", "m^2"), note="; 0 of a thruster", brief=True, later=True,
    ),
    "fin_lift": Field(
        _EACH, "1/rad", "slope of its lift coefficient", "fins", "lift", default=2.5, given=_NOT_NEGATIVE,
        usual=In("[0.2, 7]"), note=", slope of the lift coefficient", brief=True, later=True,
    ),
    "fin_aspect": Field(
        _EACH, "", "effective aspect ratio", "fins", "aspect", default=2.0, given=_POSITIVE, usual=In("[0.1, 20]"),
        note="effective aspect ratio", brief=True, later=True,
    ),
    "fin_drag": Field(
        _EACH, "", "drag coefficient without lift", "fins", "drag", default=0.01, given=_NOT_NEGATIVE,
        usual=In("[0, 1]"), note="drag coefficient without lift", brief=True, later=True,
    ),
    "fin_stall": Field(
        _EACH, "rad", "angle of attack at which half of the attached flow is left", "fins", "stall", default=0.4,
        given=In("(0, 1.5]"), usual=In("[0.1, 1.2]", "rad"), mistaken=_ANGLE, note=", half of the flow is off there",
        brief=True, later=True,
    ),
    # servos: of fins, and of azimuth thrusters, which another actuator turns; their angles are deflections in rad, too
    "turns": Field(
        _EACH, "", "number of the thruster that a servo turns; 0 of none", "servos", default=0.0, given=_NOT_NEGATIVE,
        note="number of the thruster that it turns; 0 of none", brief=True, later=True,
    ),
    "servo_rate": Field(
        _EACH, "rad/s", "fastest turning; 0 of any speed", "servos", "rate", older="fins.rate", default=0.0,
        given=_NOT_NEGATIVE, usual=In("[0, 50]", "rad/s"), note="; 0 without a limit", brief=True, later=True,
    ),
    "servo_offset": Field(
        _EACH, "rad", "angle at no command", "servos", "offset", older="fins.offset", default=0.0,
        given=In("[-3.2, 3.2]"), usual=In("[-0.5, 0.5]", "rad"), mistaken=_ANGLE, note=", angle at no command",
        brief=True, later=True,
    ),
    # sensors: what a vehicle's own sensors are off by, where that is known; those of a nominal vehicle are true
    "heading_bias": Field(
        _NUMBER, "rad", "measured yaw minus true yaw", "sensors", default=0.0, usual=In("[-0.8, 0.8]", "rad"),
        mistaken=_ANGLE, true=0.0,
    ),
    "pose_delay": Field(
        _NUMBER, "s", "age of a reported pose", "sensors", default=0.0, given=_WAIT, usual=In("[0, 2]", "s"),
        mistaken=_TIME, true=0.0,
    ),
    "position_scale": Field(
        _NUMBER, "", "reported positions are the true ones times this", "sensors", default=1.0, given=_POSITIVE,
        usual=_SCALE, mistaken=_PERCENT, true=1.0,
    ),
    "depth_scale": Field(
        _NUMBER, "", "and depths times this, too", "sensors", default=1.0, given=_POSITIVE, usual=_SCALE,
        mistaken=_PERCENT, true=1.0,
    ),
    "depth_bias": Field(
        _NUMBER, "m", "reported depth minus true depth", "sensors", default=0.0, usual=In("[-20, 20]", "m"),
        mistaken={"mm": 1e-3}, true=0.0,
    ),
    "velocity_scale": Field(
        _NUMBER, "", "reported linear velocities are the true ones times this", "sensors", default=1.0,
        given=_POSITIVE, usual=_SCALE, mistaken=_PERCENT, true=1.0,
    ),
    "dvl_position": Field(
        _VECTOR, "m", "place of the Doppler log", "sensors", default=0.0, mistaken=_LENGTH, brief=True, later=True,
        true=0.0,
    ),
    "dvl_turn": Field(
        _NUMBER, "rad", "about body z, from the axes of the body to those of the Doppler log", "sensors", default=0.0,
        usual=In("[-3.2, 3.2]", "rad"), mistaken=_ANGLE,
        note=" about body z, from the axes of the body to those of the Doppler log", brief=True, later=True, true=0.0,
    ),
    "gyro_bias": Field(_VECTOR, "rad/s", "reported angular rates minus true ones", default=0.0, true=0.0),
    "accelerometer_bias": Field(
        _VECTOR, "m/s^2", "reported specific force minus the true one", "sensors", default=0.0,
        usual=In("[-2, 2]", "m/s^2"), mistaken={"mg": GRAVITY / 1e3}, brief=True, later=True,
    ),
    "accelerometer_position": Field(
        _VECTOR, "m", "place of the accelerometer", "sensors", default=0.0, mistaken=_LENGTH, brief=True, later=True
    ),
    "compass_per_load": Field(
        _NUMBER, "rad", "turn of the measured yaw while all thrusters give their full thrust", default=0.0, true=0.0
    ),
    "position_noise": Field(_NUMBER, "m", "standard deviation per axis", default=0.0),
    "attitude_noise": Field(_NUMBER, "rad", "standard deviation per axis", default=0.0),
}  # fmt: skip


def label(section: str, entry: str) -> str:
    """What messages call an entry: ``rigid_body.mass``."""
    return f"{section}.{entry}" if section else entry


SECTIONS: dict[str, dict[str, str]] = {}  # section -> entry -> field; "" holds what stands in no section
for _name, _field in VEHICLE_FIELDS.items():
    if _field.section is not None:
        SECTIONS.setdefault(_field.section, {})[_field.entry or _name] = _name
FIELD_OF = {label(section, entry): name for section, names in SECTIONS.items() for entry, name in names.items()}
BY_LABEL = {entry: VEHICLE_FIELDS[name] for entry, name in FIELD_OF.items()}
OLDER = {kind.older: entry for entry, kind in BY_LABEL.items() if kind.older}
COMMENTS = {name.rpartition(".")[2]: kind.unit + kind.note for name, kind in BY_LABEL.items() if kind.unit + kind.note}


def may_be_left_out(key: str) -> bool:
    """Whether it is the key of such an entry on a command line: ``vehicle.thrusters.volts``."""
    root, _, name = key.partition(".")
    kind = BY_LABEL.get(OLDER.get(name, name))
    return root == "vehicle" and kind is not None and kind.default is not ...
