"""Follow, notice, search, freeze: what the adaptation does for each vehicle of a fleet during one flight."""

import logging
from enum import Enum
from typing import Any

import numpy as np

from auv_torchrl.adaptation.choice import ThrustChoice
from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.adaptation.detector import ChangeDetector, DeadEnd, GainWatch
from auv_torchrl.adaptation.estimate import Estimate, Evidence
from auv_torchrl.adaptation.memory import Memory
from auv_torchrl.adaptation.motion import SourceMotion

Array = Any
log = logging.getLogger(__name__)


class Phase(Enum):
    """What the adaptation is doing; the value is the sentence of the log."""

    FOLLOWING = "the map describes the vehicle: small drift is followed"
    SEARCHING = "the vehicle has changed: what was learnt is dropped and learnt anew, with a dither"
    FROZEN = "no usable measurement: what was learnt is kept as it is until measurements come again"


PHASES = tuple(Phase)
FOLLOWING, SEARCHING, FROZEN = range(3)


class InFlightLearner(Memory):
    """Phases of N vehicles, and the thrusts that do what the source vehicle would.

    Args:
        motion: of the source vehicle.
        limits: smallest and largest thrust (n,) of each thruster, shares of full thrust.
        edge: (n,) shares of full thrust below which a thruster gives nothing.
        config: settings.
        count: number of vehicles N.
    """

    phase: Array  # (N,) index of PHASES
    total: Array  # (N,) sum of the detector
    lost_s: Array  # (N,) s since the last usable measurement
    search_s: Array  # (N,) s since the search began
    alarms: Array  # (N,) how many there have been

    def __init__(
        self, motion: SourceMotion, limits: tuple[Array, Array], edge: Array, config: AdaptationConfig, count: int
    ):
        super().__init__()
        self.motion, self.config = motion, config
        self.estimate = Estimate(motion, config, count)
        self.choice = ThrustChoice(self.estimate, limits, edge, config)
        steps = 2 * 3600.0 / motion.control_dt / config.false_alarms_per_hour  # each of two tests has half of them
        self.watch = GainWatch(count, motion.size, motion.per_share.shape[1], steps, config)
        self.detector = ChangeDetector(motion.size, config.smallest_shift, steps, config.capped_share)
        self.dead_end = DeadEnd(count, limits, motion.control_dt, config)
        self.remember(phase=np.full(count, FOLLOWING), alarms=np.zeros(count, dtype=np.int64))
        self.remember(total=np.zeros(count), lost_s=np.zeros(count), search_s=np.zeros(count))
        self.statistic = np.zeros(count)  # the larger test's share of its threshold, before an alarm empties it
        self.settled = np.zeros(count, dtype=bool)  # whose search ended in the last step

    def begin(self, rows: Array, measured: Array) -> None:
        """A new episode of some vehicles (rows of measured states (N, 13)); what has been learnt of them is kept."""
        self.estimate.begin(rows, measured)
        self.total[rows] = self.lost_s[rows] = self.search_s[rows] = 0.0
        self.statistic[rows] = 0.0
        self.watch.reset(rows)
        self.dead_end.begin(rows)
        self.choice.carried[rows] = 0.0

    def thrusts(self, nominal: Array) -> Array:
        """Thrusts (N, n), shares of full thrust, whose wrench is what ``nominal`` (N, n) gives the source vehicle."""
        return self.choice(self.estimate, nominal, self.phase == SEARCHING, self.search_s)

    def withheld(self, wanted: Array, given: Array) -> None:
        """Give later what the dead band withholds of the thrusts (N, n) that were wanted."""
        self.choice.withheld(self.estimate, wanted, given, self.phase == FOLLOWING)

    def observe(self, share: Array, measured: Array, time: Array) -> Array:
        """Learn from one control step; returns which vehicles raised an alarm, (N,) bool.

        Args:
            share: (N, n) thrusts that were commanded, shares of full thrust.
            measured: (N, 13) states at its end: position, quaternion, velocity.
            time: (N,) s at its end.
        """
        evidence = self.estimate.observe(share, measured, time, self.phase == FROZEN)
        following = evidence.usable & (self.phase == FOLLOWING)
        self.total = self.detector.advance(self.total, evidence.innovation.square, following)
        self.watch.predict(evidence.step, evidence.effectiveness, evidence.arriving)
        self.watch.update(self.estimate.entries, evidence.innovation, following)
        self.statistic = np.maximum(self.total / self.detector.threshold, self.watch.statistic)
        nowhere = self.dead_end.reached(share, evidence.velocity)
        changed = (self.statistic > 1.0) | self.estimate.implausible() | nowhere
        alarm = changed & (self.phase == FOLLOWING)
        if alarm.any():
            self.search(alarm.nonzero()[0])
        self._end_searches()
        self._note_losses(evidence)
        return alarm

    def search(self, rows: Array) -> None:
        """Drop what has been learnt of some vehicles and learn it anew."""
        self.estimate.forget(rows)
        self.phase[rows] = SEARCHING
        self.total[rows] = self.search_s[rows] = 0.0
        self.watch.reset(rows)
        self.dead_end.begin(rows)
        self.alarms[rows] += 1

    def _end_searches(self) -> None:
        config, timing = self.config, self.estimate.timing
        self.settled[:] = False
        searching = self.phase == SEARCHING
        if not searching.any():
            return
        self.search_s[searching] += self.motion.control_dt
        known = self.estimate.uncertainty().max(-1) < config.settled_below
        done = searching & (known | (self.search_s > config.longest_search_s))
        for row in done.nonzero()[0]:
            if timing.judge(row, round(float(self.search_s[row]) / self.motion.control_dt)):
                chosen = timing.timings[timing.chosen[row]]
                log.debug("vehicle %d: thrust comes %.2f s late with a lag of %.2f s", row, *chosen)
                self.search(np.array([row]))
                done[row] = False
        hopeless = searching & (self.search_s > config.least_search_s) & self.estimate.unexplained()
        if hopeless.any():
            self.estimate.give_up(hopeless.nonzero()[0])
        done |= hopeless
        self.phase[done] = FOLLOWING
        self.total[done] = 0.0
        self.watch.reset(done)
        self.settled = done

    def _note_losses(self, evidence: Evidence) -> None:
        """Freeze after a long loss, and take up again where measurements have come back."""
        verdict = evidence.verdict
        self.lost_s = np.where(verdict.usable, 0.0, self.lost_s + self.motion.control_dt)
        freeze = (self.lost_s > self.config.lost_after_s) & (self.phase != FROZEN)
        if freeze.any():
            log.warning("vehicles %s: %s", freeze.nonzero()[0].tolist(), Phase.FROZEN.value)
            self.phase[freeze] = FROZEN
        frozen = self.phase == FROZEN
        back = (verdict.usable & frozen) | verdict.restart
        if not back.any():
            return
        rows = back.nonzero()[0]
        if frozen[rows].any():
            log.info("vehicles %s: measurements are usable again", rows[frozen[rows]].tolist())
        unknown = self.estimate.uncertainty().max(-1) > self.config.uncertain_above
        self.phase[back & frozen] = np.where(unknown, SEARCHING, FOLLOWING)[back & frozen]
        self.search_s[back & frozen] = 0.0
        self.lost_s[rows] = 0.0
        self.estimate.place(rows, evidence.reading)
        self.watch.reset(rows)
