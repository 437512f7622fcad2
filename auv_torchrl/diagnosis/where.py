"""Where the gap lies: shares by degree of freedom, origin and thruster, and when it is large."""

import numpy as np

from auv_torchrl.diagnosis.bench import Base, Bench
from auv_torchrl.diagnosis.verdict import FoundEffect, Regime, Where
from auv_torchrl.diagnosis.windows import Floats
from auv_torchrl.effects import EFFECTS, Origin
from auv_torchrl.vehicle import DEGREES_OF_FREEDOM

STANDS_OUT = 1.3  # gap in a regime, in gaps of the whole log
THIRD = 1 / 3
CHANGES = 3.0  # gap behind an onset, in gaps before it
LEAST = 6  # windows on either side of an onset


def locate(bench: Bench, follow: Base, effects: tuple[FoundEffect, ...]) -> Where:
    """Shares of the gap before anything is explained."""
    size = gap_by_window(bench, follow)
    return Where(
        dof=by_dof(bench, follow),
        origin=by_origin(effects),
        thruster=by_thruster(bench, effects),
        regime=regimes(bench, follow, size),
        onset_s=onset(bench, size),
    )


def mean_force(bench: Bench, follow: Base) -> Floats:
    """(W, D) missing force over each window in units of the thrusters' reach: root mean square of means over 0.6 s."""
    bins = follow.state.bins / bench.wide
    width = max(1, round(0.6 / (bench.layout.steps_per_bin * bench.windows.dt)))
    kept = bins[:, : bins.shape[1] // width * width]
    return np.sqrt((kept.reshape(len(bins), -1, width, bins.shape[2]).mean(2) ** 2).mean(1))


def gap_by_window(bench: Bench, follow: Base) -> Floats:
    """Size (W,) of the missing force in each window."""
    return np.sqrt((mean_force(bench, follow) ** 2).sum(1))


def by_dof(bench: Bench, follow: Base) -> dict[str, float]:
    """Energy of the missing force, each degree of freedom in units of its thrusters' reach."""
    energy = (mean_force(bench, follow)[bench.followed] ** 2).mean(0)
    names = [DEGREES_OF_FREEDOM[d] for d in bench.layout.dof]
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


def by_thruster(bench: Bench, effects: tuple[FoundEffect, ...]) -> dict[str, float]:
    """Share of each thruster in what the effects that name thrusters close."""
    share = np.zeros(bench.vehicle.thrusters)
    for effect in effects:
        for thruster in effect.thrusters:
            share[thruster - 1] += max(effect.gap_closed or 0.0, 1e-6) / len(effect.thrusters)
    return {str(i + 1): float(s) for i, s in enumerate(share / share.sum())} if share.any() else {}


def regimes(bench: Bench, follow: Base, size: Floats) -> tuple[Regime, ...]:
    """Circumstances in which the gap is larger than elsewhere, the worst first."""
    windows, motion = bench.windows, follow.motion
    whole = float(np.sqrt((size**2).mean()))
    grid = np.minimum(windows.start[:, None] + np.arange(windows.steps), windows.commands.shape[1] - 1)
    command = np.abs(windows.commands[windows.episode[:, None], grid]).mean((1, 2))
    speed = np.linalg.norm(motion[..., 7:10], axis=-1).mean(1)
    measures = {
        "command {} {:.2f}": command,
        "speed {} {:.2f} m/s": speed,
        "yaw rate {} {:.2f} rad/s": np.abs(motion[..., 12]).mean(1),
        "{} {:.0f} s into the episode": windows.time,
    }
    if "z" in windows.channels:
        measures["depth {} {:.2f} m"] = motion[..., 2].mean(1)
    found = []
    for text, values in measures.items():
        low, high = np.quantile(values, [THIRD, 1 - THIRD])
        sides = (("below", low, values <= low), ("above", high, values >= high))
        if text.startswith("{}"):
            sides = (("earlier than", low, values <= low), ("later than", high, values >= high))
        for word, edge, inside in sides:
            ratio = float(np.sqrt((size[inside] ** 2).mean())) / whole
            if ratio > STANDS_OUT:
                found.append(Regime(text.format(word, edge), ratio))
    return tuple(sorted(found, key=lambda regime: -regime.gap))


def onset(bench: Bench, size: Floats) -> float | None:
    """Seconds into the log at which the gap sets in, where it is small before and large behind one moment."""
    windows = bench.windows
    order = np.lexsort((windows.start, windows.episode))
    energy = size[order] ** 2
    if len(energy) < 2 * LEAST:
        return None
    splits = np.arange(LEAST, len(energy) - LEAST)
    before = np.array([energy[:k].mean() for k in splits])
    after = np.array([energy[k:].mean() for k in splits])
    k = int(np.argmin(splits * np.log(before) + (len(energy) - splits) * np.log(after)))
    quiet, loud = np.quantile(energy[: splits[k]], 0.9), np.quantile(energy[splits[k] :], 0.1)
    if after[k] < CHANGES**2 * before[k] or loud < quiet:
        return None
    first = order[splits[k]]
    behind = sum(windows.time[windows.episode == e].max() for e in range(windows.episode[first]))
    return float(behind + windows.time[first])
