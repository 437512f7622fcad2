"""When thrust follows its command late: which delay and lag explain it, and where a vehicle will be by then."""

import itertools
from typing import Any

import numpy as np

from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.adaptation.memory import Memory
from auv_torchrl.adaptation.motion import SourceMotion
from auv_torchrl.adaptation.sensing import turned
from auv_torchrl.physics.kinematics import heading_of, quaternion_from_euler, quaternion_product
from auv_torchrl.physics.thrusters import delayed

Array = Any
_MEMORY = 60  # control steps
_SETTLE = 12  # control steps before a window, in which an unknown thrust dies out
_RIDGE = 1e-3


class ActuatorTiming(Memory):
    """Delay and lag of each of N vehicles, chosen from a grid by how well they explain the last seconds.

    Args:
        count: number of vehicles N.
        motion: of the source vehicle.
        config: says which delays and lags there may be.
    """

    chosen: Array  # (N,) number of the timing
    shares: Array  # (N, steps, n) commanded, newest first
    wrenches: Array  # (N, steps, D) that explain the motion, newest first
    arrived: Array  # (N, n) thrust under the chosen timing, at the end of the last step

    def __init__(self, count: int, motion: SourceMotion, config: AdaptationConfig):
        super().__init__()
        n = motion.per_share.shape[1]
        self.config = config
        there_are = [(0.0, 0.0), *itertools.product(config.delays_s, config.lags_s)]  # the first is none
        self.timings = np.array(list(dict.fromkeys(there_are)))
        self.control_dt, self.unit = motion.control_dt, motion.full_wrench
        self.nominal = motion.per_share
        self.remember(chosen=np.zeros(count, dtype=np.int64), shares=np.zeros((count, _MEMORY, n)))
        self.remember(wrenches=np.full((count, _MEMORY, motion.size), np.nan), arrived=np.zeros((count, n)))

    def begin(self, rows: Array) -> None:
        """Thrusters are silent in these rows; the timing that was found stays."""
        self.shares[rows] = 0.0
        self.arrived[rows] = 0.0
        self.wrenches[rows] = np.nan

    def arriving(self, share: Array) -> Array:
        """Mean thrust over a control step (N, n) in which ``share`` (N, n) is commanded, under the chosen timing."""
        self.shares = np.concatenate((share[:, None], self.shares[:, :-1]), axis=1)
        if not self.chosen.any():
            return share
        delay, lag = self.timings[self.chosen].T
        mean, self.arrived = _lagged(delayed(self.shares, delay, self.control_dt), self.arrived, lag, self.control_dt)
        return mean

    def learn(self, wrench: Array) -> None:
        """Remember the wrenches (N, D) that explain the last step; NaN where it could not be measured."""
        self.wrenches = np.concatenate((wrench[:, None], self.wrenches[:, :-1]), axis=1)

    def judge(self, row: int, steps: int) -> bool:
        """Choose the timing that explains the last ``steps`` steps of a vehicle best; returns whether it is new."""
        steps = min(steps, _MEMORY - _SETTLE)
        wrench = self.wrenches[row, :steps][::-1] / self.unit
        known = np.isfinite(wrench).all(-1)
        if known.sum() < self.config.timing_steps:
            return False
        errors = np.array([self._error(row, steps, delay, lag, wrench, known) for delay, lag in self.timings])
        best = int(errors.argmin())
        if best == self.chosen[row] or errors[best] > self.config.timing_error_left * errors[self.chosen[row]]:
            return False
        self.chosen[row] = best
        _, self.arrived[row] = self._arrivals(row, steps, *self.timings[best])
        return True

    def late_s(self) -> Array:
        """Delay and lag together, (N,) s: how far ahead a command acts."""
        return self.timings[self.chosen].sum(-1)

    def coming(self, rows: Array, steps: int) -> list[Array]:
        """Mean thrusts (k, n) of some vehicles over the next ``steps`` steps if the last command is held."""
        delay, lag = self.timings[self.chosen[rows]].T
        sent, arrived, thrusts = self.shares[rows], self.arrived[rows], []
        for _ in range(steps):
            sent = np.concatenate((sent[:, :1], sent[:, :-1]), axis=1)
            mean, arrived = _lagged(delayed(sent, delay, self.control_dt), arrived, lag, self.control_dt)
            thrusts.append(mean)
        return thrusts

    def _error(self, row: int, steps: int, delay: float, lag: float, wrench: Array, known: Array) -> float:
        """Squared error of the best map under a timing, in shares of the full wrench, per step."""
        thrust, _ = self._arrivals(row, steps, delay, lag)
        x = np.concatenate((thrust[known], np.ones((int(known.sum()), 1))), axis=1)
        y = wrench[known]
        prior = np.concatenate((self.nominal / self.unit[:, None], np.zeros((len(self.unit), 1))), axis=1).T
        gram = x.T @ x + _RIDGE * np.eye(x.shape[1])
        fit = np.linalg.solve(gram, x.T @ y + _RIDGE * prior)
        return float(np.square(y - x @ fit).sum() / max(len(x) - x.shape[1], 1))

    def _arrivals(self, row: int, steps: int, delay: float, lag: float) -> tuple[Array, Array]:
        """Mean thrusts (steps, n) of the last steps of a vehicle under a timing, oldest first, and the last thrust."""
        reach = min(steps + _SETTLE, _MEMORY)
        sent = self.shares[row, :reach]
        late = int(np.ceil(delay / self.control_dt))
        padded = np.concatenate((sent, np.repeat(sent[-1:], late + 1, axis=0)))
        windows = np.stack([padded[k : k + late + 2] for k in range(reach)])
        reaching = delayed(windows, np.full(reach, delay), self.control_dt)[::-1]
        share, left = _lag_shares(np.array(lag), self.control_dt)
        arrived = [reaching[0]]
        for target in reaching:
            arrived.append(target + (arrived[-1] - target) * left)
        before = np.array(arrived[:-1])
        return (reaching + (before - reaching) * share)[-steps:], arrived[-1]


def _lagged(target: Array, before: Array, lag: Array, dt: float) -> tuple[Array, Array]:
    """Mean over a step, and value at its end, of a first-order lag towards ``target`` (..., n)."""
    share, left = _lag_shares(lag, dt)
    return target + (before - target) * share, target + (before - target) * left


def _lag_shares(lag: Array, dt: float) -> tuple[Array, Array]:
    """Share (..., 1) of the distance to its target that a lag keeps, on the mean of a step and at its end."""
    instant = lag < 1e-6
    tau = np.where(instant, 1.0, lag)
    left = np.where(instant, 0.0, np.exp(-dt / tau))[..., None]
    return np.where(instant, 0.0, tau / dt * (1 - np.exp(-dt / tau)))[..., None], left


def look_ahead(
    motion: SourceMotion, state: Array, time: Array, timing: ActuatorTiming, effectiveness: Array, constant: Array
) -> tuple[Array, Array]:
    """States (N, 13) and times (N,) that are expected when thrust has followed; the same where it is not late.

    Args:
        motion: of the source vehicle; where it is level, roll, pitch and their rates are taken to stay as they are.
        state: (N, 13) measured position, quaternion and velocity; rows with other than numbers are left as they are.
        time: (N,) s since the episodes began.
        timing: of the N vehicles, with the thrusts that are on their way.
        effectiveness: (N, D, n) wrench per share.
        constant: (N, D) wrench that acts without the thrusters.
    """
    rows = (timing.late_s() > 0).nonzero()[0]
    rows = rows[np.isfinite(state[rows]).all(-1)]
    if not len(rows):
        return state, time
    state, time = state.copy(), time.copy()
    steps = np.ceil(timing.late_s()[rows] / motion.control_dt - 1e-9).astype(int)
    velocity, body = state[rows][:, motion.velocity_rows], state[rows, :7]
    for k, thrust in enumerate(timing.coming(rows, int(steps.max()))):
        wrench = (effectiveness[rows] @ (motion.flow(velocity, thrust) * thrust)[..., None])[..., 0] + constant[rows]
        moved, reached = motion.advance(velocity, wrench, None if motion.is_level else body)
        going = (k < steps)[:, None]
        moved, velocity = np.where(going, moved, 0.0), np.where(going, reached, velocity)
        body = _turned_level(body, moved) if motion.is_level else motion.moved_to(body, moved)
    state[rows, :7] = body
    state[np.ix_(rows, motion.velocity_rows)] = velocity
    time[rows] += steps * motion.control_dt
    return state, time


def _turned_level(body: Array, moved: Array) -> Array:
    """Position and quaternion (k, 7) after displacements (k, 4) of a vehicle whose roll and pitch stay as they are."""
    turn, level = moved[:, 3], np.zeros(len(moved))
    position = body[:, :3] + turned(moved[:, :3], heading_of(body[:, 3:]) + turn / 2)
    quaternion = quaternion_product(quaternion_from_euler(level, level, turn), body[:, 3:])
    return np.concatenate((position, quaternion), axis=-1)
