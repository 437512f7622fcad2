"""The law of the documents: short pages, links that lead somewhere, one language, and references that are whole."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog.readers import READERS
from auv_torchrl.paths import OWN, PROJECT
from auv_torchrl.physics import prepare
from auv_torchrl.sensors import MOTION, read
from auv_torchrl.sensors.instruments import ages
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.vehicle.fields import SECTIONS

DOCS = PROJECT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
RESULTS = DOCS / "results"  # generated: as long as their tables
LONGEST = 12_000  # bytes: what a tired reader takes in at one sitting
PRIVATE = ("slack", "knob", "sketch", "judged", "tidied", "leaner", "owed")  # the glossary has the words to use
PUBLISHED = re.compile(r"<!-- ([\w ]+): begin -->.*?<!-- \1: end -->", re.S)
CODE = re.compile(r"^```.*?^```|`[^`]+`", re.S | re.M)
LINK = re.compile(r"\[[^]]*\]\(([^)\s]+)\)", re.S)
NAMED = re.compile(r"\bdocs/[\w/.-]+\.md\b")  # a page that a program or a setting speaks of
SOURCES = ("auv_torchrl", "benchmarks", "conf", "examples", "tests")


def name_of(page: Path) -> str:
    """A page as a test is called by it."""
    return str(page.relative_to(PROJECT))


def prose(path: Path) -> str:
    """A page without code and without what a command has written between marks."""
    return CODE.sub("", PUBLISHED.sub("", path.read_text(encoding="utf-8")))


@cache
def anchors(path: Path) -> frozenset[str]:
    """The anchors of the headings of a page, as GitHub makes them."""
    found: list[str] = []
    for heading in re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```", "", path.read_text(), flags=re.S | re.M), re.M):
        slug = re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-")
        found.append(slug if slug not in found else f"{slug}-{found.count(slug)}")
    return frozenset(found)


def broken(path: Path) -> list[str]:
    """Relative links of a page that lead to no file or to no heading."""
    lost = []
    for link in LINK.findall(CODE.sub("", path.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", link):
            continue
        file, _, anchor = link.partition("#")
        target = (path.parent / file).resolve() if file else path
        if not target.exists() or (anchor and anchor not in anchors(target)):
            lost.append(link)
    return lost


def own(tmp_path: Path, page: str, folder: str, word: str) -> None:
    """Put the example of a page into a folder of one's own."""
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / "how-to" / page).read_text(), re.S)
    (tmp_path / folder).mkdir()
    (tmp_path / folder / "example.py").write_text(next(block for block in blocks if word in block))


@pytest.mark.parametrize("page", [p for p in PAGES if RESULTS not in p.parents], ids=name_of)
def test_a_page_is_read_at_one_sitting(page):
    """No page that is written by hand has more than 12 kB."""
    assert page.stat().st_size <= LONGEST


@pytest.mark.parametrize("page", [*PAGES, PROJECT / "README.md", PROJECT / "examples" / "README.md"], ids=name_of)
def test_links_lead_to_a_file_and_a_heading(page):
    """Every relative link of the documents and of README resolves, anchor included."""
    assert broken(page) == []


def test_a_link_that_leads_nowhere_is_found(tmp_path):
    """A file, a heading and a heading of the page itself are each looked up."""
    page = tmp_path / "page.md"
    page.write_text("# One thing\n[a](page.md#one-thing) [b](#one-thing) [c](gone.md) [d](#two) `[e](gone.md)`\n")
    assert broken(page) == ["gone.md", "#two"]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_documents_speak_the_language_of_the_glossary(page):
    """No word that only its author knows stands in prose; names of settings and published tables keep theirs."""
    assert re.findall(rf"\b(?:{'|'.join(PRIVATE)})\b", prose(page), re.I) == []


def test_every_page_is_reached_from_the_first_one():
    """Whoever begins at docs/README.md comes to every page by its links."""
    seen: set[Path] = set()
    ahead = [DOCS / "README.md"]
    while ahead:
        page = ahead.pop()
        seen.add(page)
        links = [link.partition("#")[0] for link in LINK.findall(page.read_text()) if ".md" in link]
        found = {(page.parent / link).resolve() for link in links if not re.match(r"[a-z]+:", link)}
        ahead += [other for other in found if other in PAGES and other not in seen]
    assert set(PAGES) == seen


def test_pages_that_programs_and_settings_name_exist():
    """A message, a comment or a target of make that sends somebody to a page has the page's path right."""
    files = [path for folder in SOURCES for path in (PROJECT / folder).rglob("*") if path.suffix in (".py", ".yaml")]
    named = {page for path in [*files, PROJECT / "Makefile"] for page in NAMED.findall(path.read_text())}
    assert named and [page for page in sorted(named) if not (PROJECT / page).is_file()] == []


def test_the_reference_has_every_effect_and_every_entry_of_a_vehicle_file():
    """A new effect or field is looked up there."""
    effects, vehicle = ((DOCS / "reference" / name).read_text() for name in ("effects.md", "vehicle-file.md"))
    assert [name for name in EFFECTS if f"| `{name}` |" not in effects] == []
    entries = [name for section in SECTIONS.values() for name in section]
    assert [name for name in entries if f"| `{name}` |" not in vehicle and f"## {name}\n" not in vehicle] == []


def test_the_example_sensor_takes_over_its_channel(tmp_path, monkeypatch):
    """The echo sounder of the how-to page reports a depth that is 2 % too large and 0.3 s old."""
    own(tmp_path, "add-a-sensor.md", "sensors", "Sensor(")
    monkeypatch.setenv(OWN, str(tmp_path))
    c = prepare(load_vehicle("paper")).numpy()
    report = read(c, MOTION, np.arange(1.0, 13.0)[None])  # 1 m north, 2 m east, 3 m down
    assert report[..., 2] == pytest.approx(1.02 * 3.0) and report[..., 0] == pytest.approx(1.0)
    assert ages(c, ("z",)) == pytest.approx(0.3)


def test_the_example_reader_recognizes_its_files(tmp_path, monkeypatch):
    """The reader of the how-to page is among the readers, and knows its files by their first bytes."""
    own(tmp_path, "add-a-log-reader.md", "readers", "Reader(")
    monkeypatch.setenv(OWN, str(tmp_path))
    reader = READERS["my logger"]
    assert reader.recognizes(b"MINE...") and not reader.recognizes(b"")
