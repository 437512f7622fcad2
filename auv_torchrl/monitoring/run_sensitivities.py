"""What every candidate would change in each run: simulated from rest, by the commands alone."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from auv_torchrl.diagnosis.identify.declared import declared
from auv_torchrl.diagnosis.identify.hypotheses import Atom, Settings, Values, batch, make_atoms
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import VELOCITY
from auv_torchrl.monitoring.runs import BIN_S, Runs
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.simulator import simulate
from auv_torchrl.vehicle import Vehicle

AT_ONCE = 4000  # vehicles that are simulated together: 200 MB
SAME_COMMAND = 0.02  # of a full command, in the mean of a second: 1 % is less than any run repeats another
LINEAR_STEP = 0.1  # of an atom that may act by any amount: so small that the response is linear


@dataclass(frozen=True)
class RunSensitivities:
    """What each of M candidates adds to the medians of each run."""

    atoms: tuple[Atom, ...]
    change: Floats  # (M, N, C, B)


def predicted(vehicle: Vehicle, runs: Runs, changes: Sequence[Values]) -> Floats:
    """What would be seen (M, N, C, B) of a vehicle with each of M changes; NaN from where it has diverged."""
    per_bin, steps = round(BIN_S / CONTROL_DT), runs.commands.shape[1]
    found = np.empty((len(changes), len(runs), len(runs.channels), runs.medians.shape[-1]))
    for some in _together(changes, max(1, AT_ONCE // len(runs))):
        vehicles = batch(vehicle, [values for values in changes[some] for _ in range(len(runs))])
        commands = np.tile(runs.commands, (len(changes[some]), 1, 1))
        reported = simulate(vehicles, commands, np.arange(steps + 1) * CONTROL_DT).reported
        columns = {"z": reported.position[..., 2]}
        columns |= {name: reported.velocity[..., place] for place, name in enumerate(VELOCITY)}
        shown = np.stack([columns[name][:, :steps] for name in runs.channels], axis=1)
        shown = shown.reshape(-1, len(runs), len(runs.channels), found.shape[-1], per_bin)
        found[some] = np.median(shown, axis=-1)
    return found


def _together(changes: Sequence[Values], most: int) -> Iterator[slice]:
    """Changes by the same effects, which leave the rest of a vehicle as it is: a tether that it has stays."""
    first = 0
    for _, own in groupby(changes, key=tuple):
        behind = first + len(list(own))
        for begin in range(first, behind, most):
            yield slice(begin, min(begin + most, behind))
        first = behind


def run_sensitivities(vehicle: Vehicle, runs: Runs, settings: Settings) -> tuple[Floats, RunSensitivities]:
    """What would be seen (N, C, B) of the vehicle as its file says, and the sensitivities of all candidates.

    Runs whose commands hardly differ share their sensitivities.
    """
    atoms = [atom for tried in make_atoms(vehicle, settings) for atom in _both_ways(tried, vehicle)]
    atoms = [atom for atom in atoms if comes_about(atom, vehicle)]
    steps = [_gentle(atom, vehicle) for atom in atoms]
    first, stands_for = _equal_commands(runs)
    changes: list[Values] = [{atom.effect: step} for atom, (step, _) in zip(atoms, steps, strict=True)]
    nominal, *changed = predicted(vehicle, runs.some(first), [{}, *changes])
    shares = np.array([share for _, share in steps])
    change = (np.stack(changed) - nominal) / shares[:, None, None, None]
    usable = np.isfinite(change).all((1, 2, 3)) & (np.abs(change).max((1, 2, 3)) > 0)
    rows = np.flatnonzero(usable)
    sensitivities = RunSensitivities(tuple(atoms[i] for i in rows.tolist()), change[rows][:, stands_for])
    return predicted(vehicle, runs, [{}])[0], sensitivities


def comes_about(atom: Atom, vehicle: Vehicle) -> bool:
    """Whether a healthy vehicle changes so by itself: thrust is lost, not gained."""
    effect, known = EFFECTS[atom.effect], declared(atom.effect, vehicle)
    ways = {name: effect.wears.get(known.parameters[name].name, 0) for name in atom.values}
    return not effect.is_property and all(ways[n] * (v - known.nominal[n]) >= 0 for n, v in atom.values.items())


def _both_ways(atom: Atom, vehicle: Vehicle) -> list[Atom]:
    """A change that may act by any amount, and its opposite: a weight off the middle tilts either way."""
    if atom.discrete or atom.elastic:
        return [atom]
    members, nominal, _ = declared(atom.effect, vehicle)
    opposite = {name: 2 * nominal[name] - value for name, value in atom.values.items()}
    inside = all(members[name].low <= value <= members[name].high for name, value in opposite.items())
    return [atom, replace(atom, values=opposite)] if inside else [atom]


def _equal_commands(runs: Runs) -> tuple[np.ndarray, np.ndarray]:
    """One run for each set of commands, and (N,) which of them stands for each run."""
    by_bin = runs.commands.reshape(len(runs), runs.medians.shape[-1], -1, runs.commands.shape[-1]).mean(2)
    _, first, inverse = np.unique(
        np.round(by_bin / SAME_COMMAND).reshape(len(runs), -1), axis=0, return_index=True, return_inverse=True
    )
    return first, inverse.reshape(-1)


def _gentle(atom: Atom, vehicle: Vehicle) -> tuple[dict[str, float], float]:
    """The values to simulate, and which share of the atom they are."""
    if atom.discrete or atom.elastic:
        return atom.values, 1.0
    nominal = declared(atom.effect, vehicle).nominal
    return {name: nominal[name] + LINEAR_STEP * (v - nominal[name]) for name, v in atom.values.items()}, LINEAR_STEP
