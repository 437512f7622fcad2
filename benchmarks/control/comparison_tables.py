"""The tables and the picture of comparison.py, from what was flown."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np

from auv_torchrl.evaluation import FLOOR_M

RECOVERED_M = 0.05
OURS = ("DDR, 4 channels", "DDR to the thrusters", "online, in flight", "diagnosed, then closed")
CLOSED, SOURCE, ORACLE = "diagnosed, then closed", "u_s", "told the target (oracle)"
NOT_OF_COMMANDS = ("payload", "current", "thruster_lag", "command_delay", "tether")  # a map of commands is not enough
SHORT = {
    "PID with integral": "PID + I",
    "pulse test, fixed signs": "signs",
    "recursive least squares": "RLS",
    "DDR, 4 channels": "DDR 4",
    "DDR to the thrusters": "DDR n",
    "online, in flight": "online",
    "told the target (oracle)": "told*",
    "robust SAC": "robust",
    "diagnosed, then closed": "closed",
    "adaptive LQR": "aLQR",
    "L1 augmentation": "L1",
    "SAC, trained on": "SAC on",
    "history-conditioned (RMA)": "RMA",
    "particle weights, trained again": "particles",
}


class Cell(NamedTuple):
    """One method in one scenario; errors are means for t >= 10 s of each start, in m."""

    mean_m: float
    p95_m: float
    worst_m: float
    target_data_s: float
    compute_s: float
    notes: dict[str, Any]


Table = Mapping[str, Mapping[str, Cell]]  # by method, then by scenario


def report(table: Table, count: int, nominal_m: float) -> str:
    """Markdown: all methods in one table, the scenarios one by one, and the gap that a diagnosis closes."""
    scenarios = list(next(iter(table.values())))
    parts = [
        f"{len(scenarios)} scenarios, {count} starts in ±1 m, vehicle `paper` in MuJoCo, 20 s; errors are of the "
        f"position for t ≥ 10 s. On the nominal vehicle u_s holds {nominal_m:.4f} m. Data: seconds flown on the target "
        "before the judged flight; 0 for methods that learn during it or not at all. Compute: CPU seconds before it.",
        summary(table),
        "Mean error by scenario, m (* the oracle is told what is wrong):",
        by_scenario(table, lambda cell: metres(cell.mean_m)),
        "95th percentile / worst start, m:",
        by_scenario(table, lambda cell: f"{metres(cell.p95_m)} / {metres(cell.worst_m)}"),
    ]
    if {CLOSED, SOURCE, ORACLE} <= set(table):
        parts += closing(table)
    named = [name for name in NOT_OF_COMMANDS if name in scenarios]
    if named and SOURCE in table and set(OURS) & set(table):
        parts += ["What a map of the commands alone does not undo, best of our methods:", best_of_ours(table, named)]
    return "\n\n".join(parts)


def summary(table: Table) -> str:
    """One row per method."""
    rows = [
        "| method | data [s] | compute [s] | mean: median scenario | mean: worst scenario | 95 %: median scenario "
        f"| worst start of all | below {RECOVERED_M} m |",
        "|---|" + "---:|" * 7,
    ]
    for method, results in table.items():
        cells = list(results.values())
        mean = [cell.mean_m for cell in cells]
        recovered = sum(m < RECOVERED_M for m in mean)
        row = (
            f"{np.median([c.target_data_s for c in cells]):.0f}", f"{np.median([c.compute_s for c in cells]):.1f}",
            metres(float(np.median(mean))), metres(max(mean)), metres(float(np.median([c.p95_m for c in cells]))),
            metres(max(c.worst_m for c in cells)), f"{recovered} of {len(cells)}",
        )  # fmt: skip
        rows.append(f"| {method} | " + " | ".join(row) + " |")
    return "\n".join(rows)


def by_scenario(table: Table, text: Callable[[Cell], str]) -> str:
    """One row per scenario, one column per method."""
    scenarios = list(next(iter(table.values())))
    rows = ["| scenario | " + " | ".join(SHORT.get(m, m) for m in table) + " |", "|---|" + "---:|" * len(table)]
    rows += [f"| {s} | " + " | ".join(text(results[s]) for results in table.values()) + " |" for s in scenarios]
    return "\n".join(rows)


def share_closed(table: Table, scenario: str) -> float | None:
    """Share of the gap between u_s and the oracle that the diagnosis closes; None where there is no gap."""
    before, best = table[SOURCE][scenario].mean_m, table[ORACLE][scenario].mean_m
    if before - best < FLOOR_M:
        return None
    return (before - table[CLOSED][scenario].mean_m) / (before - best)


def closing(table: Table) -> list[str]:
    """The controller's gap beside the prediction's gap, scenario by scenario."""
    rows = [
        "| scenario | u_s | closed | oracle | controller's gap closed | prediction's gap closed | trained on "
        "| verdict | what was found |",
        "|---|" + "---:|" * 5 + "---|" * 3,
    ]
    shares = []
    for scenario, cell in table[CLOSED].items():
        share = share_closed(table, scenario)
        shares += [] if share is None else [share]
        errors = (metres(results[scenario].mean_m) for results in (table[SOURCE], table[CLOSED], table[ORACLE]))
        found, verdict = cell.notes["summary"], cell.notes["verdict"].replace("_", " ")
        rows.append(
            f"| {scenario} | {' | '.join(errors)} | {percent(share)} | {percent(cell.notes['prediction_closed'])} "
            f"| {'yes' if cell.notes['tuned'] else 'no'} | {verdict} "
            f"| {found if len(found) < 120 else found[:117] + '...'} |"
        )
    data_s = next(iter(table[CLOSED].values())).target_data_s
    head = (
        f"Diagnosed from {data_s:.0f} s of poses, then closed. The controller's gap is that of u_s to the oracle; "
        f"– where it is below {1e3 * FLOOR_M:.0f} mm. The policy is trained on only where, in the diagnosed simulator, "
        "the map alone leaves more than that."
    )
    if shares:
        head += f" Median share closed: {np.median(shares):.0%} of {len(shares)} gaps, the least {min(shares):.0%}."
    return [head, "\n".join(rows)]


def best_of_ours(table: Table, scenarios: list[str]) -> str:
    """The smallest mean error among our methods, per scenario."""
    rows = ["| scenario | u_s | best of ours | by |", "|---|---:|---:|---|"]
    for scenario in scenarios:
        best = min((table[method][scenario].mean_m, method) for method in OURS if method in table)
        rows.append(f"| {scenario} | {metres(table[SOURCE][scenario].mean_m)} | {metres(best[0])} | {best[1]} |")
    return "\n".join(rows)


def metres(value: float) -> str:
    """Millimetres as far as they matter."""
    if not np.isfinite(value):
        return "diverged"
    return f"{value:.4f}" if value < 0.1 else f"{value:.2f}"


def percent(share: float | None) -> str:
    """A share, or a dash where there was no gap."""
    return "–" if share is None else f"{share:.0%}"


def draw(table: Table, path: Path) -> None:
    """Mean error of every method in every scenario as a heat map."""
    methods, scenarios = list(table), list(next(iter(table.values())))
    mean = np.array([[table[m][s].mean_m for m in methods] for s in scenarios])
    figure, axes = plt.subplots(figsize=(3 + 0.75 * len(methods), 2 + 0.3 * len(scenarios)), layout="constrained")
    shown = axes.imshow(np.log10(np.clip(mean, 1e-3, 10.0)), cmap="viridis_r", vmin=-3, vmax=1, aspect="auto")
    axes.set_xticks(range(len(methods)), methods, rotation=55, ha="left", rotation_mode="anchor")
    axes.xaxis.tick_top()
    axes.set_yticks(range(len(scenarios)), scenarios)
    for (i, j), value in np.ndenumerate(mean):
        text = f"{1e3 * value:.1f}" if value < 0.0995 else f"{1e3 * value:.0f}"
        axes.text(j, i, text, ha="center", va="center", fontsize=8, color="white" if value > 0.03 else "black")
    bar = figure.colorbar(shown, ax=axes, ticks=range(-3, 2), shrink=0.5)
    bar.ax.set_yticklabels(["1 mm", "1 cm", "10 cm", "1 m", "10 m"])
    axes.set_xlabel("mean position error for t ≥ 10 s [mm]")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)
