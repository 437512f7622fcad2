"""The instruments that vehicles have. A new one is an entry here, with what it reads of the motion.

One that is declared outside (``sensors/*.py`` in a folder of one's own) takes over the channels that it reports.
"""

from typing import Any

from array_api_compat import array_namespace

from auv_torchrl.physics.coefficients import Coefficients
from auv_torchrl.physics.kinematics import cross
from auv_torchrl.registry import Registry
from auv_torchrl.sensors.sensor import FELT, Sensor, at_once
from auv_torchrl.vehicle.fields import GRAVITY

Array = Any


def _with_pose(c: Coefficients) -> Array:
    return c.pose_delay


def _position(c: Coefficients, motion: Array) -> Array:
    return c.position_scale[..., None] * motion[..., :2]


def _depth(c: Coefficients, motion: Array) -> Array:
    return (c.position_scale * c.depth_scale)[..., None] * motion[..., 2:3] + c.depth_bias[..., None]


def _attitude(c: Coefficients, motion: Array) -> Array:
    return motion[..., 3:5]


def _heading(c: Coefficients, motion: Array) -> Array:
    return motion[..., 5:6] + c.heading_bias[..., None]


def _turned(c: Coefficients, load: Array) -> Array:
    return (c.compass_per_load * load)[..., None]


def _velocity(c: Coefficients, motion: Array) -> Array:
    velocity = motion[..., 6:9]
    if (c.dvl_position != 0).any() or (c.dvl_turn != 0).any():
        velocity = _mounted(c, velocity, motion[..., 9:12])
    return c.velocity_scale[..., None] * velocity


def _mounted(c: Coefficients, velocity: Array, turning: Array) -> Array:
    """Velocities (..., 3) of the place of a Doppler log along its own axes, of those of the origin of the body."""
    xp = array_namespace(velocity)
    local = velocity + cross(*xp.broadcast_arrays(turning, c.dvl_position))  # Fossen 2021, section 2.4
    cos, sin, (u, v, w) = xp.cos(c.dvl_turn), xp.sin(c.dvl_turn), xp.moveaxis(local, -1, 0)
    return xp.stack((cos * u + sin * v, cos * v - sin * u, w), axis=-1)


def _rates(c: Coefficients, motion: Array) -> Array:
    return motion[..., 9:12] + c.gyro_bias


def _specific_force(c: Coefficients, motion: Array) -> Array:
    """Of a motion that goes on as it is: weight, and what turning makes of the velocity and of the lever arm."""
    xp = array_namespace(motion)
    roll, pitch, velocity, turning = motion[..., 3], motion[..., 4], motion[..., 6:9], motion[..., 9:12]
    if _is_off_origin(c):
        velocity = velocity + cross(turning, c.accelerometer_position)
    u, v, w, p, q, r = (there[..., i] for there in (velocity, turning) for i in range(3))
    level = GRAVITY * xp.cos(pitch)
    x = q * w - r * v + GRAVITY * xp.sin(pitch)  # turning x velocity, less gravity: by number, which is faster
    y = r * u - p * w - level * xp.sin(roll)
    z = p * v - q * u - level * xp.cos(roll)
    return xp.stack((x, y, z), axis=-1) + c.accelerometer_bias


def _accelerating(c: Coefficients, rate: Array) -> Array:
    return rate[..., 6:9] + cross(rate[..., 9:12], c.accelerometer_position) if _is_off_origin(c) else rate[..., 6:9]


def _is_off_origin(c: Coefficients) -> bool:
    return bool((c.accelerometer_position != 0).any())


INSTRUMENTS = (
    Sensor("position", ("x", "y"), "motion capture, or an acoustic positioning system", _position, _with_pose),
    Sensor("depth", ("z",), "a pressure gauge, or the positioning system", _depth, _with_pose),
    Sensor("attitude", ("roll", "pitch"), "motion capture, or an inertial unit", _attitude, _with_pose),
    Sensor("heading", ("yaw",), "motion capture, or a compass", _heading, _with_pose, _turned),
    Sensor(
        "velocity", ("u", "v", "w"), "a Doppler log that is fixed to the body: no compass turns it", _velocity, at_once
    ),
    Sensor("gyro", ("p", "q", "r"), "angular rates, fixed to the body", _rates, at_once),
    Sensor(
        "accelerometer",
        FELT,
        "specific force where it sits in the body",
        _specific_force,
        at_once,
        moving=_accelerating,
    ),
)
SENSORS = Registry("sensors", Sensor, INSTRUMENTS)


def _by_channel() -> dict[str, Sensor]:
    """The sensor that reports each channel: of several, the one that was declared last."""
    return {channel: sensor for sensor in SENSORS.values() for channel in sensor.channels}


def sensor_of(channel: str) -> Sensor:
    """The sensor that reports a channel: of several, the one that was declared last."""
    return _by_channel()[channel]


def read(c: Coefficients, channels: tuple[str, ...], motion: Array, load: Array | None = None) -> Array:
    """What sensors report (..., C) in ``channels``, of a motion (..., 12), without noise; angles are not wrapped.

    ``load`` (...) is the share of their full thrusts that thrusters give meanwhile; None for none.
    """
    xp = array_namespace(motion)
    known = _by_channel()
    sensors = [known[channel] for channel in channels]
    reports = {sensor.name: sensor.read(c, motion) for sensor in set(sensors)}
    if load is not None:
        for sensor in set(sensors):
            if sensor.loaded is not None:
                reports[sensor.name] = reports[sensor.name] + sensor.loaded(c, load)
    columns = [
        reports[sensor.name][..., sensor.channels.index(channel)]
        for channel, sensor in zip(channels, sensors, strict=True)
    ]
    return xp.stack(tuple(xp.broadcast_arrays(*columns)), axis=-1)


def ages(c: Coefficients, channels: tuple[str, ...]) -> Array:
    """How old (..., C) in s the reports of each channel are."""
    xp = array_namespace(c.position_scale)
    known = _by_channel()
    return xp.stack(tuple(known[channel].age(c) for channel in channels), axis=-1)
