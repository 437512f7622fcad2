"""What is said about many dives: the content of ``dives.json``, and of the page."""

from dataclasses import dataclass

from auv_torchrl.diagnosis.thresholds import LIKELY
from auv_torchrl.flightlog import Finding


@dataclass(frozen=True)
class Value:
    """A deviation from the reference with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Followed:
    """A number that is followed from dive to dive."""

    key: str
    effect: str  # in auv_torchrl.effects.EFFECTS, or "noise"
    label: str  # for people
    unit: str  # "1" where it has none; its deviations are then shown in per cent
    watched: bool  # a change of it raises an alarm


@dataclass(frozen=True)
class OwnDiagnosis:
    """What the diagnosis of one dive by itself says."""

    verdict: str
    summary: str
    folder: str  # beside dives.json


@dataclass(frozen=True)
class DiveTold:
    """One dive."""

    number: int  # in the order in which they were flown, from 1
    name: str
    begun: str  # date and time; empty where the name of its file has none
    seconds: float
    is_reference: bool
    excess: float | None  # chi-square per measured number that is left with every number free; 1 is noise alone
    is_explained: bool  # whether that is all that sensors and water make
    refused: str  # why it could not be used; empty where it could
    values: dict[str, Value]  # by number; those that it does not tell are not in it
    findings: tuple[Finding, ...] = ()
    diagnosis: OwnDiagnosis | None = None


@dataclass(frozen=True)
class ShiftTold:
    """One step or drift of one number."""

    kind: str  # "step" or "drift"
    dive: int  # the first that is not as before, from 1
    dive_low: int  # 95 % interval
    dive_high: int
    size: Value  # of a drift, per dive
    probability: float


@dataclass(frozen=True)
class ChangeTold:
    """What happened to one number, seen from the last dive."""

    number: str
    shifts: tuple[ShiftTold, ...]
    now: float  # the deviation in the last dive, from what it was before
    line: tuple[float, ...]  # the deviation in each dive, as the shifts say
    probability: float
    rivals: tuple[str, ...]  # numbers that it may be as well
    sentence: str
    advice: tuple[str, ...] = ()

    @property
    def is_likely(self) -> bool:
        """Whether it is likelier than not."""
        return self.probability > LIKELY


@dataclass(frozen=True)
class AlarmTold:
    """A change that was noticed when only the dives so far were known."""

    dive: int
    number: str
    rivals: tuple[str, ...]
    sentence: str


@dataclass(frozen=True)
class ManyDives:
    """All that is said."""

    vehicle: str
    summary: str
    dives: tuple[DiveTold, ...]
    numbers: tuple[Followed, ...]
    alarms: tuple[AlarmTold, ...]
    changes: tuple[ChangeTold, ...]
    dives_per_false_alarm: float
    threshold: float  # of twice the log likelihood ratio
    cannot_tell: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()  # of the reference, and of the folder of the dives

    @property
    def followed(self) -> dict[str, Followed]:
        """The numbers by their keys."""
        return {number.key: number for number in self.numbers}

    @property
    def changed(self) -> dict[str, ChangeTold]:
        """Changes by number."""
        return {change.number: change for change in self.changes}
