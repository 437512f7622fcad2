"""Effects of the sensors that report the pose."""

import math

from torch import Tensor

from auv_torchrl.effects.effect import Effect, Origin, Parameter, changed, own
from auv_torchrl.vehicle import Vehicle


def _heading_bias(vehicle: Vehicle, angle: Tensor) -> Vehicle:
    return changed(vehicle, heading_bias=vehicle.heading_bias + angle)


heading_bias = Effect(
    name="heading_bias",
    origin=Origin.SENSING,
    meaning="measured yaw minus true yaw",
    source="compass deviation near iron, or a mocap frame turned against the body",
    parameters=(Parameter("angle", "rad", 0.0, -math.pi, math.pi, "the compass is off by {value:+.2f} rad"),),
    change=_heading_bias,
)


def _pose_delay(vehicle: Vehicle, delay: Tensor) -> Vehicle:
    return changed(vehicle, pose_delay=delay)


pose_delay = Effect(
    name="pose_delay",
    origin=Origin.SENSING,
    meaning="the pose is reported late",
    source="motion-capture and acoustic positioning latency",
    parameters=(Parameter("delay", "s", own("pose_delay"), 0.0, 0.8, "the pose is reported {value:.2f} s late"),),
    change=_pose_delay,
)


def _sensor_noise(vehicle: Vehicle, position: Tensor, attitude: Tensor) -> Vehicle:
    return changed(vehicle, position_noise=position, attitude_noise=attitude)


sensor_noise = Effect(
    name="sensor_noise",
    origin=Origin.SENSING,
    meaning="white noise on the reported pose, standard deviation per axis",
    source="Lu et al. 2023, section 6, future work",
    parameters=(
        Parameter("position", "m", own("position_noise"), 0.0, 0.5, "positions scatter by {value:.4f} m"),
        Parameter("attitude", "rad", own("attitude_noise"), 0.0, 0.5, "angles scatter by {value:.4f} rad"),
    ),
    change=_sensor_noise,
)

EFFECTS = (heading_bias, pose_delay, sensor_noise)
