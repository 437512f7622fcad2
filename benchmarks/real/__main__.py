"""``python -m benchmarks.real`` (``make real``): real vehicles and firmware, as far as their logs are at hand.

Prints Markdown, section by section as they come; ``--publish`` writes it to ``docs/results/real.md`` instead: the whole
page, or the tables of the parts that are named. Each measurement is kept under ``outputs/real`` as soon as it is
there, by a digest of the code: a killed run goes on when its command is given again, and no other version takes what
it has left. Logs are looked for in the folder that ``AUV_TORCHRL_DATA`` names, else in ``../shared/data``; what is
absent is named.
"""

import argparse
import datetime
import json
import logging
import platform
import sys
import textwrap
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path

import torch

from auv_torchrl.files import write_whole
from auv_torchrl.parallel import each
from auv_torchrl.paths import PROJECT
from benchmarks import provenance, published, show_progress
from benchmarks.real import DATA
from benchmarks.real.page import PARTS, SECTIONS, Result, Section, measure
from benchmarks.scoring import Score

log = logging.getLogger(__name__)
PAGE = PROJECT / "docs" / "results" / "real.md"
KEPT = PROJECT / "outputs" / "real"
COMMAND = "python -m benchmarks.real --publish"
PACKAGES = ("numpy", "scipy", "torch", "llvmlite")
Piece = tuple[str, str]  # a section and one of its measurements


def head(commit: str) -> str:
    """What stands above all sections."""
    today = datetime.datetime.now(datetime.UTC).date()
    versions = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    meant = {"right": Score.RIGHT, "half right": Score.HALF}
    rules = "\n".join(wrapped(f"- *{name}*: {score.value}") for name, score in meant.items())
    return f"""\
# Real vehicles and firmware

`make real` measures all of this page and writes it; a table says at which commit. Nothing here is written by hand. How
the diagnosis works stands in [the diagnosis in ten sentences](../explanation/diagnosis.md).

Commit `{commit}`, {today}, Python {platform.python_version()}, {versions}, {platform.machine()}.

In the tables of flights, whose truth is known:

{rules}

What corrects the file of the vehicle is not listed under *named*; *p* is the probability of a name.
"""


def about(section: Section) -> str:
    """What the page says of a section ahead of its table."""
    return wrapped(f"{section.about} `{section.command}` prints this table alone.")


def wrapped(text: str) -> str:
    """Text in lines."""
    return textwrap.fill(text, 118, break_long_words=False, break_on_hyphens=False)


def take(data: Path, kept: Path, piece: Piece) -> tuple[Piece, Result]:
    """One measurement, from its file or made now and kept there."""
    path = kept / piece[0] / f"{piece[1]}.json"
    if path.is_file() and (before := json.loads(path.read_text()))["data"] == str(data):
        return piece, before["result"]
    result = measure(data, piece)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, json.dumps({"data": str(data), "result": result}).encode())
    return piece, result


def body(section: Section, data: Path, found: Mapping[Piece, Result]) -> str:
    """The table of a section, and what is not in it for want of a log."""
    absent = {label: lacks for label in section.labels if (lacks := section.missing(data, label))}
    results = [found[section.name, label] for label in section.labels if label not in absent]
    notes = [f"Not measured, {', '.join(absent)}: {'; '.join(dict.fromkeys(absent.values()))}."] if absent else []
    return "\n".join([*(section.lines(results) if results else ()), *([""] if results and notes else ()), *notes])


def sections(wanted: Sequence[Section], data: Path, kept: Path, jobs: int) -> Iterator[tuple[Section, str]]:
    """Each section with its table, in their order, as soon as all of it is measured."""
    pieces = [(s.name, label) for s in wanted for label in s.labels if not s.missing(data, label)]
    found: dict[Piece, Result] = {}
    begin, left = time.monotonic(), list(wanted)
    for piece, result in each(partial(take, data, kept), pieces, jobs, in_order=False):
        found[piece] = result
        minutes = (time.monotonic() - begin) / 60
        log.info("%d of %d after %.0f min: %s", len(found), len(pieces), minutes, ", ".join(piece))
        while left and not any(one not in found for one in pieces if one[0] == left[0].name):
            yield left[0], body(left[0], data, found)
            left.pop(0)
    for section in left:
        yield section, body(section, data, found)


def main() -> None:
    """Measure and print, or write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("parts", nargs="*", help=f"of {', '.join(PARTS)}; all if not given")
    parser.add_argument("--data", type=Path, default=DATA, help="folder with kth_bluerov2, ardusub_sitl, haizhe ...")
    parser.add_argument("--kept", type=Path, default=KEPT, help="where single measurements are kept")
    parser.add_argument("--jobs", type=int, default=1, help="processes at once")
    parser.add_argument("--publish", action="store_true", help=f"write {PAGE.name}, or these parts of it")
    options = parser.parse_args()
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f"no part named {', '.join(sorted(unknown))}: give some of {', '.join(PARTS)}")
    try:
        commit = provenance.committed() if options.publish else "not committed"
    except ValueError as error:
        parser.error(str(error))
    show_progress()
    torch.set_num_threads(1)
    code = provenance.digest()
    wanted = [section for section in SECTIONS if not options.parts or section.part in options.parts]
    page = [head(commit)]
    for section, table in sections(wanted, options.data.resolve(), options.kept / code, options.jobs):
        begin, end = published.SECTIONS[PAGE.name, section.name].marks
        if options.publish and options.parts:
            own = f"python -m benchmarks.real {section.part} --publish"
            published.publish(PAGE, section.name, table, own, commit)
            continue
        line = provenance.made_by(COMMAND, commit) if options.publish else ""
        page.append(
            "\n\n".join([f"## {section.title}", about(section), begin, *([line] if line else []), table, end]) + "\n"
        )
        if not options.publish:
            print(page[-1], flush=True)
    if options.publish and not options.parts:
        provenance.digest.cache_clear()
        if provenance.digest() != code:
            parser.error("the code was changed while it was measured: measure again, at one commit")
        write_whole(PAGE, "\n".join(page).encode())


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit("stopped; the same command goes on with what is not measured yet")
