"""Every table of results in the documents: what makes it, what it measures, which rows it may have.

A section stands between two marks, and only :func:`publish` writes there. ``problems`` is what a test asks of every
document: each table of results is in a section, each section names a commit, none is too old, and no row is there
that its command could not have printed.
"""

import re
from argparse import ArgumentParser
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from auv_torchrl.paths import PROJECT
from benchmarks import provenance, replace_between, rows
from benchmarks.rows import Rows

RESULTS = PROJECT / "docs" / "results"  # the documents
Age = Callable[[str, Iterable[str]], int | None]  # of a commit, in commits that touched some paths; None: not there

# How many commits may touch what a table measures before it is flown anew: a busy day, whose commits mostly change
# words and shapes.
QUICK = 90  # flown in minutes
# An hour of all methods, of which one is the diagnosis, or of a firmware that is not at hand everywhere: three days of
# 70 commits.
LONG = 200
# The diagnosis changes by 50 to 80 commits a day, and a sealed run takes up to an hour: two days.
SEALED = 120

_MOTION = (
    "auv_torchrl/physics",
    "auv_torchrl/simulator",
    "auv_torchrl/effects",
    "auv_torchrl/vehicle",
    "conf/vehicle",
)
_FLEET = (*_MOTION, "auv_torchrl/envs", "auv_torchrl/tasks", "conf/randomization")
_AGENTS = (*_FLEET, "auv_torchrl/agents", "auv_torchrl/evaluation.py", "conf/agent")
_SCENARIOS = (*_AGENTS, "auv_torchrl/scenario.py", "conf/scenario")
_ADAPTATION = (
    *_SCENARIOS, "auv_torchrl/adaptation", "auv_torchrl/compensation", "auv_torchrl/ddr", "auv_torchrl/sensors",
    "conf/adaptation", "conf/adapter",
)  # fmt: skip
_DIAGNOSIS = (*_MOTION, "auv_torchrl/diagnosis", "auv_torchrl/sensors", "conf/diagnosis")
_READ = ("auv_torchrl/diagnosis", "auv_torchrl/sysid", "auv_torchrl/monitoring")
_LOGS = (*_DIAGNOSIS, "auv_torchrl/flightlog")
_ALIKE = (*_MOTION, "auv_torchrl/monitoring", "auv_torchrl/sensors")  # runs of one manoeuvre have a way of their own


@dataclass(frozen=True)
class Section:
    """What stands between two marks of a document."""

    document: str
    name: str  # in its marks
    measures: tuple[str, ...]  # paths of code
    most: int  # commits that may have touched these since
    rows: Rows  # first cells of the rows that its command can print

    @property
    def marks(self) -> tuple[str, str]:
        """The lines before and behind it."""
        return f"<!-- {self.name}: begin -->", f"<!-- {self.name}: end -->"


def _bench(name: str, measures: tuple[str, ...], most: int = QUICK) -> Section:
    return Section("benchmarks.md", name, measures, most, partial(rows.of_bench, name))


def _blind(part: str | None) -> Section:
    name = "blind" if part is None else f"blind {part}"
    return Section("diagnosis.md", name, _DIAGNOSIS, SEALED, partial(rows.of_sealed, part))


def _real(name: str, measures: tuple[str, ...], most: int = SEALED) -> Section:
    return Section("real.md", name, measures, most, partial(rows.of_real, name))


def _underway(part: str, measures: tuple[str, ...], most: int) -> Section:
    return Section("other-vehicles.md", part, measures, most, partial(rows.of_underway, part))


SECTIONS = {
    (section.document, section.name): section
    for section in (
        _bench("env_steps", _FLEET),
        _bench("simulated_seconds", _FLEET),
        _bench("sac_updates", ("auv_torchrl/agents", "conf/agent")),
        _bench("time_to_error", _AGENTS),
        _bench("agents", _SCENARIOS),
        _bench("table2", _ADAPTATION),
        _bench("fault_recovery", _ADAPTATION),
        _bench("tank_run", _ADAPTATION),
        _bench("tracking", _ADAPTATION),
        _bench("tasks", _ADAPTATION),
        _bench("comparison", (*_ADAPTATION, "auv_torchrl/baselines", "auv_torchrl/diagnosis"), LONG),
        *(_blind(part) for part in (None, "stock", "dvl", "mocap", "strangers_2", "strangers_5")),
        _real("bluerov2", _LOGS),
        *(_real(name, _LOGS) for name in ("ardusub", "ardusub_healthy", "ardusub_wrong_file", "ardusub_altered")),
        _real("ardusub_vectored", _LOGS),
        _real("haizhe", _ALIKE, QUICK),
        _real("rov2016", _LOGS),
        _real("orca", (*_LOGS, "auv_torchrl/monitoring")),
        _real("saab", _LOGS),
        Section("trial.md", "trial", (*_LOGS, "auv_torchrl/link"), LONG, rows.of_trial),
        *(Section("ablation.md", name, _DIAGNOSIS, SEALED, rows.of_without) for name in ("without", "without_some")),
        *(
            Section("ablation.md", name, _DIAGNOSIS, SEALED, rows.of_paired)
            for name in ("paired", "paired stock", "paired dvl", "paired strangers")
        ),
        Section("ablation.md", "size", _READ, SEALED, rows.of_size),
        *(
            Section("owners.md", f"owners {sensors}", _DIAGNOSIS, SEALED, rows.of_owners)
            for sensors in ("mocap", "dvl", "stock")
        ),
        _underway("control", (*_ADAPTATION, "auv_torchrl/experiment", "conf/experiment/cruise.yaml"), QUICK),
        _underway("paths", (*_AGENTS, "auv_torchrl/experiment", "conf/experiment/cruise.yaml", "conf/task"), QUICK),
        _underway("dives", _DIAGNOSIS, SEALED),
        _underway(
            "control milliampere", (*_ADAPTATION, "auv_torchrl/experiment", "conf/experiment/cruise.yaml"), QUICK
        ),
        _underway("dives milliampere", _DIAGNOSIS, SEALED),
        Section("comparison.md", "versus", (*_DIAGNOSIS, "auv_torchrl/export/mjcf.py"), SEALED, rows.of_versus),
        Section("dives.md", "dives", (*_DIAGNOSIS, "auv_torchrl/monitoring"), SEALED, rows.of_dives),
    )
}

COPIED = {  # tables of README, by the first cells of their heads: the sections whose figures they repeat
    "scenario | what happens to the vehicle": ("benchmarks.md", "table2"),
    "method | target data": ("benchmarks.md", "comparison"),
}
BY_ROW = {"table2"}  # whose rows have the same names there and in README; of others all figures count


def commit_to_name(parser: ArgumentParser, document: Path, name: str, publishes: bool) -> str:
    """The commit that a section is to name; empty where it is printed alone.

    Ends the command of the parser with one line where the code is no commit.
    """
    try:
        return provenance.committed(SECTIONS[document.name, name].measures) if publishes else ""
    except ValueError as error:
        parser.error(str(error))


def publish(document: Path, name: str, text: str, command: str, commit: str) -> None:
    """Write a section: its line, and what its command printed.

    Raises:
        ValueError: if the document lacks the marks, or the code has changed since ``commit``.
    """
    section = SECTIONS[document.name, name]
    if (touched := provenance.age(commit, section.measures)) != 0:
        since = "is not in this history" if touched is None else f"is {touched} commits behind"
        raise ValueError(f"{name} was measured at {commit}, which {since}: measure again, at one commit")
    line = provenance.made_by(command, commit)
    replace_between(document, *section.marks, f"\n\n{line}\n\n{text.strip()}\n\n")


def problems(document: str, text: str, sections: Mapping[tuple[str, str], Section], age: Age) -> Iterator[str]:
    """What is wrong with the tables of a document, one line each, with what to do about it."""
    mine = {section.name: section for (own, _), section in sections.items() if own == document}
    found = {name: own for name, section in mine.items() if (own := _between(text, *section.marks)) is not None}
    for name in mine.keys() - found.keys():
        yield f"{document} lacks the marks {' and '.join(mine[name].marks)}: put both where its table belongs"
    rest = text
    for name, own in found.items():
        rest = rest.replace(own, "")
        yield from _of_section(mine[name], own, age)
    for head, *_ in tables(rest):
        start = " | ".join(head[:2])
        yield f"{document}: the table '{start} ...' is in no section of benchmarks/published.py: add one"


def copied(readme: str, documents: Mapping[str, str]) -> Iterator[str]:
    """Figures in tables of README that are not in the row of the same name in the section they come from."""
    for head, *lines in tables(readme):
        source = next((COPIED[start] for start in COPIED if " | ".join(head[:2]).startswith(start)), None)
        if source is None:
            continue
        section = SECTIONS[source]
        published = _between(documents[source[0]], *section.marks) or ""
        rows_there = [cells for _, *body in tables(published) for cells in body]
        for cells in lines:
            label = cells[0].strip("`")
            mine = [own for own in rows_there if own[0] == label or section.name not in BY_ROW]
            known = {figure for own in mine for cell in own[1:] for figure in figures(cell)}
            given = {figure for cell in cells[2:] for figure in figures(cell) if "." in figure}
            if odd := given - known:
                there = f"docs/results/{source[0]}"
                yield f"README: {label} has {', '.join(sorted(odd))}, unlike {there}: copy its row anew"


def tables(text: str) -> Iterator[list[list[str]]]:
    """The tables of a text, each as its head and rows of cells; tables in blocks of code are none."""
    lines: list[list[str]] = []
    for line in [*re.sub(r"```.*?```", "", text, flags=re.S).splitlines(), ""]:
        if line.startswith("|"):
            lines.append([cell.strip() for cell in line.strip().strip("|").split(" | ")])
        elif lines:
            yield [lines[0], *lines[2:]]
            lines = []


def figures(cell: str) -> list[str]:
    """The numbers of a cell, as they are written."""
    return re.findall(r"\d+(?:\.\d+)?", cell)


def _of_section(section: Section, text: str, age: Age) -> Iterator[str]:
    where = f"{section.document}, {section.name}"
    made = provenance.read_line(text)
    if made is None:
        yield f"{where}: no line 'Made by ... at commit ...': its command writes one, nobody else"
        return
    touched = age(made.commit, section.measures)
    if touched is None:
        yield f"{where}: made at {made.commit}, which this history does not have: run {made.command}"
    elif touched > section.most:
        since = f"{touched} commits have touched what it measures since {made.commit}"
        yield f"{where}: {since}, of which {section.most} are allowed: run {made.command}"
    allowed = section.rows(made.command)
    for head, *lines in tables(text):
        for cells in lines:
            if not any(tuple(cells[:n]) in allowed for n in range(1, 4)):
                yield f"{where}: {made.command} cannot print the row '{' | '.join(cells[:2])} ...' below '{head[0]}'"


def _between(text: str, begin: str, end: str) -> str | None:
    _, first, rest = text.partition(begin)
    own, last, _ = rest.partition(end)
    return own if first and last else None
