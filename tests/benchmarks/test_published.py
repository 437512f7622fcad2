"""Tables in the documents say where they come from, are not old, and have no rows of their own."""

import re
from dataclasses import replace

import pytest

from auv_torchrl.paths import PROJECT
from benchmarks import provenance
from benchmarks.published import RESULTS, SECTIONS, copied, problems, publish

HISTORY = pytest.mark.skipif(
    not provenance.has_history(), reason="ages are counted in commits: no repository here, or a shallow one"
)
DOCUMENTS = sorted({section.document for section in SECTIONS.values()})
TABLE2 = SECTIONS["benchmarks.md", "table2"]
ONE = {("benchmarks.md", "table2"): TABLE2}
LINE = "Made by `python -m benchmarks.control table2` at commit `0123abc` on 2026-11-26."
HEAD = "| scenario | vehicle | starts within | u_t |\n|---|---|---|---|"
ROW = "| swap | paper | ±1 m | 0.0019 |"


def page(*lines, line=LINE):
    """A document with a Table 2."""
    begin, end = TABLE2.marks
    return "\n".join(["# Benchmarks", begin, "", line, "", HEAD, *lines, "", end, ""])


def said(text, age: int | None = 0, sections=None):
    return list(problems("benchmarks.md", text, sections or ONE, lambda commit, paths: age))


def read(name):
    return (RESULTS / name).read_text(encoding="utf-8")


@HISTORY
@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_table_of_results_is_of_a_command_and_a_commit_and_not_old(document):
    """No table is older than the code that it measures by more commits than its kind allows, none has odd rows."""
    assert list(problems(document, read(document), SECTIONS, provenance.age)) == []


@pytest.mark.parametrize("document", DOCUMENTS)
def test_tables_are_in_order_without_a_history_too(document):
    """Where ages cannot be counted, marks, lines and rows still can be read."""
    assert list(problems(document, read(document), SECTIONS, lambda commit, paths: 0)) == []


def test_figures_of_readme_are_those_of_the_documents():
    """Tables of README repeat figures of published tables and have none of their own."""
    documents = {name: read(name) for name in DOCUMENTS}
    readme = (PROJECT / "README.md").read_text(encoding="utf-8")
    assert list(copied(readme, documents)) == []
    (odd,) = copied(readme.replace("| 0.1132 m | 0.0019 m |", "| 0.1132 m | 0.0012 m |", 1), documents)
    assert odd.startswith("README: swap has 0.0012")


def test_a_table_that_is_well_has_no_problem():
    """A line, a commit that is not old, and a row of the command."""
    assert said(page(ROW), age=TABLE2.most) == []


def test_a_table_without_its_line_is_told():
    """Nobody knows what it was made at."""
    (problem,) = said(page(ROW, line="Measured in May."))
    assert "no line 'Made by ... at commit ...'" in problem


def test_a_table_that_is_too_old_is_told_with_its_command():
    """One commit more than allowed is too many, and the sentence says what to run."""
    (problem,) = said(page(ROW), age=TABLE2.most + 1)
    assert f"{TABLE2.most + 1} commits have touched" in problem
    assert "run python -m benchmarks.control table2" in problem


def test_a_commit_that_nobody_has_is_told():
    """A line with a commit that is not in the history stands for nothing."""
    (problem,) = said(page(ROW), age=None)
    assert "0123abc, which this history does not have" in problem


@pytest.mark.parametrize("row", ["| sunk | paper | ±1 m | 0.0001 |", "| swap | bluerov2 | ±1 m | 0.0001 |"])
def test_a_row_that_no_command_prints_is_told(row):
    """A row that somebody added by hand is named, also where its first cell alone is known."""
    (problem,) = said(page(ROW, row))
    assert "cannot print the row" in problem and row.split(" | ")[1] in problem


def test_a_table_outside_the_marks_is_told():
    """A document of results has no table that nothing makes."""
    (problem,) = said(page(ROW) + "\n| seed | right |\n|---|---|\n| 0 | all |\n")
    assert "'seed | right ...' is in no section" in problem


def test_marks_that_are_missing_are_told():
    """A section of the registry that a document lacks is named with its marks."""
    (problem,) = said("# Benchmarks\n")
    assert TABLE2.marks[0] in problem


@HISTORY
def test_ages_count_commits_that_touched_the_paths():
    """The last commit has no age; the first one has one for every commit that touched a path since."""
    assert provenance.age("HEAD", ["auv_torchrl"]) == 0
    assert provenance.age("0" * 40, ["auv_torchrl"]) is None
    older = provenance.age("HEAD~20", ["auv_torchrl", "benchmarks", "docs", "tests"])
    assert older is not None and older > (provenance.age("HEAD~20", ["no/such/path"]) or 0)


def test_what_a_table_measures_exists():
    """A path that was renamed would let a table stay young for ever."""
    assert [path for s in SECTIONS.values() for path in s.measures if not (PROJECT / path).exists()] == []


def test_publishing_writes_the_line_and_refuses_when_the_code_has_moved_on(tmp_path, monkeypatch):
    """The command writes its own commit; commits in between to what it measured are an error."""
    document = tmp_path / "benchmarks.md"
    document.write_text("\n".join(["before", *TABLE2.marks, "after"]))
    command = "python -m benchmarks.control table2"
    monkeypatch.setattr(provenance, "age", lambda commit, paths: 0)
    publish(document, "table2", f"{HEAD}\n{ROW}", command, "0123abc")
    text = document.read_text()
    assert text.startswith("before\n") and text.endswith("\nafter")
    assert provenance.read_line(text) == (command, "0123abc", text.partition(" on ")[2][:10])
    assert said(text) == []
    monkeypatch.setattr(provenance, "age", lambda commit, paths: 2)
    with pytest.raises(ValueError, match="2 commits behind: measure again"):
        publish(document, "table2", HEAD, command, "0123abc")
    assert document.read_text() == text


def test_a_section_may_be_as_old_as_it_says():
    """The number of commits is that of the section."""
    patient = {key: replace(section, most=500) for key, section in ONE.items()}
    assert said(page(ROW), age=400, sections=patient) == []


def test_code_that_is_not_committed_is_not_published(monkeypatch):
    """A table names a commit, so its code must be one."""
    monkeypatch.setattr(provenance, "_git", lambda *a: " M auv_torchrl/vehicle.py" if a[0] == "status" else "0123abc")
    with pytest.raises(ValueError, match=r"changed since the last commit: auv_torchrl/vehicle.py: commit"):
        provenance.committed()
    monkeypatch.setattr(provenance, "_git", lambda *a: None)
    with pytest.raises(ValueError, match="no git repository"):
        provenance.committed()
    assert not provenance.has_history()


def test_the_registry_has_one_entry_for_each_pair_of_marks():
    """What stands between marks in a document is in the registry."""
    for document in DOCUMENTS:
        marked = set(re.findall(r"<!-- ([\w ]+): begin -->", read(document)))
        assert marked == {name for own, name in SECTIONS if own == document}
