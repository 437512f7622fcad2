"""What is said of runs that were flown alike."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.alike.evidence import NONE, VIBRATION, Weighed
from auv_torchrl.diagnosis.alike.marks import Marks
from auv_torchrl.diagnosis.alike.shakes import BAND_HZ, Line
from auv_torchrl.diagnosis.thresholds import Z95
from auv_torchrl.diagnosis.verdict import Estimate, Verdict, how_sure
from auv_torchrl.effects import EFFECTS
from auv_torchrl.vehicle import Vehicle

STRANGE = 1e-3  # probability below which no explanation fits a run
AS_WELL = 0.2  # of the probability of the likeliest: effects, and thrusters, that these runs do not tell from it


@dataclass(frozen=True)
class Cause:
    """An effect that these runs may show, or a vibration."""

    name: str
    probability: float
    parameters: dict[str, Estimate]  # of its likeliest change
    instead: tuple[tuple[str, ...], ...]  # parameters that would show the same: one of thrusters 1 to 4
    sentence: str


@dataclass(frozen=True)
class Answer:
    """One run, or several that have the same fault."""

    runs: tuple[str, ...]
    verdict: Verdict
    none: float  # probability that nothing differs from the sound runs
    causes: tuple[Cause, ...]  # the likeliest, and those that look the same; none where there is no gap
    strange: float  # probability that the best explanation leaves so much by chance

    @property
    def sentence(self) -> str:
        """For a pilot."""
        if self.verdict is Verdict.NO_GAP:
            return f"as the sound runs are (p {self.none:.2f})"
        if self.verdict is Verdict.UNEXPLAINED:
            return "unlike the sound runs, and nothing in the library explains it"
        also = ", and something else that is not known" if self.verdict is Verdict.PARTLY_EXPLAINED else ""
        return ", or ".join(how_sure(cause.sentence, cause.probability) for cause in self.causes) + also


def answers(
    weighed: Weighed, marks: Marks, vehicle: Vehicle, groups: Sequence[np.ndarray], names: Sequence[str]
) -> tuple[Answer, ...]:
    """One answer for each group of runs."""
    found = []
    for g, rows in enumerate(groups):
        none = float(weighed.probability[g, 0])
        verdict = Verdict.NO_GAP if none > 0.5 else Verdict.EXPLAINED
        if weighed.strange[g] < STRANGE:  # which a line in a spectrum stands beside
            shakes = weighed.names[int(weighed.probability[g].argmax())] == VIBRATION
            verdict = Verdict.PARTLY_EXPLAINED if shakes else Verdict.UNEXPLAINED
        named = verdict in (Verdict.EXPLAINED, Verdict.PARTLY_EXPLAINED)
        causes = _causes(weighed, g, marks, vehicle) if named else ()
        found.append(
            Answer(tuple(str(names[row]) for row in rows.tolist()), verdict, none, causes, float(weighed.strange[g]))
        )
    return tuple(found)


def _causes(weighed: Weighed, g: int, marks: Marks, vehicle: Vehicle) -> tuple[Cause, ...]:
    order = [int(e) for e in np.argsort(-weighed.probability[g]) if weighed.names[e] != NONE]
    likeliest = weighed.probability[g, order[0]]
    return tuple(
        _vibration(weighed.lines[g], float(weighed.probability[g, e]))
        if weighed.names[e] == VIBRATION
        else _cause(weighed, g, e, marks, vehicle)
        for e in order
        if weighed.probability[g, e] > AS_WELL * likeliest
    )


def _vibration(line: Line | None, probability: float) -> Cause:
    assert line is not None, "without a spectrum no vibration is likely"
    louder = Estimate(*line.louder, 1.0, "1")
    sentence = (
        f"it shakes at {line.frequency:.1f} Hz in {line.channel}, {louder.value:.1f} times as much as sound runs do: a "
        "propeller may be cut, bent or fouled"
    )
    frequency = Estimate(line.frequency, line.frequency - BAND_HZ / 2, line.frequency + BAND_HZ / 2, 0.0, "Hz")
    return Cause(VIBRATION, probability, {"louder": louder, "frequency": frequency}, (), sentence)


def _cause(weighed: Weighed, g: int, e: int, marks: Marks, vehicle: Vehicle) -> Cause:
    name, share = weighed.names[e], weighed.share[g]
    effect, nominal = EFFECTS[name], EFFECTS[name].nominal(vehicle)
    likely = [
        i
        for i, other in enumerate(marks.atoms)
        if other.effect == name and share[i] > AS_WELL * share[weighed.best[g, e]]
    ]
    fewest = min(len(marks.atoms[i].values) for i in likely)  # one thruster rather than all of them
    likely = sorted((i for i in likely if len(marks.atoms[i].values) == fewest), key=lambda i: -share[i])
    best = likely[0]
    atom, declared = marks.atoms[best], effect.member_parameters(vehicle)
    amount, half = weighed.amount[g, best], Z95 * weighed.unsure[g, best]
    parameters, said = {}, []
    for member, value in atom.values.items():
        p, step = declared[member], value - nominal[member]
        at = [float(np.clip(nominal[member] + a * step, p.low, p.high)) for a in (amount, amount - half, amount + half)]
        parameters[member] = Estimate(at[0], min(at[1:]), max(at[1:]), nominal[member], p.unit)
        if step:
            said.append(p.said(member, at[0]))
    instead = dict.fromkeys(tuple(marks.atoms[i].values) for i in likely)
    instead.pop(tuple(atom.values))
    sentence = "; ".join(said)
    if instead:
        sentence += f" (or {', '.join(' and '.join(members) for members in instead)}: these runs show the same of it)"
    return Cause(name, float(weighed.probability[g, e]), parameters, tuple(instead), sentence)
