"""The documents as a site: built strictly, so that a page outside the contents or a lost link ends the build."""

import subprocess
import sys

import pytest
import yaml

from auv_torchrl.paths import PROJECT

pytest.importorskip("mkdocs", reason="pip install '.[docs]'")


def test_the_site_is_built_without_a_warning(tmp_path):
    """All pages, and the signatures of what other programs call."""
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    built = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    page = (tmp_path / "reference" / "python.html").read_text(encoding="utf-8")
    assert "Diagnose a log" in page or "read_flightlog" in page
    pictures = [path.name for path in (PROJECT / "docs" / "pictures").iterdir()]
    assert {path.name for path in (tmp_path / "pictures").iterdir()} == set(pictures)


def test_every_page_stands_in_the_contents():
    """In one place."""
    nav = yaml.safe_load((PROJECT / "mkdocs.yml").read_text())["nav"]
    parts = [pages for entry in nav for pages in entry.values()]
    named = [page for part in parts for page in ([part] if isinstance(part, str) else part)]
    docs = PROJECT / "docs"
    assert sorted(named) == sorted(path.relative_to(docs).as_posix() for path in docs.rglob("*.md"))
