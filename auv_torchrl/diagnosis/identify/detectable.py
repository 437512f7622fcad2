"""The smallest size of each effect that this log could have shown."""

import numpy as np

from auv_torchrl.diagnosis.identify.declared import declared
from auv_torchrl.diagnosis.identify.screen import Field
from auv_torchrl.diagnosis.thresholds import SHOWS
from auv_torchrl.diagnosis.verdict import Estimate


def detectable_sizes(field: Field) -> dict[str, Estimate]:
    """By effect, the parameter that shows best; ``low`` and ``high`` are the sizes in either direction."""
    found: dict[str, tuple[float, Estimate]] = {}
    for i, atom in enumerate(field.problem.atoms):
        if atom.discrete or not field.seen[i]:
            continue
        name = field.moved_most(atom)
        p = declared(atom.effect, field.problem.vehicle).parameters[name]
        nominal = declared(atom.effect, field.problem.vehicle).nominal[name]
        share = np.sqrt(SHOWS / field.A[i, i])
        size = abs(atom.values[name] - nominal) * share
        relative = size / (p.high - p.low)
        if atom.effect not in found or relative < found[atom.effect][0]:
            value = nominal + size if nominal + size <= p.high else nominal - size
            low, high = max(p.low, nominal - size), min(p.high, nominal + size)
            found[atom.effect] = relative, Estimate(value, low, high, nominal, p.unit)
    return {effect: estimate for effect, (_, estimate) in found.items()}
