"""Follow, notice, search, freeze: what the adaptation does for each vehicle of a fleet during one flight."""

import logging
from collections.abc import Iterator
from enum import Enum
from typing import Any

import numpy as np
import torch
from torch import Tensor

from auv_torchrl.online.allocation import Allocation
from auv_torchrl.online.config import OnlineConfig
from auv_torchrl.online.dead_end import DeadEnd
from auv_torchrl.online.detector import ChangeDetector
from auv_torchrl.online.filter import VELOCITY, Belief, EffectivenessFilter
from auv_torchrl.online.gain_watch import GainWatch
from auv_torchrl.online.guard import MeasurementGuard, Verdict
from auv_torchrl.online.motion import SourceMotion, Step
from auv_torchrl.online.sensing import Reading, Sensing
from auv_torchrl.online.timing import ActuatorTiming
from auv_torchrl.vehicle import CONTROLLED

Array = Any
log = logging.getLogger(__name__)
_D = len(CONTROLLED)
_NOISE_RATE = 0.02  # per step, how fast the noise grows that the map cannot explain
_LATE_NOISE = 100.0  # least of it where thrust comes late: within a step it is no constant
_LARGEST_NOISE = 1e5  # times the variance of the config
_FIELDS = (
    "phase", "total", "noise_scale", "lost_s", "search_s", "alarms", "carried", "raw", "sign", "beginning",
)  # fmt: skip
_LARGEST_GAIN = 3.0  # no thruster does more than this times what it should: such a map explains nothing
_LEAST_SEARCH_S = 0.25  # s before that is judged
_SURPRISED = 3.0  # times the variance of the config: so much noise says that the map does not describe the vehicle
_UNEXPLAINED_NOISE = 1e4  # times the variance of the config, at least, where no map explains the motion
_IMPLAUSIBLE = 4.0  # standard deviations of the prior
_IMPOSSIBLE_SPEED = 20.0  # m/s and rad/s
_ROUGH = 0.5  # m/s and rad/s, standard error of a velocity from two poses: it changes between them


class Phase(Enum):
    """What the adaptation is doing; the value is the sentence of the log."""

    FOLLOWING = "the map describes the vehicle: small drift is followed"
    SEARCHING = "the vehicle has changed: what was learnt is dropped and learnt anew, with a dither"
    FROZEN = "no usable measurement: what was learnt is kept as it is until measurements come again"


PHASES = tuple(Phase)
FOLLOWING, SEARCHING, FROZEN = range(3)


class OnlineLearner:
    """Beliefs about N vehicles, their phases, and the thrusts that do what the source vehicle would.

    Args:
        motion: of the source vehicle.
        limits: smallest and largest thrust (n,) of each thruster, shares of full thrust.
        edge: (n,) shares of full thrust below which a thruster gives nothing.
        config: settings.
        sensing: reads the observations of the N vehicles.
        count: number of vehicles N.
    """

    def __init__(
        self,
        motion: SourceMotion,
        limits: tuple[Array, Array],
        edge: Array,
        config: OnlineConfig,
        sensing: Sensing,
        count: int,
    ):
        self.motion, self.config, self.sensing, self.count = motion, config, sensing, count
        self.filter = EffectivenessFilter(motion, config)
        steps = 2 * 3600.0 / motion.control_dt / config.false_alarms_per_hour  # each of two tests has half of them
        self.watch = GainWatch(count, motion.per_share.shape[1], steps)
        self.detector = ChangeDetector(_D, config.smallest_shift, steps)
        self.weight = 1.0 / np.square(motion.full_wrench)
        self.weight[_D - 1] *= config.heading_weight**2
        self.timing = ActuatorTiming(count, motion.per_share, motion.control_dt)
        self.allocation = Allocation(self.weight, *limits)
        self.limits = limits
        by_wrench = motion(np.zeros((1, _D)), np.zeros((1, _D))).by_wrench[0]
        if config.sensed == "velocity":
            self.entries = np.arange(_D, 2 * _D)
            reach = (np.abs(by_wrench[_D:]) * motion.full_wrench).sum(-1)
            slack = 10 * np.full(_D, config.velocity_noise)
        else:
            self.entries = np.arange(_D)
            reach = np.zeros(_D)
            slack = np.array((*(config.largest_jump_m,) * 3, 1.0))
        self.guard = MeasurementGuard(count, motion.control_dt, reach, slack)
        self.belief = self.filter.start(count)
        self.phase = np.full(count, FOLLOWING)
        self.total = np.zeros(count)  # of the detector
        self.statistic = np.zeros(count)  # the larger test's share of its threshold, before an alarm empties it
        self.settled = np.zeros(count, dtype=bool)  # whose search ended in the last step
        self.noise_scale = np.ones(count)
        self.lost_s = np.zeros(count)
        self.search_s = np.zeros(count)
        self.dead_end = DeadEnd(count, limits, motion.control_dt)
        self.alarms = np.zeros(count, dtype=np.int64)
        self.carried = np.zeros((count, _D))  # wrench that the dead band has withheld so far
        self.carry_limit = (np.abs(motion.per_share) * edge).max(-1)
        self.column_power = (self.weight[:, None] * np.square(motion.per_share)).sum(0)
        self.sign = np.ones((count, motion.per_share.shape[1]))  # of the dither
        self.raw = np.full((count, 8), np.nan)  # of the last measurement; velocity estimated where it is not measured
        self.beginning = np.zeros(count, dtype=bool)  # of one pose only: a second one gives the velocity
        self.generator = torch.Generator().manual_seed(config.seed)

    def begin(self, rows: Array, observation: Array) -> None:
        """A new episode of some vehicles (rows of the observations (N, d)); what has been learnt of them is kept."""
        reading = self.sensing.read(observation)
        self._place(rows, reading)
        self.raw = self._known(reading)
        self.guard.begin(rows)
        self.timing.begin(rows)
        self.total[rows] = self.lost_s[rows] = self.search_s[rows] = 0.0
        self.statistic[rows] = 0.0
        self.watch.reset(rows)
        self.dead_end.begin(rows)
        self.carried[rows] = 0.0

    def _place(self, rows: Array, reading: Reading) -> None:
        velocity = reading.raw[rows, :4]
        known = np.isfinite(velocity).all(-1) & (np.abs(velocity) < _IMPOSSIBLE_SPEED).all(-1)
        self.filter.place(self.belief, rows, np.where(known[:, None], velocity, 0.0), self.config.velocity_noise)
        self.sensing.restart(reading, rows)
        self.watch.reset(rows)
        self.beginning[rows] = self.config.sensed == "pose"

    def _begin_motion(self, rows: Array, reading: Reading) -> None:
        """Start from the mean velocity between the first two poses of some vehicles."""
        speed = np.clip(reading.measured[rows] / self.motion.control_dt, -_IMPOSSIBLE_SPEED, _IMPOSSIBLE_SPEED)
        self.filter.place(self.belief, rows, speed, _ROUGH)
        self.sensing.restart(reading, rows)
        self.beginning[rows] = False

    def _known(self, reading: Reading) -> Array:
        """What is known of velocity, position and heading, (N, 8): estimated velocities where none are measured."""
        if self.config.sensed == "velocity":
            return reading.raw
        return np.concatenate((self.velocity, reading.raw[:, 4:]), axis=-1)

    @property
    def velocity(self) -> Array:
        """Estimated velocity (N, 4) in the body frame."""
        return self.belief.mean[:, VELOCITY]

    def uncertainty(self) -> Array:
        """Standard error of each thruster's effect as a share of its nominal effect, (N, n)."""
        block = self.filter.wrench_covariance(self.belief, self.weight)
        return np.sqrt(np.clip(np.diagonal(block, axis1=1, axis2=2), 0.0, None) / self.column_power)

    def state(self) -> dict[str, Tensor]:
        """Everything that changes during a flight, as tensors."""
        arrays = {name: torch.from_numpy(np.array(getattr(owner, key))) for name, owner, key in self._stateful()}
        return {**arrays, "generator": self.generator.get_state()}

    def load_state(self, state: dict[str, Tensor]) -> None:
        """Go on from :meth:`state` of a learner of as many vehicles.

        Raises:
            ValueError: if it is of another number of vehicles or thrusters.
        """
        if state["belief.mean"].shape != self.belief.mean.shape:
            raise ValueError(
                f"online adapter: the state is of {list(state['belief.mean'].shape)} vehicles and estimates, "
                f"this adapter has {list(self.belief.mean.shape)}: load it into one of that size"
            )
        for name, owner, key in self._stateful():
            setattr(owner, key, state[name].numpy().copy())
        self.generator.set_state(state["generator"])

    def _stateful(self) -> Iterator[tuple[str, Any, str]]:
        owners: dict[str, tuple[Any, tuple[str, ...]]] = {
            "belief": (self.belief, Belief.FIELDS),
            "guard": (self.guard, MeasurementGuard.FIELDS),
            "dead_end": (self.dead_end, DeadEnd.FIELDS),
            "sensing": (self.sensing, Sensing.FIELDS),
            "timing": (self.timing, ActuatorTiming.FIELDS),
            "watch": (self.watch, GainWatch.FIELDS),
            "learner": (self, _FIELDS),
        }
        for owner_name, (owner, keys) in owners.items():
            for key in keys:
                yield f"{owner_name}.{key}", owner, key

    # commands

    def thrusts(self, nominal: Array) -> Array:
        """Thrusts (N, n), shares of full thrust, whose wrench is what ``nominal`` (N, n) gives the source vehicle."""
        effectiveness, constant = self.filter.map_of(self.belief)
        wanted = nominal @ self.motion.per_share.T - constant + self.carried
        caution = self.filter.wrench_covariance(self.belief, self.weight)
        share = self.allocation(wanted, effectiveness, caution, nominal)
        searching = self.phase == SEARCHING
        if self.config.dither > 0 and searching.any():
            unknown = np.sqrt(np.clip(np.diagonal(caution, axis1=1, axis2=2), 0, None) / self.column_power)
            self._turn_dither()
            amount = self.config.dither * (unknown > self.config.settled_below) * searching[:, None]
            share = np.clip(share + amount * self.sign, *self.limits)
        return share

    def _turn_dither(self) -> None:
        """New signs, held for longer where thrust follows late: it must arrive before it turns again."""
        hold = 1 + np.ceil(self.timing.late_s() / self.motion.control_dt - 1e-9)
        drawn = torch.randint(0, 2, self.sign.shape, generator=self.generator).numpy() * 2.0 - 1.0
        turns = np.round(self.search_s / self.motion.control_dt) % hold == 0
        self.sign = np.where(turns[:, None], drawn, self.sign)

    def withheld(self, wanted: Array, given: Array) -> None:
        """Remember the wrench lost to the dead band between shares wanted and given (N, n), to give it later."""
        effectiveness, _ = self.filter.map_of(self.belief)
        lost = (effectiveness @ (wanted - given)[..., None])[..., 0]
        self.carried = np.clip(0.9 * self.carried + lost, -self.carry_limit, self.carry_limit)
        self.carried[self.phase != FOLLOWING] = 0.0

    # learning

    def observe(self, share: Array, observation: Array, time: Array) -> Array:
        """Learn from one control step; returns which vehicles raised an alarm, (N,) bool.

        Args:
            share: (N, n) thrusts that were commanded, shares of full thrust.
            observation: (N, d) at its end.
            time: (N,) s at its end.
        """
        reading = self.sensing.read(observation)
        arriving = self.timing.arriving(share)
        effectiveness, _ = self.filter.map_of(self.belief)
        step, wrench = self.filter.predict(self.belief, arriving, self.noise_scale)
        self.watch.predict(step, effectiveness, arriving)
        difference = reading.measured - self.belief.mean[:, self.entries]
        difference[self.beginning] = np.where(np.isfinite(difference[self.beginning]), 0.0, np.nan)
        verdict = self.guard.judge(reading.raw, time, difference, np.abs(share).max(-1) > 0)
        usable = verdict.usable & (self.phase != FROZEN)
        second = usable & self.beginning
        usable &= ~second
        innovation = self.filter.update(self.belief, self.entries, reading.measured, reading.variance, usable)
        self.sensing.accept(reading, usable)
        if second.any():
            self._begin_motion(second.nonzero()[0], reading)
        self.raw = self._known(reading)
        self._explain(step, wrench, reading, usable)
        following = usable & (self.phase == FOLLOWING)
        self.total = self.detector.advance(self.total, innovation.square, following)
        self.watch.update(self.entries, innovation, following)
        self.statistic = np.maximum(self.total / self.detector.threshold, self.watch.statistic)
        excess = np.clip(innovation.square / _D, 0.0, 4.0) - 1.0
        least = np.where(self.timing.late_s() > 0, _LATE_NOISE, 1.0)
        scaled = self.noise_scale * np.exp(_NOISE_RATE * excess)
        self.noise_scale = np.where(usable, np.clip(scaled, least, _LARGEST_NOISE), self.noise_scale)
        nowhere = self.dead_end.reached(share, self.raw[:, :4])
        alarm = ((self.statistic > 1.0) | self._implausible() | nowhere) & (self.phase == FOLLOWING)
        if alarm.any():
            self.search(alarm.nonzero()[0])
        self._end_searches()
        self._note_losses(verdict, reading)
        return alarm

    def _implausible(self) -> Array:
        """Vehicles whose constant wrench has drifted so far that it must stand for something else, (N,) bool."""
        _, constant = self.filter.map_of(self.belief)
        return (np.abs(constant) > _IMPLAUSIBLE * self.config.constant_spread * self.motion.full_wrench).any(-1)

    def _explain(self, step: Step, wrench: Array, reading: Reading, usable: Array) -> None:
        """Remember the wrench that would have brought the source vehicle to the measured velocity."""
        if self.config.sensed != "velocity":
            return  # one step of noisy positions says nothing about its wrench
        surprise = np.where(usable[:, None], reading.raw[:, :4] - step.velocity, 0.0)
        missing = np.linalg.solve(step.by_wrench[:, _D:], surprise[..., None])[..., 0]
        self.timing.learn(np.where(usable[:, None], wrench + missing, np.nan))

    def search(self, rows: Array) -> None:
        """Drop what has been learnt of some vehicles and learn it anew."""
        self.filter.forget(self.belief, rows)
        self.phase[rows] = SEARCHING
        self.total[rows] = self.search_s[rows] = 0.0
        self.watch.reset(rows)
        self.dead_end.begin(rows)
        self.alarms[rows] += 1

    def _end_searches(self) -> None:
        self.settled[:] = False
        searching = self.phase == SEARCHING
        if not searching.any():
            return
        self.search_s[searching] += self.motion.control_dt
        known = self.uncertainty().max(-1) < self.config.settled_below
        done = searching & (known | (self.search_s > self.config.longest_search_s))
        for row in done.nonzero()[0]:
            if self.timing.judge(row, round(float(self.search_s[row]) / self.motion.control_dt)):
                log.debug(
                    "vehicle %d: thrust follows its command %.2f s late with a lag of %.2f s",
                    row,
                    *self.timing.timing_of(row),
                )
                self.search(np.array([row]))
                done[row] = False
        surprised = (self.noise_scale > _SURPRISED) & (self.search_s > _LEAST_SEARCH_S)
        hopeless = searching & surprised & self._impossible_map()
        self._give_up(hopeless.nonzero()[0])
        done |= hopeless
        self.phase[done] = FOLLOWING
        self.total[done] = 0.0
        self.watch.reset(done)
        self.settled = done

    def _impossible_map(self) -> Array:
        """Vehicles with a thruster that does more than any thruster can, (N,) bool: the hull must have changed."""
        effectiveness, _ = self.filter.map_of(self.belief)
        power = (self.weight[:, None] * np.square(effectiveness)).sum(1)
        return (power > _LARGEST_GAIN**2 * self.column_power).any(-1)

    def _give_up(self, rows: Array) -> None:
        """Go back to the source vehicle's map where none was found that explains the motion."""
        if not len(rows):
            return
        log.debug("vehicles %s: no map of the thrusters explains the motion: the source's is kept", rows.tolist())
        velocity = self.velocity[rows].copy()
        self.filter.trust(self.belief, rows)
        self.belief.mean[rows, VELOCITY] = velocity
        self.noise_scale[rows] = np.maximum(self.noise_scale[rows], _UNEXPLAINED_NOISE)

    def _note_losses(self, verdict: Verdict, reading: Reading) -> None:
        """Freeze after a long loss, and take up again where measurements have come back."""
        self.lost_s = np.where(verdict.usable, 0.0, self.lost_s + self.motion.control_dt)
        freeze = (self.lost_s > self.config.lost_after_s) & (self.phase != FROZEN)
        if freeze.any():
            log.warning("vehicles %s: %s", freeze.nonzero()[0].tolist(), Phase.FROZEN.value)
            self.phase[freeze] = FROZEN
        frozen = self.phase == FROZEN
        back = (verdict.usable & frozen) | verdict.restart
        if back.any():
            rows = back.nonzero()[0]
            if frozen[rows].any():
                log.info("vehicles %s: measurements are usable again", rows[frozen[rows]].tolist())
            unknown = self.uncertainty().max(-1) > self.config.uncertain_above
            self.phase[back & frozen] = np.where(unknown, SEARCHING, FOLLOWING)[back & frozen]
            self.search_s[back & frozen] = 0.0
            self.lost_s[rows] = 0.0
            self._place(rows, reading)
