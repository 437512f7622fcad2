"""What is known of the vehicles: motion, effect and timing of the thrusters, and how much noise they do not explain."""

import logging
from typing import Any, NamedTuple

import numpy as np

from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.adaptation.filter import EffectivenessFilter, Innovation
from auv_torchrl.adaptation.memory import Memory
from auv_torchrl.adaptation.motion import SourceMotion, Step, axis_weights
from auv_torchrl.adaptation.sensing import MeasurementGuard, Reading, Sensing, Verdict
from auv_torchrl.adaptation.timing import ActuatorTiming

Array = Any
log = logging.getLogger(__name__)


class Evidence(NamedTuple):
    """What a control step has shown."""

    step: Step  # what it was expected to do
    effectiveness: Array  # (N, D, n) by which that was expected
    arriving: Array  # (N, n) mean thrust, shares of full thrust; of servos, of what they push at the speed of the task
    reading: Reading
    verdict: Verdict
    usable: Array  # (N,) bool, which vehicles' estimates have changed by it
    innovation: Innovation
    velocity: Array  # (N, D) measured, or estimated where it is not measured


class Estimate(Memory):
    """Follows N vehicles by the source vehicle's equations and what is measured.

    Args:
        motion: of the source vehicle.
        config: settings.
        count: number of vehicles N.
    """

    noise_scale: Array  # (N,) on the variance of the process noise
    beginning: Array  # (N,) bool, of one pose only: a second one gives the velocity
    body: Array  # (N, 7) position and quaternion, measured last
    turned: Array  # (N, n) shares at which actuators stand that follow as servos do

    def __init__(self, motion: SourceMotion, config: AdaptationConfig, count: int):
        super().__init__()
        if config.sensed != "velocity" and not motion.is_level:
            raise ValueError(
                f"adaptation.sensed is {config.sensed}: of a vehicle at {motion.speed:g} m/s velocities are needed: "
                "give adaptation.sensed=velocity"
            )
        self.motion, self.config, d = motion, config, motion.size
        self.filter = EffectivenessFilter(motion, config)
        self.belief = self.filter.start(count)
        self.sensing = Sensing(config, count, motion.velocity_rows)
        self.timing = ActuatorTiming(count, motion, config)
        pushed = np.abs(motion.per_share).sum(-1) > 0
        reach = np.where(pushed, motion.full_wrench, 0.0)
        self.weight = axis_weights(reach, motion.axes, motion.speed, config)
        self.column_power = (self.weight[:, None] * np.square(motion.per_share)).sum(0)
        if config.sensed == "velocity":
            self.entries = np.arange(d, 2 * d)
            by_wrench = motion(np.zeros((1, d)), np.zeros((1, d))).by_wrench[0]
            reach = (np.abs(by_wrench[d:]) * motion.full_wrench).sum(-1)
            tolerance = 10 * np.full(d, config.velocity_noise)
        else:
            self.entries = np.arange(d)
            reach = np.zeros(d)
            tolerance = np.array((*(config.largest_jump_m,) * 3, 1.0))
        self.guard = MeasurementGuard(count, motion.control_dt, reach, tolerance, config)
        self.remember(noise_scale=np.ones(count), beginning=np.zeros(count, dtype=bool))
        level = np.tile(np.eye(1, 7, 3), (count, 1))
        self.remember(body=level, turned=np.zeros((count, motion.per_share.shape[1])))

    @property
    def map(self) -> tuple[Array, Array]:
        """Effectiveness (N, D, n), wrench per share of full thrust, and constant wrench (N, D)."""
        return self.filter.map_of(self.belief)

    @property
    def velocity(self) -> Array:
        """Estimated velocity (N, D) in the body frame."""
        return self.belief.mean[:, self.filter.velocity]

    def caution(self) -> Array:
        """Weighted covariance (N, n, n) of the effectiveness."""
        return self.filter.wrench_covariance(self.belief, self.weight)

    def uncertainty(self, caution: Array | None = None) -> Array:
        """Standard error of each thruster's effect as a share of its nominal effect, (N, n)."""
        block = self.caution() if caution is None else caution
        return np.sqrt(np.clip(np.diagonal(block, axis1=1, axis2=2), 0.0, None) / self.column_power)

    def begin(self, rows: Array, measured: Array) -> None:
        """A new episode of some vehicles (rows of measured states (N, 13)); what has been learnt of them is kept."""
        self.body[rows] = _measured_body(measured[rows], self.body[rows])
        self.turned[rows] = 0.0
        self.place(rows, self.sensing.read(measured))
        self.guard.begin(rows)
        self.timing.begin(rows)

    def place(self, rows: Array, reading: Reading) -> None:
        """The motion of some vehicles begins anew at this reading."""
        velocity, fastest = reading.raw[rows, : self.motion.size], self.config.impossible_speed
        known = np.isfinite(velocity).all(-1) & (np.abs(velocity) < fastest).all(-1)
        self.filter.place(self.belief, rows, np.where(known[:, None], velocity, 0.0), self.config.velocity_noise)
        self.sensing.restart(reading, rows)
        self.beginning[rows] = self.config.sensed == "pose"

    def observe(self, share: Array, measured: Array, time: Array, frozen: Array) -> Evidence:
        """Follow the vehicles through one control step.

        Args:
            share: (N, n) thrusts that were commanded, shares of full thrust.
            measured: (N, 13) states at its end.
            time: (N,) s at its end.
            frozen: (N,) bool, of which vehicles nothing is to be learnt.
        """
        reading = self.sensing.read(measured)
        arriving, self.turned = self.motion.turning(self.turned, self.timing.arriving(share))
        arriving = arriving * self.motion.flow(self.velocity, arriving)
        effectiveness = self.map[0].copy()
        body = None if self.motion.is_level else self.body
        step, wrench = self.filter.predict(self.belief, arriving, self.noise_scale, body)
        self.body = _measured_body(measured, self.body)
        difference = reading.measured - self.belief.mean[:, self.entries]
        difference[self.beginning] = np.where(np.isfinite(difference[self.beginning]), 0.0, np.nan)
        verdict = self.guard.judge(reading.raw, time, difference, np.abs(share).max(-1) > 0)
        usable = verdict.usable & ~frozen
        second = usable & self.beginning
        usable &= ~second
        innovation = self.filter.update(self.belief, self.entries, reading.measured, reading.variance, usable)
        self.sensing.accept(reading, usable)
        if second.any():
            self._begin_motion(second.nonzero()[0], reading)
        self._explain(step, wrench, reading, usable)
        self._scale_noise(innovation, usable)
        velocity = reading.raw[:, : self.motion.size] if self.config.sensed == "velocity" else self.velocity
        return Evidence(step, effectiveness, arriving, reading, verdict, usable, innovation, velocity)

    def _begin_motion(self, rows: Array, reading: Reading) -> None:
        """Start from the mean velocity between the first two poses of some vehicles."""
        fastest = self.config.impossible_speed
        speed = np.clip(reading.measured[rows] / self.motion.control_dt, -fastest, fastest)
        self.filter.place(self.belief, rows, speed, self.config.rough_velocity)
        self.sensing.restart(reading, rows)
        self.beginning[rows] = False

    def _explain(self, step: Step, wrench: Array, reading: Reading, usable: Array) -> None:
        """Remember the wrench that would have brought the source vehicle to the measured velocity."""
        if self.config.sensed != "velocity":
            return  # one step of noisy positions says nothing about its wrench
        d = self.motion.size
        surprise = np.where(usable[:, None], reading.raw[:, :d] - step.velocity, 0.0)
        missing = np.linalg.solve(step.by_wrench[:, d:], surprise[..., None])[..., 0]
        self.timing.learn(np.where(usable[:, None], wrench + missing, np.nan))

    def _scale_noise(self, innovation: Innovation, usable: Array) -> None:
        """Let the noise follow what the map cannot explain."""
        config = self.config
        excess = np.clip(innovation.square / self.motion.size, 0.0, 4.0) - 1.0
        least = np.where(self.timing.late_s() > 0, config.late_noise, 1.0)
        scaled = np.clip(self.noise_scale * np.exp(config.noise_rate * excess), least, config.largest_noise)
        self.noise_scale = np.where(usable, scaled, self.noise_scale)

    def implausible(self) -> Array:
        """Vehicles whose constant wrench has drifted so far that it must stand for something else, (N,) bool."""
        largest = self.config.implausible_constant * self.config.constant_spread * self.motion.full_wrench
        return (np.abs(self.map[1]) > largest).any(-1)

    def unexplained(self) -> Array:
        """Surprising vehicles with a thruster that does more than any can, (N,) bool: the hull must have changed."""
        power = (self.weight[:, None] * np.square(self.map[0])).sum(1)
        too_strong = (power > self.config.largest_gain**2 * self.column_power).any(-1)
        return too_strong & (self.noise_scale > self.config.surprising_noise)

    def forget(self, rows: Array) -> None:
        """Drop what has been learnt of some vehicles."""
        self.filter.forget(self.belief, rows)

    def give_up(self, rows: Array) -> None:
        """Go back to the source vehicle's map where none was found that explains the motion."""
        log.debug("vehicles %s: no map of the thrusters explains the motion: the source's is kept", rows.tolist())
        velocity = self.velocity[rows].copy()
        self.filter.trust(self.belief, rows)
        self.belief.mean[rows, self.filter.velocity] = velocity
        self.noise_scale[rows] = np.maximum(self.noise_scale[rows], self.config.unexplained_noise)


def _measured_body(measured: Array, before: Array) -> Array:
    """Position and quaternion (N, 7) of measured states (N, 13), those before where what is measured is no number."""
    body = measured[:, :7]
    return np.where(np.isfinite(body).all(-1, keepdims=True), body, before)
