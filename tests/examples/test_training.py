"""The training scripts of examples/: short, whole, and run as somebody would run them, for a few transitions."""

import importlib.util
import re
import runpy
import sys

import pytest

from auv_torchrl.paths import PROJECT

SCRIPTS = {  # transitions that reach a few updates, vehicles, and the package that this project does not bring
    "torchrl_sac": ("192", "8", None),
    "own_reward": ("192", "2", None),
    "cleanrl_sac": ("1040", "8", None),
    "sb3_sac": ("1016", "8", "stable_baselines3"),
}
LONGEST = 80  # lines


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_training_script_is_one_page(name):
    """An example is read from top to bottom, and README of the folder says what it shows."""
    text = (PROJECT / "examples" / f"{name}.py").read_text()
    assert len(text.splitlines()) <= LONGEST
    assert f"{name}.py" in (PROJECT / "examples" / "README.md").read_text()


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_training_script_trains_and_examines(name, monkeypatch, capsys):
    """A few updates, then the examination prints a distance."""
    transitions, vehicles, needed = SCRIPTS[name]
    if needed and importlib.util.find_spec(needed) is None:
        pytest.skip(f"{needed} is not there: pip install '.[bench]'")
    monkeypatch.setattr(sys, "argv", [name, transitions, vehicles])
    runpy.run_path(str(PROJECT / "examples" / f"{name}.py"), run_name="__main__")  # in this process, which has torch
    printed = capsys.readouterr().out
    found = re.search(r"mean distance to the target: (\d+\.\d{4}) m", printed)
    assert found and 0 < float(found[1]) < 100, printed  # m; untrained vehicles stay in sight
