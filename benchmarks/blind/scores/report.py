"""Write the tables as Markdown, beside the answers and between the markers of a document."""

import shutil
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from auv_torchrl.files import write_whole
from benchmarks import published
from benchmarks.blind.scores.judge import Judgement
from benchmarks.blind.scores.table import Table
from benchmarks.blind.seal import write_json

FIGURES = "figures"  # beside the document
CAPTIONS = {
    "confusion": "Truth against first answer",
    "reliability": "Probability of the answer against how often it is right",
    "severity": "Accuracy against severity",
}


def section(part: str | None) -> str:
    """The name of the section in which the tables of a part of the benchmark stand; None is its main part."""
    return "blind" if part is None else f"blind {part}"


def write_report(
    judgements: Sequence[Judgement], folder: Path, command: str, tables: Sequence[Table], pictures: Sequence[Path]
) -> str:
    """Write results.json and results.md to ``folder``, where the pictures are; give back the Markdown."""
    write_json(folder / "results.json", [asdict(j) for j in judgements])
    head = f"{len(judgements)} sealed logs; `{command}`."
    text = "\n\n".join([head, *map(markdown, tables), *map(_picture, pictures)])
    write_whole(folder / "results.md", (text.replace(f"({FIGURES}/", "(") + "\n").encode())
    return text


def markdown(table: Table) -> str:
    """A table under its title; a sentence where it is empty."""
    lines = [f"### {table.title}", ""]
    if not table.rows:
        return "\n".join([*lines, "None."])
    lines += ["| " + " | ".join(table.head) + " |", "|" + "---|" * len(table.head)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in table.rows])


def publish(text: str, pictures: Path, document: Path, part: str | None, command: str, commit: str) -> None:
    """Replace what stands between the marks of ``document`` and copy the pictures beside it.

    Raises:
        ValueError: if the document does not have both marks, in order, or the code has changed since ``commit``.
    """
    published.publish(document, section(part), text, command, commit)
    (document.parent / FIGURES).mkdir(exist_ok=True)
    for name in CAPTIONS:
        if (pictures / f"{name}.png").exists():
            shutil.copyfile(pictures / f"{name}.png", document.parent / FIGURES / f"{name}.png")


def _picture(path: Path) -> str:
    return f"![{CAPTIONS[path.stem]}]({FIGURES}/{path.name})"
