"""At which commit a table was made, and how many commits have touched what it measures since.

A published table begins with a line that its command writes, never a person: see :func:`made_by`.
"""

import datetime
import hashlib
import re
import subprocess
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

from auv_torchrl.paths import PROJECT

CODE = ("auv_torchrl", "benchmarks", "conf")  # whatever is measured lies in these
LINE = re.compile(r"Made by `(?P<command>[^`]+)` at commit `(?P<commit>[0-9a-f]{7,40})` on (?P<date>\d{4}-\d\d-\d\d)\.")


class Made(NamedTuple):
    """What the line of a table says."""

    command: str
    commit: str
    date: str


def made_by(command: str, commit: str) -> str:
    """The line with which a table begins, with the date of today."""
    today = datetime.datetime.now(datetime.UTC).date()
    return f"Made by `{command}` at commit `{commit}` on {today}."


def read_line(text: str) -> Made | None:
    """What the first such line of a text says; None without one."""
    found = LINE.search(text)
    return Made(**found.groupdict()) if found else None


def committed(paths: Sequence[str] = CODE) -> str:
    """The commit that a table is made at, short.

    Raises:
        ValueError: where the code is no commit: there is no repository, or files have been changed since.
    """
    changed = _git("status", "--porcelain", "--", *paths)
    commit = _git("rev-parse", "--short=7", "HEAD")
    if commit is None or changed is None:
        raise ValueError(f"{PROJECT} is no git repository: a table is published with the commit that it was made at")
    if changed:
        files = ", ".join(line[3:] for line in changed.splitlines()[:3])
        raise ValueError(f"changed since the last commit: {files}: commit, then publish; a table names its commit")
    return commit


def has_history() -> bool:
    """Whether all commits are there: not in an installed package, nor in a clone of the last few."""
    top = _git("rev-parse", "--show-toplevel")
    return top is not None and Path(top) == PROJECT and _git("rev-parse", "--is-shallow-repository") == "false"


def age(commit: str, paths: Iterable[str]) -> int | None:
    """How many commits since this one have touched any of these paths; None if the history lacks it."""
    if _git("merge-base", "--is-ancestor", commit, "HEAD") is None:
        return None
    count = _git("rev-list", "--count", "--no-merges", f"{commit}..HEAD", "--", *paths)
    return None if count is None else int(count)


@cache
def digest(paths: Sequence[str] = CODE) -> str:
    """A digest of the code as it lies there, so that results of different versions are never mixed."""
    found = hashlib.sha256()
    for path in sorted(file for one in paths for file in _files(PROJECT / one)):
        found.update(path.relative_to(PROJECT).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()[:12]


def _files(path: Path) -> Iterable[Path]:
    kinds = (".py", ".yaml")
    return [path] if path.is_file() else (file for file in path.rglob("*") if file.suffix in kinds)


def _git(*arguments: str) -> str | None:
    """What git says about the project; None where it fails or is not there."""
    try:
        done = subprocess.run(["git", *arguments], cwd=PROJECT, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return None
    return done.stdout.strip("\n") if done.returncode == 0 else None
