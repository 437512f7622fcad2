"""Motion and effectiveness of a vehicle, estimated together: a Kalman filter per vehicle, batch first.

The state of a vehicle with n thrusters is its displacement and velocity along the D body axes that are followed (four
of one that hovers), the effectiveness B (D x n), wrench per share of each thruster's full thrust, and a constant
wrench b (D); of a vehicle with fins there is a second one, which grows with the flow as what a stuck fin pushes. The
wrench of a control step is B share + b; the source vehicle's equations turn it into motion. A prior
on B that comes from W in B = B_nominal W makes gains of single thrusters likelier than swaps, and both likelier than
anything else. Shares of fins are those that would push as much at the speed for which B is.
"""

from typing import Any, NamedTuple

import numpy as np

from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.adaptation.memory import Memory
from auv_torchrl.adaptation.motion import SourceMotion, Step

Array = Any
_STRONGEST = 4.0  # times the full wrench; no estimate beyond it makes sense


class Innovation(NamedTuple):
    """How a measurement differed from what was expected."""

    square: Array  # (N,) squared in units of its standard deviation: chi-square of as many degrees as measured values
    offset: Array  # (N, m) measured less expected
    spread: Array  # (N, m, m) covariance of the offset
    gain: Array  # (N, d, m) by which the state was moved


class Belief(Memory):
    """Means (N, d) and covariances (N, d, d) of all vehicles, float64, changed in place."""

    mean: Array
    covariance: Array

    def __init__(self, count: int, size: int):
        super().__init__()
        self.remember(mean=np.zeros((count, size)), covariance=np.zeros((count, size, size)))


class EffectivenessFilter:
    """Predict and update :class:`Belief` with the source vehicle's motion.

    Args:
        motion: the source vehicle.
        config: noise and prior.
    """

    def __init__(self, motion: SourceMotion, config: AdaptationConfig):
        self.motion, self.config, d = motion, config, motion.size
        self.thrusters = n = motion.per_share.shape[1]
        steady = 1 + bool(motion.fins.any())  # constant wrenches
        self.size = 2 * d + d * n + d * steady
        self.moving, self.velocity = slice(0, 2 * d), slice(d, 2 * d)
        self.effectiveness = slice(2 * d, 2 * d + d * n)
        self.constant = slice(2 * d + d * n, self.size)
        self._learnt = slice(2 * d, self.size)
        dt = motion.control_dt
        self.process_wrench = np.square(config.wrench_noise * motion.full_wrench)  # (d,) variance per step
        self.prior = self._prior(config.gain_spread, config.mixing_spread, config.constant_spread)
        self.drift_limit = (
            self._prior(config.drift_spread, config.drift_spread / 2, config.drift_spread / 2).diagonal().copy()
        )
        self._room = np.where(self.drift_limit > 0, self.drift_limit, 1.0)  # where no thruster pushes, nothing drifts
        self.drift = self._prior(config.gain_drift, config.gain_drift / 2, config.constant_drift).diagonal() * dt

    def _prior(self, gain: float, mixing: float, constant: float) -> Array:
        """Covariance of what is learnt, for W's diagonal and other entries and the constant wrench."""
        nominal, n, d = self.motion.per_share, self.thrusters, self.motion.size
        size = self.size - 2 * d
        covariance = np.zeros((size, size))
        outer = nominal[:, None, :] * nominal[None, :, :]  # (d, d, n)
        everything = outer.sum(-1)
        for j in range(n):
            index = np.arange(d) * n + j
            column = gain**2 * outer[..., j] + mixing**2 * (everything - outer[..., j])
            covariance[np.ix_(index, index)] = column
        end = slice(d * n, None)
        spread = np.tile(np.square(constant * self.motion.full_wrench), (size - d * n) // d)
        covariance[end, end] = np.diag(spread)
        return covariance

    def start(self, count: int) -> Belief:
        """Belief about ``count`` vehicles that are healthy as far as is known."""
        belief = Belief(count, self.size)
        self.trust(belief, np.arange(count))
        return belief

    def trust(self, belief: Belief, rows: Array) -> None:
        """Take some vehicles for the nominal one, but for a little drift."""
        self.forget(belief, rows)
        belief.covariance[rows, self._learnt, self._learnt] = np.diag(self.drift_limit)

    def place(self, belief: Belief, rows: Array, velocity: Array, spread: float) -> None:
        """Begin the motion of some vehicles anew at velocities (k, d), keeping what has been learnt.

        Displacement counts from a measured pose: its noise stays in every displacement that follows.
        """
        d = self.motion.size
        belief.mean[rows, self.moving] = 0.0
        belief.mean[rows, self.velocity] = velocity
        belief.covariance[rows, self.moving] = 0.0
        belief.covariance[rows, :, self.moving] = 0.0
        noise = np.where(self.motion.linear, self.config.position_noise, self.config.heading_noise)
        beginning = np.square(noise) if self.config.sensed == "pose" else np.full(d, 1e-12)
        variance = np.concatenate((beginning, np.full(d, spread**2)))
        index = np.arange(2 * d)
        belief.covariance[rows[:, None], index, index] = variance

    def forget(self, belief: Belief, rows: Array) -> None:
        """Go back to the nominal vehicle, without trust in it: the prior of a vehicle that has just changed."""
        belief.mean[rows, self.effectiveness] = self.motion.per_share.ravel()
        belief.mean[rows, self.constant] = 0.0
        belief.covariance[rows, self._learnt] = 0.0
        belief.covariance[rows, :, self._learnt] = 0.0
        belief.covariance[rows, self._learnt, self._learnt] = self.prior

    def map_of(self, belief: Belief) -> tuple[Array, Array]:
        """B (N, d, n) and b (N, d), at the velocities that are believed."""
        d = self.motion.size
        effectiveness = belief.mean[:, self.effectiveness].reshape(-1, d, self.thrusters)
        steady = self.motion.steady(belief.mean[:, self.velocity])
        return effectiveness, (steady[:, None] @ belief.mean[:, self.constant].reshape(len(steady), -1, d))[:, 0]

    def wrench_covariance(self, belief: Belief, weight: Array) -> Array:
        """Sum over the degrees of freedom of weight (d,) times the covariance of their rows of B, (N, n, n)."""
        n, d = self.thrusters, self.motion.size
        block = belief.covariance[:, self.effectiveness, self.effectiveness].reshape(-1, d, n, d, n)
        return np.einsum("i,bijik->bjk", weight, block)

    def predict(
        self, belief: Belief, share: Array, noise_scale: Array, body: Array | None = None
    ) -> tuple[Step, Array]:
        """One control step with thrusts (N, n), shares of full thrust; ``noise_scale`` (N,) on the process noise.

        ``body`` (N, 7) is where vehicles are that do not stay level.

        Returns:
            What the step was expected to do, and the wrench (N, d) that was expected.
        """
        d, moving, velocity = self.motion.size, self.moving, self.velocity
        mean, covariance = belief.mean, belief.covariance
        effectiveness, constant = self.map_of(belief)
        wrench = (effectiveness @ share[..., None])[..., 0] + constant
        most = _STRONGEST * self.motion.full_wrench
        wrench = np.clip(wrench, -most, most)
        np.clip(mean[:, velocity], -self.motion.fastest, self.motion.fastest, out=mean[:, velocity])
        before = mean[:, velocity].copy()
        step = self.motion(before, wrench, body)
        mean[:, :d] += step.displacement
        mean[:, velocity] = step.velocity
        count = len(mean)
        onward = np.zeros((count, 2 * d, self.size))
        onward[:, :d, :d] = np.eye(d)
        onward[:, :, velocity] = step.by_velocity
        onward[:, :, self.effectiveness] = (step.by_wrench[..., None] * share[:, None, None, :]).reshape(
            count, 2 * d, -1
        )
        steady = self.motion.steady(before)
        onward[:, :, self.constant] = (step.by_wrench[:, :, None] * steady[:, None, :, None]).reshape(count, 2 * d, -1)
        ahead = onward @ covariance  # (N, 2 d, size)
        noise = (step.by_wrench * (self.process_wrench * noise_scale[:, None])[:, None]) @ step.by_wrench.swapaxes(1, 2)
        corner = ahead @ onward.swapaxes(1, 2) + noise
        covariance[:, moving, self._learnt] = ahead[..., self._learnt]
        covariance[:, self._learnt, moving] = ahead[..., self._learnt].swapaxes(1, 2)
        covariance[:, moving, moving] = (corner + corner.swapaxes(1, 2)) / 2
        index = np.arange(2 * d, self.size)
        room = np.clip(1.0 - covariance[:, index, index] / self._room, 0.0, 1.0)
        drift = self.drift * np.where(index < self.constant.start, 1.0, noise_scale[:, None])
        covariance[:, index, index] += drift * room
        return step, wrench

    def update(self, belief: Belief, entries: Array, measured: Array, variance: Array, usable: Array) -> Innovation:
        """Take in measurements of some entries of the state; rows that are not ``usable`` keep their belief.

        Args:
            belief: changed in place.
            entries: (m,) which entries of the state were measured.
            measured: (N, m) their values; anything in rows that are not usable.
            variance: (N, m) of their noise, likewise.
            usable: (N,) bool.
        """
        mean, covariance = belief.mean, belief.covariance
        offset = np.where(usable[:, None], measured - mean[:, entries], 0.0)
        variance = np.where(usable[:, None], variance, 1.0)
        towards = covariance[:, :, entries]
        spread = covariance[:, entries[:, None], entries] + variance[:, :, None] * np.eye(len(entries))
        solved = np.linalg.solve(spread, np.concatenate((towards.swapaxes(1, 2), offset[..., None]), axis=-1))
        gain = solved[..., :-1].swapaxes(1, 2) * usable[:, None, None]
        square = (offset * solved[..., -1]).sum(-1)
        mean += (gain @ offset[..., None])[..., 0]
        covariance -= gain @ towards.swapaxes(1, 2)
        covariance += covariance.swapaxes(1, 2).copy()
        covariance *= 0.5
        return Innovation(square, offset, spread, gain)
