"""What the equations of motion read at every step, worked out once per vehicle."""

from collections import namedtuple
from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple

from array_api_compat import array_namespace

from auv_torchrl.array_api import diagonal_matrix, host, joined, like, vector
from auv_torchrl.physics.kinematics import cross
from auv_torchrl.vehicle import Vehicle
from auv_torchrl.vehicle.fields import GRAVITY, VEHICLE_FIELDS, WATER_DENSITY

Array = Any


_WORKED_OUT = {  # of several parameters of a vehicle; shapes behind the batch
    "mass_inverse": "(6, 6) with zero rows and columns where a degree of freedom is held",
    "mass_matrix": "(6, 6) rigid body, added mass and payload, for the Coriolis terms",
    "restoring": "(6, 3) wrench per unit of earth z in the body frame: weight, buoyancy and their arms",
    "allocation": "(6, n) wrench per newton of thrust, gain included; nothing of fins and servos",
    "direction": "(n, 3) unit vector of the force of a thruster, of the lift of a fin; axis of a servo",
    "fin_chord": "(n, 3) unit vector ahead across that",
    "hull_height": "() that of a cube where the vehicle has none",
}
_COPIED = tuple(name for name, kind in VEHICLE_FIELDS.items() if kind.copied)
# Values at which a thruster follows its command in proportion, but for limit and dead band.
_LINEAR = {"exponent": 1.0, "asymmetry": 0.0, "forward_gain": 1.0, "reverse_gain": 1.0, "neutral_offset": 0.0}
_TRUE = {name: kind.true for name, kind in VEHICLE_FIELDS.items() if kind.true is not None}


class Coefficients(namedtuple("Coefficients", (*_WORKED_OUT, *_COPIED))):
    """Arrays ``(batch, ...)``, all numpy or all torch.

    ``mass_inverse``, ``mass_matrix``, ``restoring``, ``allocation``, ``direction``, ``fin_chord`` and ``hull_height``
    are worked out by :func:`prepare`. The others are parameters of
    :data:`auv_torchrl.vehicle.fields.VEHICLE_FIELDS` as they are, but for ``servo_rate``, which is that of servos
    alone; the wrench has the ``gain`` from the allocation, and reports of the thrust read it.
    """

    __slots__ = ()

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Array: ...

    def numpy(self) -> "Coefficients":
        """The same coefficients as numpy arrays; they share memory where they are on the CPU."""
        return Coefficients._make(map(host, self))

    def rows(self, index: Any) -> "Coefficients":
        """The coefficients of some vehicles of the batch."""
        return Coefficients._make(map(itemgetter(index), self))

    def write_rows(self, index: Any, rows: "Coefficients") -> None:
        """Replace the coefficients of some vehicles in place."""
        for field, new in zip(self, rows, strict=True):
            field[index] = new


class ActiveTerms(NamedTuple):
    """Which optional terms do anything for any vehicle of the batch; the others are skipped."""

    coriolis: bool
    current: bool
    tether: bool
    surface: bool
    routing: bool
    curve: bool
    lag: bool
    battery_sag: bool
    coupled_drag: bool
    uneven_drag: bool
    coupled_mass: bool
    fins: bool
    azimuth: bool
    sensing: bool
    sensor_noise: bool

    @staticmethod
    def of(c: Coefficients) -> "ActiveTerms":
        """Look at the values once, so that the inner loop need not."""
        xp, kind = array_namespace(c.routing), like(c.routing)
        off_diagonal, identity = 1.0 - xp.eye(6, **kind), xp.eye(c.routing.shape[-1], **kind)
        noisy = bool((c.position_noise > 0).any() or (c.attitude_noise > 0).any())
        return ActiveTerms(
            coriolis=bool((c.coriolis != 0).any()),
            current=bool((c.current != 0).any()),
            tether=bool((c.tether_stiffness != 0).any()),
            surface=bool((c.air != 0).any()),
            routing=bool((c.routing != identity).any()),
            curve=any(bool((getattr(c, name) != plain).any()) for name, plain in _LINEAR.items()),
            lag=bool((c.lag > 0).any()),
            battery_sag=bool((c.battery_sag != 0).any()),
            coupled_drag=bool((c.linear_drag * off_diagonal != 0).any()),
            uneven_drag=bool((c.drag_asymmetry != 0).any()),
            coupled_mass=bool((c.mass_inverse * off_diagonal != 0).any()),
            fins=bool((c.fin_area > 0).any()),
            azimuth=bool((c.turns > 0).any()),
            sensing=noisy or not _sensors_are_true(c),
            sensor_noise=noisy,
        )

    @property
    def servos(self) -> bool:
        """Whether any actuator is turned by its command: a fin, or a servo that turns a thruster."""
        return self.fins or self.azimuth

    def __or__(self, other: "ActiveTerms") -> "ActiveTerms":
        """The terms that do anything in either batch."""
        return ActiveTerms(*(a or b for a, b in zip(self, other, strict=True)))

    @staticmethod
    def everything() -> "ActiveTerms":
        """All terms, for code that must not look at values (``vmap``, ``compile``, gradients)."""
        return ActiveTerms(*(True for _ in ActiveTerms._fields))


def _sensors_are_true(c: Coefficients) -> bool:
    return not any(bool((getattr(c, name) != true).any()) for name, true in _TRUE.items())


def prepare(vehicle: Vehicle) -> Coefficients:
    """Work out the coefficients of a batch of vehicles; differentiable in every parameter."""
    xp, mass_matrix, free = array_namespace(vehicle.mass), total_mass_matrix(vehicle), vehicle.free
    held = diagonal_matrix(1 - free)
    moving = free[..., :, None] * free[..., None, :]
    mass_inverse = xp.linalg.inv(mass_matrix * moving + held) * moving
    weight = vehicle.mass * GRAVITY
    arm = (
        vehicle.centre_of_mass * weight[..., None]
        - vehicle.centre_of_buoyancy * vehicle.buoyancy[..., None]
        + vehicle.payload_position * vehicle.payload_weight[..., None]
    )
    net_weight = weight - vehicle.buoyancy + vehicle.payload_weight + vehicle.vertical_force
    identity = xp.eye(3, **like(weight))
    thruster = _is_thruster(vehicle)
    worked_out = {
        "mass_inverse": mass_inverse,
        "mass_matrix": mass_matrix,
        "restoring": xp.concat((net_weight[..., None, None] * identity, skew(arm)), axis=-2),
        "allocation": allocation_matrix(vehicle) * (vehicle.gain * thruster)[..., None, :],
        "direction": vehicle.thruster_direction,
        "fin_chord": _chord(vehicle.thruster_direction),
        "hull_height": hull_height(vehicle),
    }
    copied = {name: getattr(vehicle, name) for name in _COPIED}
    copied["servo_rate"] = vehicle.servo_rate * (1 - thruster)  # a file may say one rate for all rows
    return Coefficients(**worked_out, **copied)


def _is_thruster(vehicle: Vehicle) -> Array:
    """1 for each thruster, 0 for each fin and each servo, (..., n)."""
    xp, area = array_namespace(vehicle.fin_area), vehicle.fin_area
    return xp.where((area > 0) | (vehicle.turns > 0), xp.zeros_like(area), xp.ones_like(area))


def _chord(normal: Array) -> Array:
    """Unit vectors ahead (..., 3) across other unit vectors; of those that point ahead themselves, any of length 0."""
    xp = array_namespace(normal)
    along = -normal[..., :1] * normal
    ahead = along[..., :1] + 1.0  # the square of its length, too
    return xp.concat((ahead, along[..., 1:]), axis=-1) / xp.sqrt(xp.abs(ahead) + 1e-30)  # rounded, it may be below 0


def hull_height(vehicle: Vehicle) -> Array:
    """Height in m over which the hull leaves the water; where no file says it, that of a cube of its volume."""
    side = (vehicle.buoyancy / (WATER_DENSITY * GRAVITY)) ** (1 / 3)
    return array_namespace(side).where(vehicle.hull_height > 0, vehicle.hull_height, side)


def skew(a: Array) -> Array:
    """Matrix of the vector product, ``skew(a) @ b = a x b``; (..., 3) to (..., 3, 3)."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    zero = array_namespace(a).zeros_like(x)
    return vector(zero, -z, y, z, zero, -x, -y, x, zero).reshape((*a.shape, 3))


def rigid_body_mass_matrix(mass: Array, inertia: Array, position: Array) -> Array:
    """Mass matrix about the origin of a body whose centre of mass is at ``position`` (Fossen 2021, Eq. 3.49)."""
    s = skew(position)
    m = mass[..., None, None]
    xp = array_namespace(mass)
    upper = joined(m * xp.eye(3, **like(mass)), -m * s)
    lower = joined(m * s, diagonal_matrix(inertia) - m * s @ s)
    return xp.concat((upper, lower), axis=-2)


def total_mass_matrix(vehicle: Vehicle) -> Array:
    """Rigid body, payload and added mass, (..., 6, 6), symmetric positive definite."""
    body = rigid_body_mass_matrix(vehicle.mass, vehicle.inertia, vehicle.centre_of_mass)
    point = 0 * vehicle.payload_position
    payload = rigid_body_mass_matrix(vehicle.payload_mass, point, vehicle.payload_position)
    total = body + payload + diagonal_matrix(vehicle.added_mass)
    root = array_namespace(total).sqrt(vehicle.mass_scale)
    return total * root[..., :, None] * root[..., None, :]


def allocation_matrix(vehicle: Vehicle) -> Array:
    """Wrench per newton of thrust of each thruster, (..., 6, n), without their gains; propellers turn the body, too."""
    direction = vehicle.thruster_direction
    moment = cross(vehicle.thruster_position, direction) + vehicle.reaction[..., None] * direction
    return joined(direction, moment).mT
