"""What vehicles measure: sets of sensors, and the noise and rate of each of their channels.

Rates and noise of the autopilot and of the Doppler log are those of a log of a real BlueROV2 Heavy that ArduSub wrote
(clydemcqueen/guided_above_terrain, 3276cc2), from third differences, which leave fast noise alone. What is slow or
smoothed there looks quieter than it is; where that matters, the comment says what is taken instead.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from auv_torchrl.effects import get_effect
from auv_torchrl.sensors import CHANNELS, FELT, MOTION
from auv_torchrl.vehicle import Vehicle
from benchmarks.blind.flights.sizes import CLEAR, Rng


class Channel(NamedTuple):
    """How a channel is measured."""

    noise: float  # standard deviation of white noise; m, rad, m/s, rad/s, m/s^2
    every: int = 1  # rows of the log, 20 a second, from one measurement to the next; it is held between


class SensorSet(NamedTuple):
    """A vehicle, and what it measures."""

    vehicle: str
    channels: dict[str, Channel]

    @property
    def noise(self) -> tuple[float, ...]:
        """Of each number of a motion; 0 where it is not measured."""
        return tuple(self.channels[axis].noise if axis in self.channels else 0.0 for axis in MOTION)

    @property
    def axes(self) -> tuple[str, ...]:
        """Channels in the order of a log."""
        return tuple(axis for axis in CHANNELS if axis in self.channels)


# Third differences of the attitude estimate are 0.06 mrad: a filter smooths it. It is off by 0.1 degrees in roll and
# pitch, and its heading by more, since a magnetometer holds it: as white noise, that is harder than it is.
ATTITUDE = {"roll": Channel(0.002, 2), "pitch": Channel(0.002, 2), "yaw": Channel(0.004, 2)}  # 10 Hz: ATT, XKQ
GYRO = dict.fromkeys("pqr", Channel(0.0015))  # 1.0 to 2.2 mrad/s at 25 Hz: IMU less the bias of XKF1, props turning
# 9 to 22 mm/s^2 at 25 Hz: IMU behind its low pass of 20 Hz, props turning. What a calibration leaves is drawn besides.
ACCELEROMETER, LEFT_OFF = dict.fromkeys(FELT, Channel(0.02)), 0.05  # m/s^2; half width
DEPTH = {"z": Channel(0.004, 2)}  # 4.1 mm at 10 Hz: BARO, a Bar30
DOPPLER = dict.fromkeys("uvw", Channel(0.005, 2))  # 0.6 to 1.3 mm/s at 9 Hz: VISO, smoothed; as in the other logs here
MOCAP_POSITION, MOCAP_ATTITUDE = Channel(0.002), Channel(0.004)

DEFAULT = SensorSet(  # what is measured where no set is asked for; damages choose which of it a log holds
    "paper",
    {
        **dict.fromkeys("xyz", MOCAP_POSITION),
        **dict.fromkeys(("roll", "pitch", "yaw"), MOCAP_ATTITUDE),
        **dict.fromkeys("uvwpqr", Channel(0.005)),  # m/s, rad/s; a Doppler log and a gyro
    },
)
SENSOR_SETS = {
    "stock": SensorSet("bluerov2_heavy", {**DEPTH, **ATTITUDE, **GYRO, **ACCELEROMETER}),
    "dvl": SensorSet("bluerov2_heavy", {**DEPTH, **ATTITUDE, **DOPPLER, **GYRO, **ACCELEROMETER}),
    "mocap": SensorSet(
        "bluerov2_heavy",
        {**dict.fromkeys("xyz", MOCAP_POSITION), **dict.fromkeys(("roll", "pitch", "yaw"), MOCAP_ATTITUDE)},
    ),
}


def sensor_set(name: str | None) -> SensorSet:
    """A set by its name, or what is measured where none is asked for."""
    return DEFAULT if name is None else SENSOR_SETS[name]


Draw = Callable[[Rng, Vehicle], dict[str, Any]]
WEAK = (0.15, 0.6)  # of the thrust: weed, a broken blade, a bad phase
REVERSED = (0.8, 1.0)  # of the thrust, backwards: blades are shaped for one direction
DEPTH_BIAS = (0.3, 3.0)  # m, either way: not zeroed, or the weather since


def _gain(draw: Callable[[Rng], float]) -> Draw:
    """One thruster, any, with a gain that is drawn."""
    return lambda rng, vehicle: {f"gain_{rng.integers(1, vehicle.thrusters + 1)}": draw(rng)}


FAULTS: dict[str, tuple[str, Draw]] = {  # by name, the effect and its values
    "dead thruster": ("thruster_gain", _gain(lambda rng: 0.0)),
    "reversed thruster": ("thruster_gain", _gain(lambda rng: -float(rng.uniform(*REVERSED)))),
    "weak thruster": ("thruster_gain", _gain(lambda rng: float(rng.uniform(*WEAK)))),
    "buoyancy": ("buoyancy", lambda rng, vehicle: CLEAR["buoyancy"](rng)),
    "payload": ("payload", lambda rng, vehicle: CLEAR["payload"](rng)),
    "depth bias": (
        "depth_bias", lambda rng, vehicle: {"offset": float(rng.choice((-1, 1)) * rng.uniform(*DEPTH_BIAS))}
    ),
}  # fmt: skip
THRUSTER, LOAD, UNSEEN = ("dead thruster", "reversed thruster", "weak thruster"), ("buoyancy", "payload"), "depth bias"


def draw_fault(fault: str, vehicle: Vehicle, rng: np.random.Generator) -> dict[str, dict[str, float]]:
    """Values by effect of a fault."""
    name, draw = FAULTS[fault]
    return {name: get_effect(name).read(vehicle, draw(rng, vehicle))}
