"""Takes a command that a document shows: its options, settings and names are those that there are, files need not."""

import re
import shlex
from importlib import import_module
from pathlib import Path
from types import ModuleType

from auv_torchrl.command.arguments import quote_files, without_config_dir
from auv_torchrl.command.compose import compose
from auv_torchrl.command.own_files import own_files
from auv_torchrl.flightlog import command as log
from auv_torchrl.page.command import parser

MODULES = {
    "auv-diagnose": "monitoring.command", "diagnose.py": "monitoring.command",
    "auv-calibrate": "diagnosis.command.calibrate", "calibrate.py": "diagnosis.command.calibrate",
    "auv-export": "export.command", "auv-fly": "fly.command", "auv-sim": "link.command",
}  # fmt: skip
PROGRAMS = (*MODULES, "auv-log", "auv-page")  # all but the training's, which Hydra reads
FENCED = re.compile(r"^( *)```(?:bash|console|)\n(.*?)^\1```", re.S | re.M)
INLINE = re.compile(r"`([^`\n]+)`")


def plain(program: str) -> ModuleType:
    """The module of a command with a plain command line."""
    return import_module(f"auv_torchrl.{MODULES[program]}")


def words_of(line: str) -> tuple[str, list[str]]:
    """The program of a line as the document shows it, and its words."""
    program, *words = shlex.split(line, comments=True)
    if Path(program).name == "python" and words and words[0] in MODULES:
        program, *words = words
    return program.removeprefix(".venv/bin/"), words


def blocks(text: str) -> list[str]:
    """The lines of all blocks of a page that begin with a program of this package."""
    lines = [line.removeprefix(indent) for indent, block in FENCED.findall(text) for line in block.splitlines()]
    return [line for line in lines if shows(line)]


def inline(text: str) -> list[str]:
    """Commands within sentences."""
    return [line for line in INLINE.findall(FENCED.sub("", text)) if " " in line and "..." not in line and shows(line)]


def shows(line: str) -> bool:
    """Whether a line begins with a program of this package, as shell words."""
    first = re.match(r"(?:\.venv/bin/)?(?:python (\w+\.py)|(auv-\w+))\b", line)
    return first is not None and (first[1] or first[2]) in PROGRAMS


def take(program: str, words: list[str], names: bool = True) -> None:
    """Read a command line as the command does; ``names`` also has what it names looked up."""
    if program == "auv-log":
        log._parsed(words)
    elif program == "auv-page":
        parser().parse_args(words)
    else:
        line, schemas = plain(program).LINE, plain(program).schemas()
        words, own = without_config_dir(words)
        read = line.overrides(words)
        assert read
        if names and own is None:
            with own_files(own):
                compose(line.name, quote_files(read, line.files), schemas, line.groups)


def filled(words: list[str]) -> list[str]:
    """The words with a file where a page has FILE, NAME or their like, and where it names an action alone."""
    words = [re.sub(r"^[A-Z]+\b", "dive", word) if word[:1].isupper() else word for word in words]
    words = [f"{word}.csv" if word == "dive" else word for word in words]
    return [*words, "dive.csv"] if words in (["info"], ["convert"]) else words


def settings(program: str, words: list[str]) -> list[str]:
    """Words ``key=value`` that an option of the command stands for."""
    options = log._KEYS if program == "auv-log" else plain(program).LINE.options if program in MODULES else ()
    return [word for word in words if word.partition("=")[0].lstrip("+") in options and "=" in word]
