"""What a simulator must offer so that sealed cases can be flown in it."""

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np


class Influences(NamedTuple):
    """What effects outside the library do to the vehicles during one control step; rows are vehicles."""

    thrust_factor: np.ndarray  # (rows, n) times the thrust of each thruster
    earth_force: np.ndarray  # (rows, 3) N, earth frame, at the body origin
    current: np.ndarray  # (rows, 3) m/s, added to the velocity of the water

    @staticmethod
    def none(rows: int, thrusters: int) -> "Influences":
        """No influence on any vehicle."""
        return Influences(np.ones((rows, thrusters)), np.zeros((rows, 3)), np.zeros((rows, 3)))


class Reported(NamedTuple):
    """What noiseless sensors report: the pose late, turned and scaled as it may be, the body's velocity at once."""

    pose: np.ndarray  # (rows, 6) x, y, z in m, roll, pitch, yaw in rad
    velocity: np.ndarray  # (rows, 6) body frame, m/s and rad/s


class Motion(NamedTuple):
    """True motion of some vehicles now."""

    position: np.ndarray  # (rows, 3) m, earth
    yaw: np.ndarray  # (rows,) rad
    velocity: np.ndarray  # (rows, 6) body


class Slack(NamedTuple):
    """Factors by which a vehicle differs from its model although nothing is wrong with it."""

    gain: np.ndarray  # (n,)
    linear: np.ndarray  # (4,) on the linear drag in surge, sway, heave, yaw
    quadratic: np.ndarray  # (4,) on the quadratic drag
    mass: np.ndarray  # (4,) on the inertia

    @staticmethod
    def draw(rng: np.random.Generator, size: float, thrusters: int) -> "Slack":
        """Normal factors around 1 with a standard deviation of ``size``."""
        return Slack(*(1 + size * rng.standard_normal(count) for count in (thrusters, 4, 4, 4)))


class Plant(Protocol):
    """A batch of simulated vehicles, nominal at first, one row per vehicle."""

    def loosen(self, rows: slice, slack: Slack) -> None:
        """Give some vehicles slack."""
        ...

    def change(self, rows: slice, effect: str, values: Mapping[str, float]) -> None:
        """Give some vehicles an effect of the library, before or during a flight."""
        ...

    def reset(self, position: np.ndarray, yaw: np.ndarray, velocity: np.ndarray) -> None:
        """Start at (rows, 3) m, (rows,) rad, with u, v, w, r (rows, 4) in m/s and rad/s and silent thrusters."""
        ...

    def step(self, commands: np.ndarray, influences: Influences) -> None:
        """Hold commands (rows, n) for one control step."""
        ...

    def reported(self) -> Reported:
        """What noiseless sensors report now."""
        ...

    def true_motion(self) -> Motion:
        """How the vehicles truly move now."""
        ...
