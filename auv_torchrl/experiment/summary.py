"""One table and one picture over all runs of a sweep: ``python -m auv_torchrl.experiment.summary FOLDER``."""

import logging
import math
import statistics
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hydra.experimental.callback import Callback
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from omegaconf import DictConfig

from auv_torchrl.experiment.figures import DPI, bare
from auv_torchrl.experiment.results import TABLE_2, read_results, with_task
from auv_torchrl.palette import CONTROLLER, LABEL
from auv_torchrl.quantities import percent, quantity, words
from auv_torchrl.tasks import StationKeeping

TABLE, PICTURE = "summary.md", "summary.png"
Runs = Sequence[Mapping[str, Any]]

_NAME = 18  # characters of a scenario on the console; with five columns behind it a line of 80

log = logging.getLogger(__name__)


class SweepSummary(Callback):
    """Writes the summary when a Hydra multirun is over."""

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Read every ``results.json`` of the sweep."""
        folder = Path(config.hydra.sweep.dir)
        if runs := read_results(folder):
            summarize(runs, folder)
            log.info("\n%s\n\n%s and %s are in %s", console_table(runs), TABLE, PICTURE, folder)


def summarize(runs: Runs, folder: Path) -> str:
    """Write table and picture into ``folder`` and return the table."""
    text = table(runs)
    (folder / TABLE).write_text(text + "\n", encoding="utf-8")
    picture(runs).savefig(folder / PICTURE, dpi=DPI)
    return text


def groups(runs: Runs) -> dict[tuple[str, str, float], list[Mapping[str, Any]]]:
    """Runs by vehicle, box and scenario, each in the order of their seeds; other tasks stand before the scenario."""
    grouped: dict[tuple[str, str, float], list[Mapping[str, Any]]] = {}
    for run in sorted(runs, key=lambda run: (run["vehicle"], run["box_m"])):
        name = with_task(run.get("task", StationKeeping.name), run["scenario"])
        grouped.setdefault((name, run["vehicle"], run["box_m"]), []).append(run)
    return {key: sorted(members, key=lambda run: run["seed"]) for key, members in grouped.items()}


HEAD = (
    "scenario", "vehicle", "starts within", "paper u_t", "u_t per seed", "u_t median", "worst seed", "worst start",
    "u_s median", "nominal median", "data s", "fit s", "noticed in flight", "back in flight s",
)  # fmt: skip


def table(runs: Runs) -> str:
    """Markdown, one row per scenario, vehicle and box: mean error in m of each training seed, median and worst.

    In flight: the least share of the flights that noticed a change, and the longest time, of 90 % of the flights of a
    seed, from a change until the vehicle was within 5 cm for good.
    """
    rows = ["| " + " | ".join(HEAD) + " |", "|---|---|" + "---:|" * (len(HEAD) - 2)]
    for (scenario, vehicle, box), members in groups(runs).items():
        adapted = _errors(members, "u_t")
        published = TABLE_2.get(scenario, {}).get("u_t") if vehicle == "paper" else None
        cells = [scenario, vehicle, f"±{box:g} m", _metres(published, 3)]
        if adapted:
            cells += [" ".join(map(_metres, adapted)), _metres(statistics.median(adapted)), _metres(max(adapted))]
            cells.append(_metres(max(_errors(members, "u_t", "worst_m"))))
        else:
            infeasible = not members[0]["feasible"]
            cells += ["infeasible" if infeasible else "–", "–", "–", "–"]
        cells += [_metres(_median(_errors(members, name))) for name in ("u_s", "nominal")]
        cells += [_seconds(members, "target_data_s", ".2g"), _seconds(members, "fit_s", ".2g"), *_in_flight(members)]
        rows.append("| " + " | ".join(cells) + " |")
    return "\n".join(rows)


def console_table(runs: Runs) -> str:
    """The same in lines of up to 80 characters: median over the seeds, the worst one, and the flights."""
    lines = [_line("scenario", "seeds", "u_s", "u_t", "worst seed", "noticed", "back after")]
    several = len({(run["vehicle"], run["box_m"]) for run in runs}) > 1
    place = ("", 0.0)
    for (scenario, vehicle, box), members in groups(runs).items():
        if several and place != (vehicle, box):
            place = (vehicle, box)
            lines.append(f"{vehicle}, starts within ±{box:g} m")
        adapted, alone = _errors(members, "u_t"), _errors(members, "u_s")
        errors = (_median(alone), _median(adapted), max(adapted, default=None))
        shown = ["–" if error is None else quantity(error, "m") if error < math.inf else "inf" for error in errors]
        if not members[0]["feasible"]:
            shown[1] = "infeasible"
        noticed, back = _in_flight(members)
        back = f"{back} s" if back[0] in "0123456789" else back
        lines.append(_line(words(scenario), str(len(members)), *shown, noticed, back))
    return "\n".join(lines)


def _line(scenario: str, seeds: str, *cells: str) -> str:
    name = scenario if len(scenario) <= _NAME else f"{scenario[: _NAME - 1]}…"
    return f"{name:<{_NAME}} {seeds:>5}" + "".join(f" {cell:>10}" for cell in cells)


def picture(runs: Runs) -> Figure:
    """Mean error of every run, a row per scenario, vehicle and box, a marker per training seed."""
    grouped = groups(runs)
    figure = Figure(figsize=(9, 1.6 + 0.42 * len(grouped)), layout="constrained")
    axes = figure.subplots()
    shapes = {"nominal": "^", "u_s": "s", "u_t": "o"}
    for row, ((scenario, vehicle, _), members) in enumerate(grouped.items()):
        for name, shape in shapes.items():
            values = _errors(members, name)
            axes.plot(values, [row] * len(values), shape, color=CONTROLLER[name], alpha=0.7, markersize=6)
        published = TABLE_2.get(scenario, {}) if vehicle == "paper" else {}
        for name, value in published.items():
            axes.plot(value, row, "D", color=CONTROLLER[name], markerfacecolor="none")
    labels = [f"{scenario}\n{vehicle}, ±{box:g} m" for scenario, vehicle, box in grouped]
    axes.set(xscale="log", yticks=range(len(labels)), xlabel="mean distance to the target for t ≥ 10 s in m")
    axes.set_yticklabels(labels, fontsize=8)
    axes.invert_yaxis()
    bare(axes)
    keys = [Line2D([], [], marker=shape, linestyle="", color=CONTROLLER[name], label=LABEL[name])
            for name, shape in shapes.items()]  # fmt: skip
    keys.append(
        Line2D([], [], marker="D", linestyle="", color="black", markerfacecolor="none", label="paper's u_s and u_t")
    )
    figure.legend(handles=keys, loc="outside lower center", ncols=4, frameon=False)
    figure.suptitle("Every run of the sweep, a marker per training seed", fontsize=12)
    return figure


def _errors(runs: Runs, name: str, key: str = "mean_m") -> list[float]:
    """Of the runs that flew this controller; an unbounded error is infinite."""
    flown = [run[name][key] for run in runs if run[name] is not None]
    return [float("inf") if value is None else value for value in flown]


def _median(values: Sequence[float]) -> float | None:
    return statistics.median(values) if values else None


def _metres(value: float | None, digits: int = 4) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _seconds(runs: Runs, key: str, form: str) -> str:
    values = [run[key] for run in runs if run[key] is not None]
    return f"{max(values):{form}}" if values else "–"


def _in_flight(runs: Runs) -> tuple[str, str]:
    changes = [change for run in runs if run["in_flight"] is not None for change in run["in_flight"]["changes"]]
    if not changes:
        return "–", "–"
    back = [change["recovery_s"]["p90"] for change in changes]
    return percent(min(change["noticed"] for change in changes)), "never" if None in back else f"{max(back):.1f}"


if __name__ == "__main__":
    where = Path(sys.argv[1])
    sys.stdout.write(summarize(read_results(where), where) + "\n")
