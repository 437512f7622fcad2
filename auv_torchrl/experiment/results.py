"""results.json and the table of one run."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from auv_torchrl.compensation.command_share import command_sentence
from auv_torchrl.evaluation import FLOOR_M, FLOOR_RAD, Metrics
from auv_torchrl.files import write_text
from auv_torchrl.quantities import counted, duration, percent, quantity, words
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.text import in_order

RESULTS = "results.json"
PUBLISHED = ("paper", StationKeeping.name)  # vehicle and task of the paper's table
COLUMNS = (("mean", 7), ("p95", 7), ("worst", 7), ("settled after", 13), ("heading", 7))  # with their widths
_LABEL = 20  # characters; with the columns and the bars between them a line of 80
TABLE_2: dict[str, dict[str, float]] = {
    "swap": {"u_t": 0.019, "u_s": 0.41},
    "thruster_gain": {"u_t": 0.028, "u_s": 0.39},
    "reversed": {"u_t": 0.021, "u_s": 1.16},
    "reversed_and_dead": {"u_t": 0.021, "u_s": 1.16},  # the text's version of scenario 3; Table 2 has one row for it
}


def with_task(task: str, scenario: str) -> str:
    """What was flown, in words; station keeping goes without saying."""
    return scenario if task == StationKeeping.name else f"{task}, {scenario}"


@dataclass(frozen=True)
class Results:
    """What a run found out; times in s, None where there was nothing to do."""

    scenario: str
    vehicle: str
    seed: int
    box_m: float
    starts: int
    nominal: Metrics
    u_s: Metrics | None = None
    u_t: Metrics | None = None
    u_t_forms: Mapping[str, Metrics] = field(default_factory=dict)  # by composition: short, long
    target_data_s: float | None = None
    fit_s: float | None = None
    train_s: float | None = None
    feasible: bool = True
    reason: str | None = None  # why not, with the rank
    policy: str | None = None  # hash of the source policy
    in_flight: Mapping[str, Any] | None = None  # what InFlight.as_dict says
    command_share: float | None = None  # of what the vehicle does differently, what a map of its commands can undo
    closed: Metrics | None = None  # with what was diagnosed in simulator and controller
    closing: Mapping[str, Any] | None = None  # what Closing.as_dict says
    task: str = StationKeeping.name

    @property
    def holds(self) -> bool | None:
        """Whether u_s holds the changed vehicle as well as the nominal one; None where there is no changed one."""
        return None if self.u_s is None else self.u_s.holds_as_well_as(self.nominal)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        content: dict[str, Any] = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        content |= {name: metrics.as_dict() for name, metrics in content.items() if isinstance(metrics, Metrics)}
        content["u_t_forms"] = {name: metrics.as_dict() for name, metrics in self.u_t_forms.items()}
        del content["closed"]  # said in closing, too
        content["u_s_holds"] = self.holds
        return content

    def save(self, folder: Path) -> None:
        """Write ``results.json`` at once or not at all."""
        write_text(folder / RESULTS, json.dumps(self.as_dict(), indent=2, allow_nan=False) + "\n")

    def table(self) -> str:
        """Markdown of lines of up to 80 characters, the paper's row beside ours; then what it took and what it says."""
        what = f"vehicle {self.vehicle}, {counted(self.starts, 'start')} within ±{self.box_m:g} m"
        rows = [f"{words(with_task(self.task, self.scenario))}, {what}", ""]
        rows.append(_line("", [name for name, _ in COLUMNS]))
        rows.append(_line(":" + "-" * (_LABEL - 1), ["-" * (width - 1) + ":" for _, width in COLUMNS]))
        published = TABLE_2.get(self.scenario, {}) if (self.vehicle, self.task) == PUBLISHED else {}
        rows += [_line(f"paper, {name}", [_length(published[name])]) for name in ("u_s", "u_t") if name in published]
        flown = {"u_s, nominal vehicle": self.nominal, "u_s": self.u_s, "u_t": self.u_t}
        flown["diagnosed and closed"] = self.closed
        flown |= {f"u_t, {form} form": m for form, m in self.u_t_forms.items() if m != self.u_t}
        rows += [_line(label, _cells(metrics)) for label, metrics in flown.items() if metrics is not None]
        took = [("target data", self.target_data_s), ("fit", self.fit_s), ("source training", self.train_s)]
        rows += ["", ", ".join(f"{label}: {duration(s)}" for label, s in took if s is not None)]
        sentences = [f"no u_t: {self.reason}" if self.reason is not None else None, self._held()]
        sentences.append(command_sentence(self.command_share) if self.u_s is not None else None)
        sentences += [more["summary"] for more in (self.in_flight, self.closing) if more is not None]
        for sentence in filter(None, sentences):
            rows += ["", sentence]
        return "\n".join(rows)

    def _held(self) -> str | None:
        """That there is nothing to adapt, and by which criterion, where that is so."""
        if not self.holds:
            return None
        assert self.u_s is not None
        errors = (f"{_length(m.mean_m)} and {quantity(m.heading_rad, 'rad', 2)}" for m in (self.u_s, self.nominal))
        floors = f"{quantity(FLOOR_M, 'm', 1)} and {quantity(FLOOR_RAD, 'rad', 1)}"
        return (
            f"The source policy holds this vehicle as well as the nominal one ({' against '.join(errors)}, less than "
            f"{floors} more): there is nothing to adapt."
        )


def _cells(metrics: Metrics) -> list[str]:
    settled = "never" if metrics.settling_s is None else f"{metrics.settling_s:.2f} s"
    lengths = map(_length, (metrics.mean_m, metrics.p95_m, metrics.worst_m))
    return [*lengths, f"{percent(metrics.settled)}, {settled}", quantity(metrics.heading_rad, "rad")]


def _length(value: float) -> str:
    """``inf`` is an error without bound."""
    return quantity(value, "m") if math.isfinite(value) else "inf"


def _line(label: str, cells: Sequence[str]) -> str:
    """One line of the table; ``–`` is a number that there is not."""
    padded = [*cells, *["–"] * (len(COLUMNS) - len(cells))]
    written = (f"{cell:>{width}}" for cell, (_, width) in zip(padded, COLUMNS, strict=True))
    return f"| {label:<{_LABEL}} | " + " | ".join(written) + " |"


def read_results(folder: Path) -> list[dict[str, Any]]:
    """All results below a folder, in the order of its subfolders."""
    paths = sorted(folder.rglob(RESULTS), key=lambda path: [in_order(part) for part in path.parts])
    return [json.loads(path.read_text()) for path in paths]
