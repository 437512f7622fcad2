"""Where the gap lies: shares by degree of freedom, origin and thruster, and when it is large."""

import numpy as np

from auv_torchrl.diagnosis.identify.before_effects import Onset, blocks, force_scatter
from auv_torchrl.diagnosis.identify.paths import WindowPath
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.search import Found
from auv_torchrl.diagnosis.localize.attribute import attribute, on_grid
from auv_torchrl.diagnosis.localize.unlike import unlike_thruster
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import FEWEST_IN_REGIME, STANDS_OUT
from auv_torchrl.diagnosis.verdict import FoundEffect, Regime, Verdict, Where
from auv_torchrl.effects import EFFECTS, Origin
from auv_torchrl.physics.kinematics import rotation_matrix
from auv_torchrl.vehicle import DEGREES_OF_FREEDOM

THIRD = 1 / 3
MOST_REGIMES = 5


def locate(
    problem: Problem, found: Found, effects: tuple[FoundEffect, ...], verdict: Verdict, onset: Onset | None
) -> Where:
    """Shares of the whole gap; the part that no effect explains is attributed by :func:`attribute`."""
    size = gap_by_window(problem, found.follow)
    origin, thruster, unlike = by_origin(effects), by_thruster(problem, effects), None
    if verdict in (Verdict.PARTLY_EXPLAINED, Verdict.UNEXPLAINED):
        path = found.best.path if effects else found.follow
        known = min(sum(effect.gap_closed or 0.0 for effect in effects), 1.0)
        rest, rest_thruster = attribute(problem, path)
        stands_out = unlike_thruster(problem, path)
        unlike = stands_out if stands_out is not None and stands_out.is_most else None
        if unlike is not None:
            numbers = range(1, problem.vehicle.thrusters + 1)
            rest_thruster = {str(number): float(number == unlike.thruster) for number in numbers}
            rest = rest or {kind.value: float(kind is Origin.ACTUATION) for kind in Origin}
        origin, thruster = mixed(origin, rest, known), mixed(thruster, rest_thruster, known)
    return Where(
        dof=by_dof(problem, found.follow, size),
        origin=origin,
        thruster=thruster,
        regime=regimes(problem, found.follow, size),
        intermittence=unlike and unlike.intermittence,
        thrust_map=unlike and unlike.thrust_map,
        onset_s=onset and onset.log_s,
        onset_episode=onset and onset.episode,
        onset_in_episode_s=onset and onset.episode_s,
    )


def mixed(known: dict[str, float], rest: dict[str, float], share: float) -> dict[str, float]:
    """Shares of the explained part of the gap, which is ``share`` of it, and of the rest."""
    if not known or not rest:
        return known or rest
    return {name: share * known[name] + (1 - share) * rest[name] for name in known}


def mean_force(problem: Problem, follow: WindowPath) -> Floats:
    """(W, D) missing force over each window in units of the thrusters' reach: root mean square of means over blocks."""
    bins = follow.state.bins / problem.wide
    count, width = blocks(problem)
    kept = bins[:, : count * width]
    return np.sqrt((kept.reshape(len(bins), count, width, -1).mean(2) ** 2).mean(1))


def gap_by_window(problem: Problem, follow: WindowPath) -> Floats:
    """Size (W,) of the missing force in each window."""
    return np.sqrt((mean_force(problem, follow) ** 2).sum(1))


def by_dof(problem: Problem, follow: WindowPath, size: Floats) -> dict[str, float]:
    """Energy of the missing force of some ``size`` (W,), each degree of freedom in units of its thrusters' reach.

    Less what errors that are no white noise account for, where the log says how large they are.
    """
    known = problem.followed & np.isfinite(size)
    if not known.any():
        return {}
    energy = (mean_force(problem, follow)[known] ** 2).mean(0)
    if problem.windows.whitening is not None:
        scatter, _ = force_scatter(problem, follow)
        energy = np.maximum(energy - ((scatter / problem.wide)[known] ** 2).mean((0, 1)), 0.0)
    if not energy.any():  # nothing moves and nothing pushes
        return {}
    names = [DEGREES_OF_FREEDOM[d] for d in problem.layout.dof]
    return {name: float(e) for name, e in zip(names, energy / energy.sum(), strict=True)}


def by_origin(effects: tuple[FoundEffect, ...]) -> dict[str, float]:
    """Shares of the origins of the effects that were found, by what each closes."""
    parts = {effect.name: max(effect.gap_closed or 0.0, 1e-6) for effect in effects}
    if not parts:
        return {}
    shares = {origin.value: 0.0 for origin in Origin}
    for name, part in parts.items():
        shares[EFFECTS[name].origin.value] += part / sum(parts.values())
    return shares


def by_thruster(problem: Problem, effects: tuple[FoundEffect, ...]) -> dict[str, float]:
    """Share of each thruster in what the effects that name thrusters close."""
    share = np.zeros(problem.vehicle.thrusters)
    for effect in effects:
        for thruster in effect.thrusters:
            share[thruster - 1] += max(effect.gap_closed or 0.0, 1e-6) / len(effect.thrusters)
    return {str(i + 1): float(s) for i, s in enumerate(share / share.sum())} if share.any() else {}


def regimes(problem: Problem, follow: WindowPath, size: Floats) -> tuple[Regime, ...]:
    """Circumstances in which the gap is larger than elsewhere, the worst first."""
    known = np.isfinite(size)
    whole = float(np.sqrt((size[known] ** 2).mean())) if known.any() else np.inf
    found = []
    for when, there in circumstances(problem, follow).items():
        inside = there & known
        if inside.sum() >= FEWEST_IN_REGIME:
            ratio = float(np.sqrt((size[inside] ** 2).mean())) / whole
            if ratio > STANDS_OUT:
                found.append(Regime(when, ratio))
    return tuple(sorted(found, key=lambda regime: -regime.gap)[:MOST_REGIMES])


def circumstances(problem: Problem, follow: WindowPath) -> dict[str, np.ndarray]:
    """Windows (W,) in which something is small or large, by command size, speed, heading, place and time."""
    windows, motion = problem.windows, follow.motion
    command = np.abs(on_grid(windows, windows.commands))
    place = motion[..., :3].mean(1)
    measures = {
        "command {} {:.2f}": (command.mean((1, 2)), "below", "above"),
        "speed {} {:.2f} m/s": (np.linalg.norm(motion[..., 7:10], axis=-1).mean(1), "below", "above"),
        "yaw rate {} {:.2f} rad/s": (np.abs(motion[..., 12]).mean(1), "below", "above"),
        "{} {:.0f} s into the episode": (windows.time, "earlier than", "later than"),
    }
    for i in range(command.shape[2]):
        measures[f"command of thruster {i + 1} {{}} {{:.2f}}"] = (command[..., i].mean(1), "below", "above")
    for axis, small, large in (("x", "south of", "north of"), ("y", "west of", "east of"), ("z", "above", "below")):
        if axis in windows.channels:
            measures[f"{{}} {axis} = {{:.2f}} m"] = (place[:, "xyz".index(axis)], small, large)
    found = {}
    for text, (values, small, large) in measures.items():
        low, high = np.quantile(values, [THIRD, 1 - THIRD])
        if high > low:
            found[text.format(small, low)] = values <= low
            found[text.format(large, high)] = values >= high
    if "yaw" in windows.channels:
        ahead = rotation_matrix(motion[..., 3:7])[..., :2, 0].mean(1)
        yaw = np.arctan2(ahead[:, 1], ahead[:, 0])
        for quarter, name in enumerate(("north", "east", "south", "west")):
            away = (yaw - quarter * np.pi / 2 + np.pi) % (2 * np.pi) - np.pi
            found[f"heading {name}"] = np.abs(away) < np.pi / 4
    return found
