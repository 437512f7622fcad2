"""Write the tables as Markdown, beside the answers and between the markers of a document."""

import shutil
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from auv_torchrl.files import write_whole
from benchmarks.blind.figures import draw_figures
from benchmarks.blind.judge import Judgement
from benchmarks.blind.score import tables
from benchmarks.blind.seal import write_json
from benchmarks.blind.table import Table

BEGIN, END = "<!-- blind: begin -->", "<!-- blind: end -->"
FIGURES = "figures"  # beside the document
CAPTIONS = {
    "confusion": "Truth against first answer",
    "reliability": "Probability of the answer against how often it is right",
    "severity": "Accuracy against severity",
}


def write_report(judgements: Sequence[Judgement], folder: Path, command: str) -> str:
    """Write results.json, results.md and the pictures to ``folder``; give back the Markdown."""
    write_json(folder / "results.json", [asdict(j) for j in judgements])
    pictures = draw_figures(judgements, folder)
    text = "\n\n".join(
        [
            f"{len(judgements)} sealed logs; `{command}`.",
            *(markdown(t) for t in tables(judgements)),
            *map(_picture, pictures),
        ]
    )
    write_whole(folder / "results.md", (text.replace(f"({FIGURES}/", "(") + "\n").encode())
    return text


def markdown(table: Table) -> str:
    """A table under its title; a sentence where it is empty."""
    lines = [f"### {table.title}", ""]
    if not table.rows:
        return "\n".join([*lines, "None."])
    lines += ["| " + " | ".join(table.head) + " |", "|" + "---|" * len(table.head)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in table.rows])


def publish(text: str, pictures: Path, document: Path) -> None:
    """Replace what stands between the markers of ``document`` and copy the pictures beside it.

    Raises:
        ValueError: if the document does not have both markers, in order.
    """
    before, begin, rest = document.read_text(encoding="utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{document} has no {BEGIN} followed by {END}: put both where the tables belong")
    (document.parent / FIGURES).mkdir(exist_ok=True)
    for name in CAPTIONS:
        if (pictures / f"{name}.png").exists():
            shutil.copyfile(pictures / f"{name}.png", document.parent / FIGURES / f"{name}.png")
    write_whole(document, f"{before}{BEGIN}\n\n{text}\n\n{END}{after}".encode())


def _picture(path: Path) -> str:
    return f"![{CAPTIONS[path.stem]}]({FIGURES}/{path.name})"
