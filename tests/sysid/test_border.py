"""The engine stands alone: whoever brings a simulator needs nothing else of this package."""

import ast
import re
import subprocess
import sys

import pytest

from auv_torchrl.paths import PROJECT

ENGINE = PROJECT / "auv_torchrl" / "sysid"


def test_the_engine_imports_numpy_and_scipy_alone():
    """No flight log, no effects, no vehicle, and nothing that takes long to import."""
    found = set()
    for path in ENGINE.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {name.name.split(".")[0] for name in node.names}
            if isinstance(node, ast.ImportFrom):
                found.add("sysid" if (node.module or "").startswith("auv_torchrl.sysid") else str(node.module))
    others = {name.split(".")[0] for name in found} - set(sys.stdlib_module_names)
    assert others == {"numpy", "scipy", "sysid"}


def test_a_simulator_that_is_not_ours_is_diagnosed():
    """The example finds what is wrong with its arm, says why, and says why nothing else is."""
    example = PROJECT / "examples" / "own_simulator.py"
    assert len(example.read_text().splitlines()) < 100
    run = subprocess.run([sys.executable, str(example)], capture_output=True, text=True, cwd=PROJECT, check=True)
    found = next(line for line in run.stdout.splitlines() if line.startswith("Found"))
    values = {name: float(value) for name, value in re.findall(r"(\w+) ([\d.]+) \(", found)}
    assert values == {"elbow_friction": pytest.approx(0.25, abs=0.01), "hand_mass": pytest.approx(0.5, abs=0.01)}
    assert "How this was decided" in run.stdout
    assert "elbow_offset: " in run.stdout.split("Why?")[1]
