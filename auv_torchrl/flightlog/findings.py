"""What a reader of a flight log should know about it."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum

from auv_torchrl.quantities import counted
from auv_torchrl.text import printable, within

_REPEATED = 3  # findings of one kind that are listed one by one
_QUOTED = 3  # findings that an error quotes,
_QUOTED_LETTERS = 250  # and characters of each: an error fits a screen
_MOST_LETTERS = 1000  # of an error, or of a sentence of a finding; half a screen


def _line(text: str) -> str:
    """The text as one line that can be shown; of a longer one the middle is left out, before and after it is spelt."""
    return within(printable(within(text, _MOST_LETTERS), None), _MOST_LETTERS)


class FlightLogError(ValueError):
    """Nothing of a log can be used; the message names the cause, where it is and the remedy.

    It is made printable and is one line of at most 1,000 characters: of a longer one the middle is left out.
    """

    def __init__(self, message: str) -> None:
        super().__init__(_line(message))


class Severity(StrEnum):
    """How much a finding matters."""

    ERROR = "error"  # what the log says cannot be trusted until it is mended
    WARNING = "warning"  # something was left out or converted, or limits what can be concluded
    INFO = "info"


@dataclass(frozen=True)
class Finding:
    """One thing about a log that its reader should know; sentence, remedy and columns are made printable and bounded.

    ``rows`` are the first and last row concerned, counted from 1 below the header; None concerns all of it.
    """

    severity: Severity
    code: str
    sentence: str
    remedy: str = ""
    columns: tuple[str, ...] = ()
    rows: tuple[int, int] | None = None
    limits: bool = False  # bounds verdict and probabilities of a diagnosis: they stay in doubt until it is mended
    param: tuple[tuple[str, float], ...] = ()  # parameters of the autopilot to set, where they are the remedy

    def __post_init__(self) -> None:
        object.__setattr__(self, "sentence", _line(self.sentence))
        object.__setattr__(self, "remedy", _line(self.remedy))
        object.__setattr__(self, "columns", tuple(map(printable, self.columns)))

    @property
    def where(self) -> str:
        """The rows in words; nothing where the finding concerns all of the log."""
        first, last = self.rows or (0, 0)
        return f"rows {first} to {last}" if last > first else f"row {first}" if self.rows else ""

    def __str__(self) -> str:
        rows = f" ({self.where})" if self.where else ""
        remedy = f" {self.remedy}." if self.remedy else ""
        return f"{self.severity}: {self.sentence}{rows}.{remedy}"


def condensed(findings: Iterable[Finding]) -> list[Finding]:
    """The same findings, worst first, with a crowd of one kind on the same columns as its first and a count."""
    kinds: dict[tuple, list[Finding]] = {}
    for finding in findings:
        kinds.setdefault((finding.severity, finding.code, finding.columns), []).append(finding)
    short = []
    for crowd in kinds.values():
        if len(crowd) <= _REPEATED:
            short += crowd
            continue
        rows = [row for finding in crowd for row in finding.rows or ()]
        sentence = f"{crowd[0].sentence}; {len(crowd)} times in all"
        short.append(replace(crowd[0], sentence=sentence, rows=(min(rows), max(rows)) if rows else None))
    order = list(Severity)
    return sorted(short, key=lambda finding: order.index(finding.severity))


def quoted(findings: Iterable[Finding]) -> str:
    """The worst findings in one sentence, and how many more there are."""
    worst = condensed(findings)
    more = [f"and {counted(len(worst) - _QUOTED, 'more finding')}"] if len(worst) > _QUOTED else []
    return "; ".join([*(printable(str(finding), _QUOTED_LETTERS) for finding in worst[:_QUOTED]), *more])
