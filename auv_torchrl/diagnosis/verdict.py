"""What a diagnosis says: the content of ``diagnosis.json`` (version 1), and the trajectories beside it.

A field that is None could not be told from the log. Shares are of the gap, in [0, 1].
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from auv_torchrl.diagnosis.plain import NULL, from_plain, plain
from auv_torchrl.diagnosis.thresholds import LIKELY, SURE
from auv_torchrl.effects.advice import Advice
from auv_torchrl.flightlog import POSE, Finding, FlightLog
from auv_torchrl.flightlog.log import Floats
from auv_torchrl.quantities import words
from auv_torchrl.sysid.trace import Outcome

MOST_SAMPLES = 600  # about one for each two points of a page that is 1,100 wide


@dataclass(frozen=True)
class Overview:
    """Curves of a log, its episodes one behind the other as ``Where.onset_s`` counts them."""

    t: Floats  # (T,) s into the log
    begins: tuple[float, ...]  # s, where episodes begin
    episodes: tuple[int, ...]  # their numbers
    depth: Floats  # (T,) m, of NaN where not measured
    heading: Floats  # (T,) rad, likewise
    commands: Floats  # (T, n)
    volts: Floats  # (T,) V, likewise

    @staticmethod
    def of(log: FlightLog) -> "Overview":
        """The overview of a log: every k-th sample."""
        lengths = np.array([float(episode.t[-1]) for episode in log.episodes])
        begins = np.concatenate(([0.0], np.cumsum(lengths)[:-1]))
        t = np.concatenate([begin + episode.t for begin, episode in zip(begins, log.episodes, strict=True)])
        rows = np.unique(np.linspace(0, len(t) - 1, min(len(t), MOST_SAMPLES)).astype(int))
        pose = np.concatenate([episode.pose for episode in log.episodes])[rows]
        volts = [np.full(len(e), np.nan) if e.battery is None else e.battery for e in log.episodes]
        return Overview(
            t=t[rows],
            begins=tuple(begins.tolist()),
            episodes=tuple(episode.number for episode in log.episodes),
            depth=pose[:, POSE.index("z")],
            heading=pose[:, POSE.index("yaw")],
            commands=np.concatenate([episode.commands for episode in log.episodes])[rows],
            volts=np.concatenate(volts)[rows],
        )

    def at(self, episode: int, t: float) -> float:
        """Seconds into the log of a time in an episode."""
        return self.begins[self.episodes.index(episode)] + t


FLOOR_ASSUMED = "floor_assumed"  # code of the finding that no flight showed the disturbance of the sound vehicle
NOT_SHOWN = "would leave no mark on this log"  # of an effect, in Diagnosis.cannot_tell


def how_sure(clause: str, probability: float) -> str:
    """A clause as a fact where it is one, else behind "probably", or "perhaps" where it may as well be untrue."""
    if probability > SURE:
        return clause
    word = "probably" if probability > LIKELY else "perhaps"
    percent = f"{100 * probability:.0f} %" if probability >= 0.01 else "below 1 %"
    return f"{word} ({percent}) {clause[:1].lower()}{clause[1:].replace('; ', ' and ')}"


class Verdict(Enum):
    """Outcome of a diagnosis; the value is the sentence that its reader sees, the name goes to the file."""

    NO_GAP = "The simulator misses no more than sensors, water and a few per cent of calibration account for."
    EXPLAINED = "The simulator misses this vehicle, and the effects named below, each as sure as it says, explain it."
    PARTLY_EXPLAINED = (
        "The effects named below, each as sure as it says, explain a part of the gap; something acts that is not known."
    )
    UNEXPLAINED = "The simulator misses this vehicle, and none of the known effects explains it."
    CANNOT_TELL = (
        "Something that was measured does not follow the vehicle: whether all of it is in order, nobody can tell."
    )

    @property
    def key(self) -> str:
        """The word in ``diagnosis.json``."""
        return self.name.lower()


@dataclass(frozen=True)
class Regime:
    """A circumstance in which the gap stands out."""

    when: str  # for people, e.g. "speed above 0.4 m/s"
    gap: float  # ratio to the gap of the whole log


@dataclass(frozen=True)
class Intermittence:
    """A thruster that gives all of its thrust or nothing, with the share of the time in which it gives nothing."""

    thruster: int  # from 1
    share: float
    low: float  # 95 % interval
    high: float


@dataclass(frozen=True)
class Slice:
    """What a thruster gives of its thrust while its command lies between two, of the full command."""

    low: float
    high: float
    share: float  # 1 is what it should, 0 nothing
    least: float  # 95 % interval
    most: float


@dataclass(frozen=True)
class ThrustMap:
    """The measured map of a thruster that does what no effect of the library does: it gives the same at one command."""

    thruster: int  # from 1
    slices: tuple[Slice, ...]  # in the order of their commands, where the log has some
    at_rest: float  # of the full thrust, besides
    at_rest_least: float  # 95 % interval
    at_rest_most: float


@dataclass(frozen=True)
class Where:
    """Where the gap lies; each mapping sums to 1 or is empty."""

    dof: dict[str, float] = field(default_factory=dict)  # by name in DEGREES_OF_FREEDOM
    origin: dict[str, float] = field(default_factory=dict)  # by auv_torchrl.effects.Origin
    thruster: dict[str, float] = field(default_factory=dict)  # by number, "1" is the first
    regime: tuple[Regime, ...] = ()
    intermittence: Intermittence | None = None
    thrust_map: ThrustMap | None = None
    onset_s: float | None = None  # s into the log, where the vehicle changes during it
    onset_episode: int | None = None  # number of the episode in which it does
    onset_in_episode_s: float | None = None  # s since the start of that episode


@dataclass(frozen=True)
class Estimate:
    """A parameter with its 95 % interval, infinite where the log does not bound it (null in the file)."""

    value: float
    low: float = field(metadata={NULL: -math.inf})
    high: float = field(metadata={NULL: math.inf})
    nominal: float
    unit: str

    @property
    def is_nominal(self) -> bool:
        """Whether it is nominal to the digits in which it is written, which the interval leaves open."""
        half = (self.high - self.low) / 2
        digit = half / 10 if math.isfinite(half) else 0.0
        return abs(self.value - self.nominal) <= digit / 2


@dataclass(frozen=True)
class FoundEffect:
    """One effect of the explanation."""

    name: str  # in auv_torchrl.effects.EFFECTS
    probability: float
    parameters: dict[str, Estimate]  # by full name, e.g. gain_4
    thrusters: tuple[int, ...]  # at fault, from 1
    gap_closed: float | None  # share lost when this effect alone is taken out again
    sentence: str
    advice: tuple[Advice, ...] = ()  # what to do about it
    calibrates: bool = False  # it corrects what the vehicle's file says, rather than naming a fault

    @property
    def is_likely(self) -> bool:
        """Whether it is likelier than not."""
        return self.probability > LIKELY

    @property
    def departs(self) -> bool:
        """Whether any parameter is written otherwise than its nominal value."""
        return not all(estimate.is_nominal for estimate in self.parameters.values())

    @property
    def clause(self) -> str:
        """Its sentence, as sure as it is."""
        return how_sure(self.sentence.rstrip("."), self.probability)


@dataclass(frozen=True)
class EffectProbability:
    """One single effect that was tried, or "none" or "unknown"."""

    name: str
    probability: float
    gap_closed: float | None = None


OTHERS = "others"  # all alternatives that nobody acts on, together


@dataclass(frozen=True)
class Alternative:
    """One explanation of several of which one is true."""

    effects: tuple[str, ...]  # that act together; none where the vehicle is as its file says, or as ``besides`` says
    besides: str  # what acts too that is no effect of the library: "something unknown", or nothing
    probability: float  # of exactly that; those of all alternatives add up to 1

    @property
    def called(self) -> str:
        """It in words."""
        parts = [words(name) for name in self.effects] + ([self.besides] if self.besides else [])
        return " and ".join(parts) or "no effect"


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects that was looked at; the trace of a diagnosis holds all of them, in order."""

    effects: tuple[str, ...]
    parameters: dict[str, float]  # by effect.parameter
    log_evidence: float | None  # natural logarithm; None where its simulation diverges
    log_prior: float
    misfit: float | None  # chi-square per measured number, 1 is noise alone; None likewise
    proposed: str  # by what
    outcome: Outcome  # what became of it

    @property
    def called(self) -> str:
        """Its effects, or "no effect"."""
        return " + ".join(self.effects) or "no effect"

    @property
    def log_posterior(self) -> float:
        """Log posterior probability, up to what all share."""
        return -math.inf if self.log_evidence is None else self.log_evidence + self.log_prior

    def values_of(self, effect: str) -> dict[str, float]:
        """Its values of the parameters of one effect, by parameter."""
        of = {key.partition(".") for key in self.parameters}
        return {name: self.parameters[f"{owner}.{name}"] for owner, _, name in sorted(of) if owner == effect}

    @property
    def simulated(self) -> bool:
        """Whether it was fitted by full simulation."""
        return self.outcome not in (Outcome.PREDICTED, Outcome.OUTDONE)


@dataclass(frozen=True)
class Decision:
    """How a verdict was reached."""

    trace: tuple[Hypothesis, ...] = ()
    reasons: dict[str, str] = field(default_factory=dict)  # by effect of the library, why it is named or is not
    next_best: str = ""  # the simulated hypothesis with the next highest posterior
    apart: dict[str, float] = field(default_factory=dict)  # by channel, share of what tells it from the best one

    @property
    def best(self) -> Hypothesis | None:
        """The hypothesis that was kept; None without a trace."""
        return next((one for one in self.trace if one.outcome.is_kept), None)

    @property
    def simulated(self) -> tuple[Hypothesis, ...]:
        """Each set of effects that was simulated once, with the values that fit it best, in the order they came up."""
        best: dict[tuple[str, ...], Hypothesis] = {}
        for one in self.trace:
            held = best.get(one.effects)
            if one.simulated and (held is None or _rank(one) > _rank(held)):
                best[one.effects] = one
        return tuple(best.values())

    @property
    def best_fit(self) -> Hypothesis | None:
        """The hypothesis that is behind none: the one that was kept, or what held-out flight took back of it."""
        if self.best is None or self.best.outcome is Outcome.KEPT:
            return self.best
        return max((one for one in self.trace if one.simulated), key=lambda one: one.log_posterior)

    def behind(self, one: Hypothesis) -> float:
        """Log units by which a hypothesis is less probable than the best fit."""
        return 0.0 if self.best_fit is None else self.best_fit.log_posterior - one.log_posterior


def _rank(one: Hypothesis) -> tuple[bool, float]:
    return one.outcome.is_kept, one.log_posterior


@dataclass(frozen=True)
class NextExperiment:
    """A manoeuvre that would separate what this log leaves open."""

    why: str
    commands: str = "next_experiment.csv"  # file beside diagnosis.json
    by_hand: str = ""  # the same for a pilot
    tells: str = ""  # what it is for, as the end of a clause
    t: Floats | None = field(default=None, compare=False)  # (T,) s; not in the file
    thruster_commands: Floats | None = field(default=None, compare=False)  # (T, n); not in the file


@dataclass(frozen=True)
class Errors:
    """Root mean square prediction errors, one per horizon of :class:`Gap`.

    Not a number, null in the file, where a simulation diverges or nothing was measured.
    """

    before: tuple[float, ...] = field(metadata={NULL: math.nan})
    after: tuple[float, ...] = field(metadata={NULL: math.nan})
    floor: tuple[float, ...] = field(metadata={NULL: math.nan})


@dataclass(frozen=True)
class Confirmation:
    """The errors of :class:`Gap`, and the share closed, when MuJoCo flies the same stretches."""

    position_m: Errors | None = None
    yaw_rad: Errors | None = None
    velocity: Errors | None = None
    dof: dict[str, Errors] = field(default_factory=dict)
    closed: float | None = None


@dataclass(frozen=True)
class Gap:
    """Prediction errors on held-out data, with the nominal simulator and with the effects in it."""

    horizon_s: tuple[float, ...]
    position_m: Errors | None = None
    yaw_rad: Errors | None = None
    velocity: Errors | None = None  # of the linear velocity, m/s
    dof: dict[str, Errors] = field(default_factory=dict)  # m and rad from poses, m/s and rad/s from velocities
    closed: float | None = None  # None where the error before is within the floor, or the simulator diverges
    held_out_episodes: tuple[int, ...] = ()
    confirmed: Confirmation | None = None  # in MuJoCo; None where no effect was found to put there


@dataclass(frozen=True)
class Trajectory:
    """Motion over a window; columns of NaN where not measured."""

    pose: Floats  # (T, 6) x y z roll pitch yaw, NED, m and rad
    velocity: Floats  # (T, 6) u v w p q r, body, m/s and rad/s

    @property
    def values(self) -> Floats:
        """Both (T, 12) side by side."""
        return np.hstack((self.pose, self.velocity))


@dataclass(frozen=True, eq=False)
class Window:
    """A held-out stretch, simulated from its first sample from the commands alone."""

    episode: int
    t: Floats  # (T,) s since the start of the episode
    commands: Floats  # (T, n)
    measured: Trajectory
    before: Trajectory  # nominal simulator
    after: Trajectory  # with the effects found


@dataclass(frozen=True)
class Diagnosis:
    """All that is said about one log."""

    log: str
    vehicle: str
    verdict: Verdict
    summary: str  # what was found, how sure that is and how much of the gap, in one paragraph
    where: Where
    effects: tuple[FoundEffect, ...]  # of the chosen explanation, strongest first
    candidates: tuple[EffectProbability, ...]  # every single effect tried, ranked, and "unknown"
    indistinguishable: tuple[tuple[str, ...], ...]
    next_experiment: NextExperiment | None
    gap: Gap
    input_mappable: float | None  # share that any map of the commands could close
    detectable: dict[str, Estimate] = field(default_factory=dict)  # effect -> smallest size this log could have shown
    detectable_with: dict[int, dict[str, Estimate]] = field(default_factory=dict)  # by number of healthy flights
    cannot_tell: tuple[str, ...] = ()  # sentences: axes not measured, thrusters not excited, parameters at a bound
    findings: tuple[Finding, ...] = ()  # about the log
    decision: Decision = Decision()  # how this was decided
    headline: str = ""  # the same in at most 15 words
    alternatives: tuple[Alternative, ...] = ()  # what may be, likeliest first; their probabilities add up to 1
    windows: tuple[Window, ...] = field(default=(), compare=False)  # not in diagnosis.json but in predictions.parquet
    overview: Overview | None = field(default=None, compare=False)  # of the log; not in the file


VERSION = 1


def to_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of ``diagnosis.json``, of plain types alone."""
    return {"version": VERSION, **plain(diagnosis)}


def from_json(content: Mapping[str, Any]) -> Diagnosis:
    """The diagnosis that :func:`to_json` wrote, without its trajectories.

    Raises:
        KeyError: for an entry that is missing or unknown.
        ValueError: for another version, or an entry that holds something else, naming it and what is wanted.
    """
    if content.get("version") != VERSION:
        raise ValueError(f"diagnosis of version {content.get('version')!r}: this program reads version {VERSION}")
    return from_plain(Diagnosis, {name: entry for name, entry in content.items() if name != "version"})
