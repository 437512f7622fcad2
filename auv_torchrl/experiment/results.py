"""results.json and the table of one run."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from auv_torchrl.compensation.command_share import command_sentence
from auv_torchrl.evaluation import Metrics
from auv_torchrl.experiment.console import readable
from auv_torchrl.files import write_text
from auv_torchrl.tasks import StationKeeping

RESULTS = "results.json"
PUBLISHED = ("paper", StationKeeping.name)  # vehicle and task of the paper's table
COLUMNS = ("mean m", "std m", "p95 m", "worst m", "settling s", "settled", "heading rad")
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

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        told = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        told |= {name: metrics.as_dict() for name, metrics in told.items() if isinstance(metrics, Metrics)}
        told["u_t_forms"] = {name: metrics.as_dict() for name, metrics in self.u_t_forms.items()}
        del told["closed"]  # said in closing, too
        return told

    def save(self, folder: Path) -> None:
        """Write ``results.json`` at once or not at all."""
        write_text(folder / RESULTS, json.dumps(self.as_dict(), indent=2, allow_nan=False) + "\n")

    def table(self) -> str:
        """Markdown: the paper's row beside ours, then what it took."""
        what = f"{self.scenario}, vehicle {self.vehicle}, {self.starts} starts within ±{self.box_m:g} m"
        rows = [with_task(self.task, what), ""]
        rows += ["| | " + " | ".join(COLUMNS) + " |", "|---|" + "---:|" * len(COLUMNS)]
        published = TABLE_2.get(self.scenario, {}) if (self.vehicle, self.task) == PUBLISHED else {}
        rows += [_row(f"paper, {name}", {"mean_m": published[name]}) for name in ("u_s", "u_t") if name in published]
        flown = {"ours, u_s on the nominal vehicle": self.nominal, "ours, u_s": self.u_s, "ours, u_t": self.u_t}
        flown["ours, diagnosed and closed"] = self.closed
        flown |= {f"ours, u_t, {form} form": m for form, m in self.u_t_forms.items() if m != self.u_t}
        rows += [_row(label, metrics.as_dict()) for label, metrics in flown.items() if metrics is not None]
        took = [("seconds of target data", self.target_data_s), ("fit", self.fit_s), ("source training", self.train_s)]
        rows += ["", ", ".join(f"{label}: {readable(s)}" for label, s in took if s is not None)]
        if self.reason is not None:
            rows += ["", f"no u_t: {self.reason}"]
        if self.u_s is not None:
            rows += ["", command_sentence(self.command_share)]
        if self.in_flight is not None:
            rows += ["", self.in_flight["summary"]]
        if self.closing is not None:
            rows += ["", self.closing["summary"]]
        return "\n".join(rows)


def _row(label: str, metrics: Mapping[str, Any]) -> str:
    """One line of the table; ``inf`` is an error without bound, ``–`` a number that there is not."""
    if "std_m" not in metrics:
        cells = [f"{metrics['mean_m']:.3f}"] + ["–"] * (len(COLUMNS) - 1)
    else:
        metres = (metrics[key] for key in ("mean_m", "std_m", "p95_m", "worst_m"))
        cells = [f"{math.inf if value is None else value:.4f}" for value in metres]
        cells.append("never" if metrics["settling_s"] is None else f"{metrics['settling_s']:.2f}")
        cells += [f"{metrics['settled']:.0%}", f"{metrics['heading_rad']:.3f}"]
    return f"| {label} | " + " | ".join(cells) + " |"


def read_results(folder: Path) -> list[dict[str, Any]]:
    """All results below a folder, in the order of its subfolders."""
    paths = sorted(folder.rglob(RESULTS), key=lambda path: [_number(part) for part in path.parts])
    return [json.loads(path.read_text()) for path in paths]


def _number(name: str) -> tuple[int, str]:
    return (int(name), "") if name.isdigit() else (-1, name)
