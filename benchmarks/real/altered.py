"""Sound flights as faulty vehicles would have logged them: the log is changed, the motion is what the firmware flew.

A vehicle whose plugs of motors 2 and 3 are exchanged moves by the command of 3 where its log has that of 2. So a log
with two columns exchanged is that of such a vehicle, flown by a pilot who does not mind. Likewise a thruster that turns
the wrong way or is weak, and a current, which carries a flight along. No sound flight shows a dead thruster or ballast.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from auv_torchrl.flightlog import FlightLog
from auv_torchrl.flightlog.log import Episode, Floats, with_axes

Change = Callable[[FlightLog], FlightLog]
FULL = 1.001  # of full command, with rounding
HORIZONTAL = ("x", "y")  # what dives without a position sensor lack


def exchanged(first: int, second: int, start_s: float = 0.0) -> Change:
    """The plugs of two motors, counted from 1, are exchanged from ``start_s`` on."""
    order = {first - 1: second - 1, second - 1: first - 1}
    return _recommanded(lambda c: c[..., [order.get(k, k) for k in range(c.shape[-1])]], start_s)


def multiplied(thruster: int, gain: float, start_s: float = 0.0) -> Change:
    """A thruster, counted from 1, gives ``gain`` times its thrust from ``start_s`` on.

    The log then has the larger command with which such a thruster would have pushed as the sound one did, thrust being
    as the command squared; only the dead band does not grow with it.

    Raises:
        ValueError: where that is above full command, when the log is changed.
    """

    def larger(commands: Floats) -> Floats:
        factors = np.ones(commands.shape[-1])
        factors[thruster - 1] = np.sign(gain) / np.sqrt(abs(gain))
        if (largest := np.abs(commands * factors).max()) > FULL:
            raise ValueError(
                f"thruster {thruster} was commanded so much that with {gain} it takes {largest:.2f}: take less"
            )
        return commands * factors

    return _recommanded(larger, start_s)


def carried(north: float, east: float) -> Change:
    """Positions as in water that moves by so many m/s, which nothing else here tells.

    Raises:
        ValueError: for a log of velocities, which would change too.
    """

    def along(episode: Episode) -> Episode:
        if np.isfinite(episode.velocity[:, :3]).any():
            raise ValueError("a flight with velocities is not carried: give one of positions alone")
        pose = episode.pose.copy()
        pose[:, 0] += north * episode.t
        pose[:, 1] += east * episode.t
        return replace(episode, pose=pose)

    return lambda log: replace(log, episodes=tuple(along(episode) for episode in log.episodes))


def without_position(log: FlightLog) -> FlightLog:
    """The log of a vehicle that has no position sensor."""
    axes = tuple(axis for axis in log.axes if axis not in HORIZONTAL)
    return replace(log, axes=axes, episodes=tuple(with_axes(episode, axes) for episode in log.episodes))


def _recommanded(change: Callable[[Floats], Floats], start_s: float) -> Change:
    def of(episode: Episode) -> Episode:
        late = episode.t >= start_s
        commands = np.where(late[:, None], change(episode.commands), episode.commands)
        parts = episode.parts
        if parts is not None:
            parts = np.where(late[:, None, None], change(parts), parts)
        return replace(episode, commands=commands, parts=parts)

    return lambda log: replace(log, episodes=tuple(of(episode) for episode in log.episodes))
