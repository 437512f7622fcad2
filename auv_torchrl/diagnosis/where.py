"""Where the gap lies: shares by degree of freedom, origin and thruster, and when it is large."""

import numpy as np

from auv_torchrl.diagnosis.bench import Base, Bench, Judged
from auv_torchrl.diagnosis.verdict import Where
from auv_torchrl.diagnosis.windows import Floats
from auv_torchrl.effects import EFFECTS, Origin
from auv_torchrl.vehicle import DEGREES_OF_FREEDOM

FORCE_NOISE_QUANTILE = 0.5


def locate(bench: Bench, follow: Base, best: Judged) -> Where:
    """Shares of the gap before anything is explained."""
    return Where(dof=by_dof(bench, follow), origin=by_origin(bench, best), thruster=by_thruster(bench, best))


def mean_force(bench: Bench, follow: Base) -> Floats:
    """(W, D) mean of the missing force over each window in N, N m: averaging takes the noise out."""
    return follow.state.bins.mean(1)


def by_dof(bench: Bench, follow: Base) -> dict[str, float]:
    """Energy of the missing force, each degree of freedom in units of its thrusters' reach."""
    scaled = mean_force(bench, follow) / bench.wide
    energy = (scaled**2).mean(0)
    names = [DEGREES_OF_FREEDOM[d] for d in bench.layout.dof]
    return {name: float(e) for name, e in zip(names, energy / energy.sum(), strict=True)}


def by_origin(bench: Bench, best: Judged) -> dict[str, float]:
    """Shares of the origins of the effects that were found, by what each closes."""
    parts = {effect: 1.0 for effect in best.explanation.effects}
    if not parts:
        return {}
    shares = {origin.value: 0.0 for origin in Origin}
    for effect, part in parts.items():
        shares[EFFECTS[effect].origin.value] += part / sum(parts.values())
    return shares


def by_thruster(bench: Bench, best: Judged) -> dict[str, float]:
    """Share of each thruster in the actuation effects that were found."""
    size = np.zeros(bench.vehicle.thrusters)
    for knob in best.explanation.knobs:
        if EFFECTS[knob.effect].origin is Origin.ACTUATION:
            for member in knob.members:
                tail = member.rsplit("_", 1)[-1]
                if tail.isdigit():
                    size[int(tail) - 1] += 1.0
    if not size.any():
        return {}
    return {str(i + 1): float(s) for i, s in enumerate(size / size.sum())}
