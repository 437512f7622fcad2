"""The whole benchmark, small."""

import json
import subprocess
import sys

import pytest

SMALL = ("cases=6", "workers=2", "seed=3")


def blind(*overrides):
    return subprocess.run([sys.executable, "-m", "benchmarks.blind", *overrides], capture_output=True, text=True)


@pytest.mark.slow
def test_six_sealed_cases_are_flown_diagnosed_and_scored(tmp_path):
    """No diagnosis crashes, most are right, the report is written, and a killed run goes on where it was."""
    folder = tmp_path / "blind"
    done = blind(*SMALL, f"folder={folder}")
    assert done.returncode == 0, done.stderr
    assert "single effect named first" in done.stdout
    (answers,) = folder.glob("diagnosis_*")
    results = json.loads((answers / "results.json").read_text())
    assert len(results) == 6
    assert not [r["message"] for r in results if r["message"]]
    assert sum(r["right"] for r in results) >= 4
    assert (answers / "confusion.png").exists() and "Cases that fail" in (answers / "results.md").read_text()

    given = {path: path.stat().st_mtime_ns for path in answers.glob("case_*.json")}
    lost = sorted(given)[2]
    lost.unlink()
    again = blind(*SMALL, f"folder={folder}")
    assert again.returncode == 0, again.stderr
    assert lost.exists()
    assert all(path.stat().st_mtime_ns == then for path, then in given.items() if path != lost)


def test_a_folder_of_other_cases_is_refused(tmp_path):
    """Settings that differ from those of the folder are an error of one line, and nothing is flown."""
    folder = tmp_path / "blind"
    folder.mkdir()
    settings = {"cases": 5, "seed": 0, "families": {}}
    (folder / "manifest.json").write_text(json.dumps({"settings": settings, "labels_sha256": "", "tasks": {}}))
    done = blind("cases=6", f"folder={folder}")
    assert done.returncode == 2
    assert "choose another folder" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("override", "message"), [("families.singel=1", "did you mean single"), ("cases=0", "1 or more")]
)
def test_bad_settings_are_refused(tmp_path, override, message):
    """A misspelt family and an impossible number are errors of one line."""
    done = blind(override, f"folder={tmp_path / 'blind'}")
    assert done.returncode == 2, done.stderr
    assert message in done.stderr and "Traceback" not in done.stderr
