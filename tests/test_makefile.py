"""The Makefile: which Python it takes, and what it hands on to the commands."""

import json
import shutil
import subprocess
import sys

import pytest

from auv_torchrl.paths import PROJECT

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="there is no make")
PYTHON = f"""#!{sys.executable}
import json, sys
sys.version_info, sys.version = (*VERSION, 0), ".".join(map(str, (*VERSION, 0)))
if sys.argv[1] == "-c":
    exec(sys.argv[2])
else:
    print(json.dumps(sys.argv[1:]))
"""


@pytest.fixture
def checkout(tmp_path):
    """A folder with the Makefile, pythons that say which version they are, and a finished .venv of 3.11."""
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy2(PROJECT / name, tmp_path)
    for name, version in (
        ("python3.12", (3, 12)),
        ("python3.13", (3, 13)),
        ("python3.15", (3, 15)),
        (".venv/bin/python", (3, 11)),
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(PYTHON.replace("VERSION", str(version)))
        path.chmod(0o755)
    for stamp in (".base", ".train", ".ready"):
        (tmp_path / ".venv" / stamp).touch()
    return tmp_path


def make(folder, *arguments):
    environment = {"PATH": f"{folder}:/usr/bin:/bin"}
    return subprocess.run(["make", *arguments], cwd=folder, env=environment, capture_output=True, text=True)


def test_a_python_that_does_not_do_is_refused_by_name_also_where_an_environment_is_there(checkout):
    """One line says what is needed, and .venv is left as it is."""
    for python, why in (
        ("python3.15", "Python 3.11 to 3.14 is needed, python3.15 is 3.15"),
        ("nopython", "does not run"),
    ):
        refused = make(checkout, f"PYTHON={python}", "env")
        assert refused.returncode != 0 and why in refused.stderr and "Traceback" not in refused.stderr
        assert (checkout / ".venv" / ".ready").is_file()


def test_a_python_that_diagnoses_and_does_not_train_is_taken_for_that_alone(checkout):
    """Nothing that trains has wheels for 3.13, and the line says which Python to name."""
    assert "python3.13 -m venv --clear .venv" in make(checkout, "-n", "PYTHON=python3.13", "diagnose").stdout
    (checkout / ".venv" / "bin" / "python").write_text(PYTHON.replace("VERSION", "(3, 13)"))
    (checkout / ".venv" / ".train").unlink()
    refused = make(checkout, "train")
    assert refused.returncode != 0 and "needed to train and to develop, .venv has 3.13" in refused.stderr
    assert make(checkout, "-n", "diagnose").stdout.startswith(".venv/bin/python diagnose.py")


def test_an_environment_that_fits_is_kept(checkout):
    """Nothing is installed a second time."""
    assert "Nothing to be done" in make(checkout, "-n", "env").stdout


def test_an_environment_of_another_python_or_a_broken_one_is_made_anew(checkout):
    """Another one is that which PYTHON=... does not name."""
    assert "python3.12 -m venv --clear .venv" in make(checkout, "-n", "PYTHON=python3.12", "env").stdout
    (checkout / ".venv" / "bin" / "python").write_text("#!/bin/sh\nexit 127\n")
    assert "python3 -m venv --clear .venv" in make(checkout, "-n", "env").stdout


def test_a_diagnosis_gets_the_healthy_flights_and_the_parameters(checkout):
    """Names with spaces, quotes and commas arrive as they are; what is not given is left out."""
    given = ("LOG=it's, odd.csv", "HEALTHY=a.csv 'b c.csv'", "PARAMS=my, own.param", "VEHICLE=bluerov2")
    told = json.loads(make(checkout, "-s", "diagnose", *given).stdout)
    wanted = ["log=it's, odd.csv", "vehicle=bluerov2", "healthy=a.csv 'b c.csv'", "params=my, own.param"]
    assert told == ["diagnose.py", *wanted]
    assert json.loads(make(checkout, "-s", "diagnose").stdout) == [
        "diagnose.py",
        "log=examples/flight.csv",
        "vehicle=paper",
    ]


def test_help_fits_a_terminal(checkout):
    """Every target is one line of up to 80 characters."""
    lines = make(checkout, "help").stdout.splitlines()
    assert len(lines) > 10 and max(map(len, lines)) <= 80
