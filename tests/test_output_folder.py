"""An output folder is used once: the same run goes on where it was broken off, anything else is refused as it is."""

import json
import subprocess
import sys

import pytest

from auv_torchrl.command import BadInput, claim_folder
from auv_torchrl.command.folder import discard_start, finish, is_finished, leave

SETTINGS = "seed: 0\nagent:\n  gamma: 0.95\noutput: here\n"


@pytest.fixture(autouse=True)
def left():
    """Nothing stays locked."""
    yield
    leave()


def broken_off(folder) -> None:
    """A run whose process has ended without a word."""
    claim_folder(folder, "train", SETTINGS, ["seed=0"])
    leave(folder)


def test_an_unfinished_run_goes_on_with_the_same_settings(tmp_path):
    """Its files stay, it says since when, and ``output`` may be spelt otherwise."""
    broken_off(tmp_path)
    (tmp_path / "results.json").write_text("half")
    started = json.loads((tmp_path / "run.json").read_text())["started"]
    claim_folder(tmp_path, "train", SETTINGS.replace("here", "there"), ["seed=0"])
    about = json.loads((tmp_path / "run.json").read_text())
    assert about["started"] == started and len(about["continued"]) == 1 and about["finished"] is None
    assert (tmp_path / "results.json").read_text() == "half"


def test_other_settings_are_refused_by_name(tmp_path):
    """With the value there and the value here."""
    broken_off(tmp_path)
    with pytest.raises(
        BadInput, match=r"other settings \(agent.gamma is 0.95 there and 0.9 here; seed is 0 there and 1"
    ):
        claim_folder(tmp_path, "train", SETTINGS.replace("seed: 0", "seed: 1").replace("0.95", "0.9"))
    with pytest.raises(BadInput, match="already used"):
        claim_folder(tmp_path, "diagnose", SETTINGS)


@pytest.mark.parametrize("content", [b"a: [", b"\xff"], ids=str)
def test_an_unfinished_run_whose_settings_were_damaged_is_refused(tmp_path, content):
    """Whether it was the same run cannot be told."""
    broken_off(tmp_path)
    (tmp_path / "config.yaml").write_bytes(content)
    with pytest.raises(BadInput, match=r"unfinished run whose settings, config.yaml, cannot be read .*output=DIR"):
        claim_folder(tmp_path, "train", SETTINGS)
    assert (tmp_path / "config.yaml").read_bytes() == content


def test_another_sweep_is_refused_by_its_command_line(tmp_path):
    """A sweep has many settings: what was typed is compared, but for the folder itself."""
    claim_folder(tmp_path, "train", "", ["seed=0,1", "output=a"])
    leave(tmp_path)
    with pytest.raises(BadInput, match=r"seed=0,1 is given only there; seed=0,2 is given only here"):
        claim_folder(tmp_path, "train", "", ["seed=0,2"])
    claim_folder(tmp_path, "train", "", ["output=b", "seed=0,1"])


def test_a_finished_run_is_never_overwritten(tmp_path):
    """The message says so and what to do."""
    claim_folder(tmp_path, "train", SETTINGS)
    finish(tmp_path)
    leave(tmp_path)
    assert is_finished(tmp_path)
    with pytest.raises(BadInput, match=r"by a run that has finished .*output=DIR, or delete it"):
        claim_folder(tmp_path, "train", SETTINGS)
    discard_start(tmp_path, "train")
    assert {path.name for path in tmp_path.iterdir()} == {"run.json", "config.yaml"}


@pytest.mark.parametrize(
    "about",
    [
        "",
        "mine",
        "[]",
        '{"command": "train"}',
        '{"command": "train", "finished": null}',
        '{"command": "train", "finished": "2026-01-01"}',
    ],  # fmt: skip
)
def test_somebody_elses_files_are_refused_and_left_alone(tmp_path, about):
    """Also a run.json that no unfinished run of ours wrote, as that of an older version."""
    (tmp_path / "run.json").write_text(about)
    with pytest.raises(BadInput, match="already used"):
        claim_folder(tmp_path, "train", SETTINGS)
    assert [path.name for path in tmp_path.iterdir()] == ["run.json"]
    assert (tmp_path / "run.json").read_text() == about


def test_a_folder_whose_process_was_killed_is_free_and_one_whose_process_works_is_not(tmp_path):
    """The system releases the lock of a killed process."""
    program = f"""
import sys
from pathlib import Path
from auv_torchrl.command import claim_folder
claim_folder(Path({str(tmp_path)!r}), "train", {SETTINGS!r})
print("claimed", flush=True)
sys.stdin.read()
"""
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "claimed\n"
    with pytest.raises(BadInput, match="a run that is still going"):
        claim_folder(tmp_path, "train", SETTINGS)
    process.kill()
    process.communicate()
    claim_folder(tmp_path, "train", SETTINGS)
