"""The tutorials: their commands are run as they stand, and say what the pages say."""

import json
import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from auv_torchrl.paths import PROJECT
from tests.documented import FENCED, MODULES

TUTORIALS = PROJECT / "docs" / "tutorial"
FIRST = (".venv/bin/", "mkdir ", "cp ", "sed ")
Run = Callable[[str, tuple[str, ...]], str]


def shown(page: str) -> list[str]:
    """The commands of a page, but ``make env``."""
    lines = [line for _, block in FENCED.findall((TUTORIALS / page).read_text()) for line in block.splitlines()]
    return [line for line in lines if line.startswith(FIRST)]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Runs the commands of a page in a folder where ``conf`` and ``examples`` are, but those that name one of these."""
    for name in ("conf", "examples"):
        (tmp_path / name).symlink_to(PROJECT / name)
    environment = {**os.environ, "PYTHONPATH": str(PROJECT), "OMP_NUM_THREADS": "1"}

    def call(page: str, leave_out: tuple[str, ...]) -> str:
        said = []
        for line in shown(page):
            if any(name in line for name in leave_out):
                continue
            program, *words = shlex.split(line, comments=True)
            name = program.removeprefix(".venv/bin/")
            module = f"auv_torchrl.{MODULES.get(name, 'flightlog.command')}"
            start = [program] if name == program else [sys.executable, *(() if name == "python" else ("-m", module))]
            done = subprocess.run([*start, *words], cwd=tmp_path, env=environment, capture_output=True, text=True)
            assert done.returncode == 0, f"{line}\n{done.stderr}"
            said.append(done.stdout)
        return "\n".join(said)

    return call


@pytest.mark.slow
def test_a_dive_is_diagnosed_repaired_and_found_healthy(run, tmp_path):
    """As the page shows it; the dives of which no file is shipped, and training for the vehicle, are left out."""
    said = run("your-vehicle.md", ("00000012.BIN", "00000029.BIN", "auv-train"))
    page = (TUTORIALS / "your-vehicle.md").read_text()
    answer = "explained: Thruster 1 turns the wrong way."
    assert answer in page and answer in said and "Set MOT_1_DIRECTION to 1 (it is -1)." in said
    assert (tmp_path / "answer_1" / "advice.param").read_text() == "MOT_1_DIRECTION,1\n"
    assert (tmp_path / "answer_1" / "report.html").is_file()
    assert json.loads((tmp_path / "answer_2" / "diagnosis.json").read_text())["verdict"] == "no_gap"


@pytest.mark.slow
def test_a_vehicle_and_a_simulator_of_ones_own_are_diagnosed(run, tmp_path):
    """The page names the thruster that the command finds; the example with the arm has its test with ``sysid``."""
    said = run("my-simulator.md", ("own_simulator.py",))
    found = json.loads((tmp_path / "answer" / "diagnosis.json").read_text())
    assert [4] in [effect["thrusters"] for effect in found["effects"]]
    assert list((tmp_path / "boat_mujoco").iterdir())
    assert "Thruster 4 gives" in said
