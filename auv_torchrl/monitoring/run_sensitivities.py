"""What every candidate would change in each run: simulated from rest, by the commands alone."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from auv_torchrl.diagnosis.identify.hypotheses import Candidate, Settings, Values, batch, declared, make_candidates
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import VELOCITY
from auv_torchrl.monitoring.runs import BIN_S, Runs
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.simulator import simulate
from auv_torchrl.vehicle import Vehicle

AT_ONCE = 4000  # vehicles that are simulated together: 200 MB
SAME_COMMAND = 0.02  # of a full command, in the mean of a second: 1 % is less than any run repeats another
LINEAR_STEP = 0.1  # of an candidate that may act by any amount: so small that the response is linear


@dataclass(frozen=True)
class RunSensitivities:
    """What each of M candidates adds to the medians of each run."""

    candidates: tuple[Candidate, ...]
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
    candidates = [candidate for tried in make_candidates(vehicle, settings) for candidate in _both_ways(tried, vehicle)]
    candidates = [candidate for candidate in candidates if comes_about(candidate, vehicle)]
    steps = [_gentle(candidate, vehicle) for candidate in candidates]
    first, stands_for = _equal_commands(runs)
    changes: list[Values] = [{candidate.effect: step} for candidate, (step, _) in zip(candidates, steps, strict=True)]
    nominal, *changed = predicted(vehicle, runs.some(first), [{}, *changes])
    shares = np.array([share for _, share in steps])
    change = (np.stack(changed) - nominal) / shares[:, None, None, None]
    usable = np.isfinite(change).all((1, 2, 3)) & (np.abs(change).max((1, 2, 3)) > 0)
    rows = np.flatnonzero(usable)
    sensitivities = RunSensitivities(tuple(candidates[i] for i in rows.tolist()), change[rows][:, stands_for])
    return predicted(vehicle, runs, [{}])[0], sensitivities


def comes_about(candidate: Candidate, vehicle: Vehicle) -> bool:
    """Whether a healthy vehicle changes so by itself: thrust is lost, not gained."""
    effect, known = EFFECTS[candidate.effect], declared(candidate.effect, vehicle)
    ways = {name: effect.trial.wears.get(known.parameters[name].name, 0) for name in candidate.values}
    return not effect.is_property and all(ways[n] * (v - known.nominal[n]) >= 0 for n, v in candidate.values.items())


def _both_ways(candidate: Candidate, vehicle: Vehicle) -> list[Candidate]:
    """A change that may act by any amount, and its opposite: a weight off the middle tilts either way."""
    if candidate.discrete or candidate.elastic:
        return [candidate]
    members, nominal, _ = declared(candidate.effect, vehicle)
    opposite = {name: 2 * nominal[name] - value for name, value in candidate.values.items()}
    inside = all(members[name].low <= value <= members[name].high for name, value in opposite.items())
    return [candidate, replace(candidate, values=opposite)] if inside else [candidate]


def _equal_commands(runs: Runs) -> tuple[np.ndarray, np.ndarray]:
    """One run for each set of commands, and (N,) which of them stands for each run."""
    by_bin = runs.commands.reshape(len(runs), runs.medians.shape[-1], -1, runs.commands.shape[-1]).mean(2)
    _, first, inverse = np.unique(
        np.round(by_bin / SAME_COMMAND).reshape(len(runs), -1), axis=0, return_index=True, return_inverse=True
    )
    return first, inverse.reshape(-1)


def _gentle(candidate: Candidate, vehicle: Vehicle) -> tuple[dict[str, float], float]:
    """The values to simulate, and which share of the candidate they are."""
    if candidate.discrete or candidate.elastic:
        return candidate.values, 1.0
    nominal = declared(candidate.effect, vehicle).nominal
    return {
        name: nominal[name] + LINEAR_STEP * (v - nominal[name]) for name, v in candidate.values.items()
    }, LINEAR_STEP
