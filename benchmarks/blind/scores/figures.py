"""Pictures of the benchmark: confusion, reliability, accuracy against severity."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from auv_torchrl.effects import EFFECTS
from auv_torchrl.palette import NEUTRAL, U_T
from benchmarks.blind.scores.judge import Judgement
from benchmarks.blind.scores.score import INFLUENCE_EDGES, calibration, calibration_cases, of_families
from benchmarks.blind.scores.table import Share, calibration_error


def draw_figures(judgements: Sequence[Judgement], folder: Path) -> list[Path]:
    """Write confusion.png, reliability.png and severity.png; those without any case are left out."""
    paths = []
    for name, figure in (
        ("confusion", confusion(judgements)),
        ("reliability", reliability_diagram(judgements)),
        ("severity", severity(judgements)),
    ):
        if figure is not None:
            paths.append(folder / f"{name}.png")
            figure.savefig(paths[-1], dpi=120, bbox_inches="tight")
            plt.close(figure)
    return paths


def confusion(judgements: Sequence[Judgement]) -> Figure | None:
    """Truth against first answer, for single effects, no gap and effects outside the library."""
    cases = [*calibration_cases(judgements), *of_families(judgements, "outside")]
    if not cases:
        return None
    seen = {j.truth for j in cases} | {j.answer for j in cases}
    names = [name for name in (*EFFECTS, "no_gap", "unknown", "error") if name in seen]
    count = np.zeros((len(names), len(names)), dtype=int)
    for j in cases:
        count[names.index(j.truth), names.index(j.answer)] += 1
    share = count / np.maximum(count.sum(axis=1, keepdims=True), 1)
    figure, axes = plt.subplots(figsize=(0.36 * len(names) + 3, 0.36 * len(names) + 2))
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1)
    for row, column in zip(*np.nonzero(count), strict=True):
        colour = "white" if share[row, column] > 0.5 else "black"
        axes.text(column, row, str(count[row, column]), ha="center", va="center", fontsize=7, color=colour)
    labels = [name.replace("_", " ") for name in names]
    axes.set_xticks(range(len(names)), labels, rotation=90, fontsize=8)
    axes.set_yticks(range(len(names)), labels, fontsize=8)
    axes.set(xlabel="first answer", ylabel="truth", title=f"{len(cases)} sealed logs")
    return figure


def reliability_diagram(judgements: Sequence[Judgement]) -> Figure | None:
    """Probability of the answer against how often it is right."""
    bins = calibration(judgements)
    if not bins:
        return None
    figure, axes = plt.subplots(figsize=(4.5, 4.2))
    axes.plot([0, 1], [0, 1], color=NEUTRAL, linewidth=1)
    axes.errorbar([b.probability for b in bins], *_bars([b.right for b in bins]), fmt="o", color=U_T, capsize=2)
    for b in bins:
        place = (b.probability, b.right.value)
        axes.annotate(str(b.right.n), place, (-5, -10), textcoords="offset points", fontsize=7, ha="right")
    axes.set(xlim=(0, 1.02), ylim=(0, 1.02), xlabel="probability of the answer", ylabel="share that is right")
    axes.set_title(f"expected calibration error {calibration_error(bins):.3f}", fontsize=10)
    return figure


def severity(judgements: Sequence[Judgement]) -> Figure | None:
    """How often the effect is named, and how often no gap is seen, against how much it shows."""
    cases = [j for j in of_families(judgements, "single", "single_slack", "severity") if j.influence is not None]
    if not cases:
        return None
    edges = np.array([0.2, *INFLUENCE_EDGES[1:-1], 500.0])
    centre, named, unseen = [], [], []
    for low, high in zip(edges, edges[1:], strict=False):
        mine = [j for j in cases if low <= max(j.influence or 0, edges[0]) < high]
        if mine:
            centre.append(np.sqrt(low * high))
            named.append(Share.of([j.right for j in mine]))
            unseen.append(Share.of([j.verdict == "no_gap" for j in mine]))
    figure, axes = plt.subplots(figsize=(5.5, 3.6))
    for shares, colour, label in ((named, U_T, "effect named first"), (unseen, NEUTRAL, "no gap seen")):
        axes.errorbar(centre, *_bars(shares), fmt="o-", color=colour, capsize=2, label=label)
    axes.set(xscale="log", ylim=(-0.02, 1.02), ylabel="share of the logs")
    axes.set_xlabel("error at 2 s without the effect, in standard deviations of the sensors")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.legend(fontsize=8, loc="center right")
    return figure


def _bars(shares: Sequence[Share]) -> tuple[np.ndarray, np.ndarray]:
    """Values (n,), and how far their intervals reach below and above (2, n)."""
    value = np.array([share.value for share in shares])
    low, high = np.transpose([share.interval for share in shares])
    return value, np.maximum([value - low, high - value], 0)
