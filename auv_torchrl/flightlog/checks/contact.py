"""Stretches in which a vehicle stood on the bottom or hung at the surface: what pushes back is not its own."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from auv_torchrl.flightlog.checks.excitation import SHORT_S
from auv_torchrl.flightlog.checks.motion import BLOCK_S, blocks, rotations
from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.log import Episode, Floats
from auv_torchrl.flightlog.signals import rolling_mean, runs
from auv_torchrl.flightlog.tables.rows import SHORTEST_ROWS
from auv_torchrl.physics import prepare
from auv_torchrl.physics.kinematics import matvec
from auv_torchrl.vehicle import Vehicle

PUSHED = 0.25  # of all vertical thrust: by how much the push of a vehicle that stands has changed, at least
STILL = 0.15  # of the speed at which that moves a sound vehicle, within which it stands; drag is not off sevenfold
MOVES = 0.5  # of that speed, which it must reach elsewhere: a vehicle with dead thrusters never does
ALL_STILL = 0.9  # of the time beyond the depth at which it stands, which it lands on and leaves
SETTLING_S = 2.5  # over which speeds are averaged
LEAST_S = 6.0  # of standing still under pushes that change
NEAR_M = 0.3  # of the depth at which it stood: waves, slopes and what a barometer drifts by
ENDS = {1.0: "on the bottom", -1.0: "at the surface"}  # by the sense, down positive, in which it cannot go on


def leave_out_contact(episodes: tuple[Episode, ...], vehicle: Vehicle) -> tuple[tuple[Episode, ...], list[Finding]]:
    """The episodes without what was flown where depth stands still however the thrusters push, and what is said of it.

    Nothing is left out where less than 10 s would stay; then the finding limits what is concluded. Nor is the surface
    where the vehicle's file says where that lies: the simulator floats, too.
    """
    findings = []
    c = prepare(vehicle).numpy()
    reach = float((np.abs(c.allocation[2]) * c.full_thrust).sum())
    speed = _steady_speed(PUSHED * reach, float(c.linear_drag[2, 2]), float(c.quadratic_drag[2]))
    for sense, where in ENDS.items():
        if sense < 0 and bool((vehicle.air > 0).any()):
            continue
        level = _level([_Flown.of(episode, vehicle, sense) for episode in episodes], PUSHED * reach, speed)
        if level is None:
            continue
        kept = [part for episode in episodes for part in _clear(episode, sense, level - NEAR_M)]
        spared = sum(part.duration for part in kept)
        total = sum(episode.duration for episode in episodes)
        enough = spared >= SHORT_S
        sentence = (
            f"the vehicle stands {where}, at {sense * level:.1f} m and beyond: depth does not change, however it is "
            f"pushed; {total - spared:.0f} of {total:.0f} s are {'left out' if enough else 'so'}"
        )
        remedy = "Fly clear of it, or look at all vertical thrusters if there is none"
        findings.append(Finding(Severity.WARNING, "contact", sentence, remedy, ("z",), limits=not enough))
        if enough:
            episodes = tuple(kept)
    if len({episode.number for episode in episodes}) < len(episodes):
        episodes = tuple(replace(episode, number=number) for number, episode in enumerate(episodes))
    return episodes, findings


class _Flown(NamedTuple):
    """Means of an episode over SETTLING_S, one per block of it; positive in the sense that is looked at."""

    depth: Floats  # (B,) m
    speed: Floats  # (B,) m/s, up or down
    push: Floats  # (B,) N, of the thrusters

    @staticmethod
    def of(episode: Episode, vehicle: Vehicle, sense: float) -> "_Flown":
        b = blocks((episode,), vehicle)
        if not len(b.length):
            return _Flown(*(np.empty(0) for _ in range(3)))
        c = prepare(vehicle).numpy()
        push = matvec(rotations(np.nan_to_num(b.attitude)), matvec(c.allocation, c.gain * b.thrust)[:, :3])[:, 2]
        middle = episode.t[0] + np.cumsum(b.length) - b.length / 2
        depth = np.interp(middle, episode.t, episode.pose[:, 2])
        speed, push = (rolling_mean(values, round(SETTLING_S / BLOCK_S)) for values in (b.rate[:, 2], push))
        return _Flown(sense * depth, np.abs(speed), sense * push)


def _level(flown: list[_Flown], pushed: float, speed: float) -> float | None:
    """Depth in m, in the sense looked at, at which a vehicle does not go on; None where it stands nowhere.

    ``pushed`` is the least change of push in N, ``speed`` the one in m/s at which that moves a sound vehicle, as its
    file says. What is still beside a vehicle that flies faster than that is told by its own flight: it bounces faster,
    too.
    """
    levels = []
    for part in flown:
        for first, behind in runs(part.speed < STILL * speed):
            push = part.push[first:behind]
            if len(push) * BLOCK_S >= LEAST_S and np.ptp(push) > pushed and push.mean() > pushed / 2:
                levels.append(part.depth[first:behind].min())
    if not levels:
        return None
    level = min(levels)
    depth, moving, push = (np.concatenate(field) for field in zip(*flown, strict=True))
    clear = depth < level - NEAR_M
    asked = clear & (np.abs(push) > pushed)
    own = float(np.median(moving[asked])) if asked.any() else 0.0
    there = moving[depth >= level] < STILL * max(speed, own)
    elsewhere = moving[clear] > MOVES * speed
    return level if there.mean() > ALL_STILL and elsewhere.sum() * BLOCK_S >= 1.0 else None


def _steady_speed(force: float, linear: float, quadratic: float) -> float:
    """Speed in m/s at which drag balances a force in N."""
    if quadratic == 0:
        return force / linear if linear else np.inf
    return float((np.sqrt(linear**2 + 4 * quadratic * force) - linear) / (2 * quadratic))


def _clear(episode: Episode, sense: float, level: float) -> list[Episode]:
    """What of an episode was flown clear of a level, in parts long enough to show something."""
    parts = [episode.rows(first, behind) for first, behind in runs(~(sense * episode.pose[:, 2] >= level))]
    return [part for part in parts if len(part) >= SHORTEST_ROWS and part.duration >= SHORT_S]
