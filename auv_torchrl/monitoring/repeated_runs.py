"""Compare repeated runs of one manoeuvre with healthy ones: from logs to the report, ``alike.json`` and the console."""

import logging
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from omegaconf import DictConfig
from threadpoolctl import threadpool_limits

from auv_torchrl.command import Run, checking_input
from auv_torchrl.diagnosis.command.request import read_request
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.plain import plain, write_json
from auv_torchrl.diagnosis.thresholds import Z95
from auv_torchrl.diagnosis.verdict import Estimate, Verdict, how_sure
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import FlightLog, FlightLogError
from auv_torchrl.monitoring.healthy_runs import RunDistribution, learn_distribution
from auv_torchrl.monitoring.run_evidence import NONE, VIBRATION, RunData, RunEvidence, weigh_effects
from auv_torchrl.monitoring.run_sensitivities import RunSensitivities, predicted, run_sensitivities
from auv_torchrl.monitoring.runs import BIN_S, Runs, cut_runs
from auv_torchrl.monitoring.vibration import BAND_HZ, HealthySpectrum, SpectralLine, find_lines, learn_spectrum
from auv_torchrl.progress import Progress
from auv_torchrl.quantities import counted, words
from auv_torchrl.vehicle import Vehicle

log = logging.getLogger("diagnose")
VERSION = 1  # of alike.json
SHOWN = 30  # lines of single runs on the console; all are in the file
STRANGE = 1e-3  # probability below which no explanation fits a run
INDISTINGUISHABLE = (
    0.2  # of the probability of the likeliest: effects, and thrusters, that these runs do not tell apart
)


@dataclass(frozen=True)
class Cause:
    """An effect that these runs may show, or a vibration."""

    name: str
    probability: float
    parameters: dict[str, Estimate]  # of its likeliest change
    instead: tuple[tuple[str, ...], ...]  # parameters that would show the same: one of thrusters 1 to 4
    sentence: str


@dataclass(frozen=True)
class RunReport:
    """The verdict about one run, or about several that have the same fault."""

    runs: tuple[str, ...]
    verdict: Verdict
    none: float  # probability that nothing differs from the healthy runs
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


@dataclass(frozen=True)
class RunComparison:
    """The whole report: each run by itself, and all runs together."""

    vehicle: str
    healthy: int  # runs that the others are compared with
    channels: tuple[str, ...]
    seconds: float  # of each run
    session: float  # variance between logs, times that between runs of one
    runs: tuple[RunReport, ...]
    together: RunReport  # of all runs, taken to have the same fault
    cannot_tell: tuple[str, ...]  # effects that would not show in these runs
    left_out: tuple[str, ...]  # too short, or with a second without samples


@dataclass(frozen=True)
class HealthyRuns:
    """The healthy runs, their distribution and their spectra."""

    runs: Runs
    distribution: RunDistribution
    spectrum: HealthySpectrum | None  # None where no rate is measured


def learn_healthy_runs(healthy: Sequence[FlightLog], vehicle: Vehicle) -> HealthyRuns:
    """What healthy runs look like; each log is a session, each episode a run.

    Raises:
        FlightLogError: for runs that are too few, too short, or measure nothing that is compared.
    """
    runs = cut_runs(healthy)
    return HealthyRuns(runs, learn_distribution(runs, predicted(vehicle, runs, [{}])[0]), learn_spectrum(runs))


def compare_runs(
    logs: Sequence[FlightLog], healthy: HealthyRuns, vehicle: Vehicle, settings: Settings, vehicle_name: str = ""
) -> RunComparison:
    """What differs in runs from healthy ones, in each by itself and in all together.

    Args:
        logs: whose episodes are the runs.
        healthy: of the same manoeuvre.
        vehicle: as its file says, empty batch; it gives the sensitivities, while the error of its file about the
            healthy runs is in their mean.
        settings: ``prior_none``, and which effects are candidates.
        vehicle_name: for the report.

    Raises:
        FlightLogError: for runs of another kind than the healthy ones.
    """
    runs = cut_runs(logs, healthy.runs)
    nominal, sensitivities = run_sensitivities(vehicle, runs, settings)
    groups = [np.array([row]) for row in range(len(runs))] + [np.arange(len(runs))]
    data = RunData(nominal, runs, find_lines(runs, healthy.spectrum, groups))
    evidence = weigh_effects(data, sensitivities, healthy.distribution, vehicle, settings, groups)
    *single, together = run_reports(evidence, sensitivities, vehicle, groups, runs.names)
    return RunComparison(
        vehicle_name,
        healthy.distribution.count,
        runs.channels,
        runs.medians.shape[-1] * BIN_S,
        healthy.distribution.session,
        tuple(single),
        together,
        evidence.hidden,
        healthy.runs.left_out + runs.left_out,
    )


def run_reports(
    evidence: RunEvidence,
    sensitivities: RunSensitivities,
    vehicle: Vehicle,
    groups: Sequence[np.ndarray],
    names: Sequence[str],
) -> tuple[RunReport, ...]:
    """One report for each group of runs."""
    reports = []
    for g, rows in enumerate(groups):
        none = float(evidence.probability[g, 0])
        verdict = Verdict.NO_GAP if none > 0.5 else Verdict.EXPLAINED
        if evidence.strange[g] < STRANGE:  # a line in a spectrum stands beside the unknown
            vibrates = evidence.names[int(evidence.probability[g].argmax())] == VIBRATION
            verdict = Verdict.PARTLY_EXPLAINED if vibrates else Verdict.UNEXPLAINED
        named = verdict in (Verdict.EXPLAINED, Verdict.PARTLY_EXPLAINED)
        causes = _causes(evidence, g, sensitivities, vehicle) if named else ()
        own = tuple(str(names[row]) for row in rows.tolist())
        reports.append(RunReport(own, verdict, none, causes, float(evidence.strange[g])))
    return tuple(reports)


def _causes(evidence: RunEvidence, g: int, sensitivities: RunSensitivities, vehicle: Vehicle) -> tuple[Cause, ...]:
    order = [int(e) for e in np.argsort(-evidence.probability[g]) if evidence.names[e] != NONE]
    likeliest = evidence.probability[g, order[0]]
    return tuple(
        _vibration(evidence.lines[g], float(evidence.probability[g, e]))
        if evidence.names[e] == VIBRATION
        else _cause(evidence, g, e, sensitivities, vehicle)
        for e in order
        if evidence.probability[g, e] > INDISTINGUISHABLE * likeliest
    )


def _vibration(line: SpectralLine | None, probability: float) -> Cause:
    assert line is not None, "without a spectrum no vibration is likely"
    louder = Estimate(*line.louder, 1.0, "1")
    sentence = (
        f"it shakes at {line.frequency:.1f} Hz in {line.channel}, {louder.value:.1f} times as much as sound runs do: a "
        "propeller may be cut, bent or fouled"
    )
    frequency = Estimate(line.frequency, line.frequency - BAND_HZ / 2, line.frequency + BAND_HZ / 2, 0.0, "Hz")
    return Cause(VIBRATION, probability, {"louder": louder, "frequency": frequency}, (), sentence)


def _cause(evidence: RunEvidence, g: int, e: int, sensitivities: RunSensitivities, vehicle: Vehicle) -> Cause:
    name, share, candidates = evidence.names[e], evidence.share[g], sensitivities.candidates
    effect, nominal = EFFECTS[name], EFFECTS[name].nominal(vehicle)
    least = INDISTINGUISHABLE * share[evidence.best[g, e]]
    likely = [i for i, candidate in enumerate(candidates) if candidate.effect == name and share[i] > least]
    fewest = min(len(candidates[i].values) for i in likely)  # one thruster rather than all of them
    likely = sorted((i for i in likely if len(candidates[i].values) == fewest), key=lambda i: -share[i])
    best = likely[0]
    candidate, declared = candidates[best], effect.member_parameters(vehicle)
    amount, half = evidence.amount[g, best], Z95 * evidence.deviation[g, best]
    parameters, clauses = {}, []
    for member, value in candidate.values.items():
        p, step = declared[member], value - nominal[member]
        at = [float(np.clip(nominal[member] + a * step, p.low, p.high)) for a in (amount, amount - half, amount + half)]
        parameters[member] = Estimate(at[0], min(at[1:]), max(at[1:]), nominal[member], p.unit)
        if step:
            clauses.append(p.sentence_of(member, at[0]))
    instead = dict.fromkeys(tuple(candidates[i].values) for i in likely)
    instead.pop(tuple(candidate.values))
    sentence = "; ".join(clauses)
    if instead:
        sentence += f" (or {', '.join(' and '.join(members) for members in instead)}: these runs show the same of it)"
    return Cause(name, float(evidence.probability[g, e]), parameters, tuple(instead), sentence)


def answer_runs(config: DictConfig, run: Run) -> None:
    """Read the runs, compare them with the healthy ones, print the report, write the file."""
    with checking_input():
        if config.test:
            raise ValueError("test=... goes with one log: leave it out")
        request = read_request(config)
    with checking_input((FlightLogError,)), Progress() as progress, threadpool_limits(1):
        progress("what sound runs look like", 0.1)
        healthy = learn_healthy_runs(request.healthy, request.vehicle)
        progress("what each effect would do", 0.3)
        report = compare_runs(request.logs, healthy, request.vehicle, request.settings, request.vehicle_name)
        progress("done", 1.0)
    folder = run.folder
    log.info("\n%s\n", "\n".join(lines(report)))
    write_json(folder / "alike.json", to_json(report))
    log.info("alike.json is in %s", folder)


def lines(report: RunComparison) -> Iterator[str]:
    """For the console."""
    yield (
        f"{counted(len(report.runs), 'run')} of {report.seconds:g} s against {counted(report.healthy, 'sound one')}, "
        f"in {', '.join(report.channels)}"
    )
    for name in report.left_out:
        yield f"left out: {name} (too short, or a second without samples)"
    for own in report.runs[:SHOWN]:
        yield f"  {own.runs[0]}: {own.sentence}"
    if len(report.runs) > SHOWN:
        counts = Counter(own.causes[0].name if own.causes else own.verdict.key for own in report.runs)
        of_all = ", ".join(f"{count} {words(name)}" for name, count in counts.items())
        yield f"  and {len(report.runs) - SHOWN} more; of all: {of_all}"
    if len(report.runs) > 1:
        yield f"all together: {report.together.sentence}"
    if report.cannot_tell:
        yield f"these runs cannot show: {', '.join(words(name) for name in report.cannot_tell)}"


def to_json(report: RunComparison) -> dict[str, Any]:
    """The content of ``alike.json``, of plain types alone."""
    runs, together = [_plain(own) for own in report.runs], _plain(report.together)
    return {"version": VERSION, **plain(report), "runs": runs, "together": together}


def _plain(report: RunReport) -> dict[str, Any]:
    return {**plain(report), "sentence": report.sentence}
