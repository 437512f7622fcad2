"""The commands that pages show, and the options that they speak of, are taken as they stand."""

import re
from pathlib import Path

import pytest

from auv_torchrl.page.command import parser
from auv_torchrl.paths import CONF, PROJECT
from tests.documented import INLINE, MODULES, blocks, filled, inline, plain, settings, take, words_of

RESULTS = PROJECT / "docs" / "results"
PAGES = [
    page
    for page in (
        *sorted((PROJECT / "docs").rglob("*.md")),
        *(PROJECT / name / "README.md" for name in ("examples", "extension")),
    )
    if RESULTS not in page.parents
]
SHOWN = [(page.relative_to(PROJECT), line) for page in PAGES for line in blocks(page.read_text())]
SAID = [(page.relative_to(PROJECT), line) for page in PAGES for line in inline(page.read_text())]
OF_ALL = {"help", "version", "cfg", "config-dir", "completion"}
OTHERS = {"home"}  # of ArduSub


def ids(pair: tuple[Path, str]) -> str:
    return f"{pair[0].stem}: {pair[1]}"


@pytest.mark.parametrize("shown", SHOWN, ids=ids)
def test_a_command_of_a_page_is_taken_as_it_stands(shown, tmp_path, monkeypatch):
    """Options, settings and names are those that there are, and a setting is given as an option."""
    program, words = words_of(shown[1])
    monkeypatch.chdir(tmp_path)
    for word in words:
        if word.endswith(".yaml"):
            (tmp_path / word).write_text((CONF / "vehicle" / "bluerov2_heavy.yaml").read_text())
    take(program, words)
    assert settings(program, words) == []


@pytest.mark.parametrize("said", SAID, ids=ids)
def test_a_command_within_a_sentence_has_the_options_of_the_command(said):
    """FILE, NAME and their like stand for what is put there."""
    program, words = words_of(said[1])
    if words:
        take(program, filled(words), names=False)
    assert settings(program, words) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(PROJECT)))
def test_an_option_that_a_page_speaks_of_is_one_of_a_command(page):
    """Of some command, or of all."""
    known = {name.replace("_", "-") for program in MODULES for name in plain(program).LINE.options} | OF_ALL | OTHERS
    known |= {option.lstrip("-") for action in parser()._actions for option in action.option_strings}
    named = [found[1] for code in INLINE.findall(page.read_text()) if (found := re.match(r"--([a-z][a-z-]+)", code))]
    assert [name for name in named if name not in known] == []
