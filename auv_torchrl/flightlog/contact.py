"""Stretches in which a vehicle stood on the bottom or hung at the surface: what pushes back is not its own."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from auv_torchrl.flightlog.excitation import SHORT_S
from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.log import Episode
from auv_torchrl.flightlog.motion import BLOCK_S, blocks, rotations
from auv_torchrl.flightlog.rows import SHORTEST_ROWS
from auv_torchrl.physics import prepare
from auv_torchrl.physics.kinematics import matvec
from auv_torchrl.vehicle import Vehicle

PUSHED = 0.25  # of all vertical thrust: by how much the push of a vehicle that stands has changed, at least
STILL = 0.15  # of the speed at which that moves a sound vehicle, within which it stands; drag is not off sevenfold
MOVES = 0.5  # of that speed, which it must reach elsewhere: a vehicle with dead thrusters never does
SETTLING_S = 2.5  # over which speeds are averaged
LEAST_S = 6.0  # of standing still under pushes that change
NEAR_M = 0.3  # of the depth at which it stood: waves, slopes and what a barometer drifts by
ENDS = {1.0: "on the bottom", -1.0: "at the surface"}  # by the sense, down positive, in which it cannot go on


def leave_out_contact(episodes: tuple[Episode, ...], vehicle: Vehicle) -> tuple[tuple[Episode, ...], list[Finding]]:
    """The episodes without what was flown where depth stands still however the thrusters push, and what is said of it.

    Nothing is left out where less than 10 s would stay; then the finding limits what is concluded.
    """
    findings = []
    c = prepare(vehicle).numpy()
    reach = float((np.abs(c.allocation[2]) * c.full_thrust).sum())
    speed = _steady_speed(PUSHED * reach, float(c.linear_drag[2, 2]), float(c.quadratic_drag[2]))
    for sense, where in ENDS.items():
        stood = [_level(episode, vehicle, sense, PUSHED * reach, STILL * speed) for episode in episodes]
        levels = [level for level in stood if level is not None]
        if not levels or not _moves_elsewhere(episodes, sense, min(levels), MOVES * speed):
            continue
        kept = [part for episode in episodes for part in _beyond(episode, sense, min(levels))]
        spared = sum(part.duration for part in kept)
        total = sum(episode.duration for episode in episodes)
        enough = spared >= SHORT_S
        sentence = (
            f"the vehicle stands {where}, at {sense * (min(levels) + NEAR_M):.1f} m and beyond: depth does not change, "
            f"however it is pushed; {total - spared:.0f} of {total:.0f} s are {'left out' if enough else 'so'}"
        )
        remedy = "Fly clear of it, or look at all vertical thrusters if there is none"
        findings.append(Finding(Severity.WARNING, "contact", sentence, remedy, ("z",), limits=not enough))
        if enough:
            episodes = tuple(kept)
    if len({episode.number for episode in episodes}) < len(episodes):
        episodes = tuple(replace(episode, number=number) for number, episode in enumerate(episodes))
    return episodes, findings


def _steady_speed(force: float, linear: float, quadratic: float) -> float:
    """Speed in m/s at which drag balances a force in N."""
    if quadratic == 0:
        return force / linear if linear else np.inf
    return float((np.sqrt(linear**2 + 4 * quadratic * force) - linear) / (2 * quadratic))


def _level(episode: Episode, vehicle: Vehicle, sense: float, pushed: float, still: float) -> float | None:
    """Depth in m, times the sense, from which on an episode does not move where it is pushed; None where it does.

    ``pushed`` is the least change of push in N, ``still`` the vertical speed in m/s below which it stands.
    """
    b = blocks((episode,), vehicle)
    if len(b.length) < LEAST_S / BLOCK_S:
        return None
    c = prepare(vehicle).numpy()
    push = matvec(rotations(np.nan_to_num(b.attitude)), matvec(c.allocation, c.gain * b.thrust)[:, :3])[:, 2]
    depth = sense * np.interp(episode.t[0] + np.cumsum(b.length) - b.length / 2, episode.t, episode.pose[:, 2])
    slow = np.abs(uniform_filter1d(b.rate[:, 2], round(SETTLING_S / BLOCK_S))) < still  # it gives way where pushed more
    edges = np.flatnonzero(np.diff(np.concatenate([[0], slow, [0]])))
    level = None
    for first, behind in edges.reshape(-1, 2):
        stood = slice(first, behind)
        long = b.length[stood].sum() >= LEAST_S
        if long and np.ptp(push[stood]) > pushed and sense * push[stood].mean() > 0:
            level = min(depth[stood].min() - NEAR_M, np.inf if level is None else level)
    return level


def _moves_elsewhere(episodes: tuple[Episode, ...], sense: float, level: float, least: float) -> bool:
    """Whether the vehicle moves up or down at ``least`` m/s, for a second in all, clear of a level."""
    speeds = [
        np.abs(np.diff(e.pose[::k, 2]) / np.diff(e.t[::k]))[(sense * e.pose[::k, 2] < level)[1:]]
        for e in episodes
        if (k := max(1, round(BLOCK_S / float(np.median(np.diff(e.t)))))) < len(e)
    ]
    return bool((np.concatenate([np.zeros(1), *speeds]) > least).sum() * BLOCK_S >= 1.0)


def _beyond(episode: Episode, sense: float, level: float) -> list[Episode]:
    """What of an episode was flown clear of a level, in parts long enough to show something."""
    clear = ~(sense * episode.pose[:, 2] >= level)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], clear, [0]])))
    parts = [episode.rows(first, behind) for first, behind in edges.reshape(-1, 2)]
    return [part for part in parts if len(part) >= SHORTEST_ROWS and part.duration >= SHORT_S]
