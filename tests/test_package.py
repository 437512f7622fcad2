"""The wheel: built, installed elsewhere, and used from an empty folder as somebody would who has no checkout."""

import ast
import json
import os
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from importlib.metadata import distributions, packages_distributions
from pathlib import Path

import pytest
from packaging.metadata import Metadata
from packaging.specifiers import SpecifierSet

from auv_torchrl.effects import EFFECTS
from auv_torchrl.paths import CONF, EXAMPLE_LOG, PROJECT, config_path
from tests.experiment.conftest import TINY
from tests.own_python import FOULING

FEW = f"diagnosis.ignored=[{','.join(name for name in EFFECTS if name not in ('thruster_gain', 'linear_drag'))}]"
ADDED = {"hydra-joblib-launcher", "tensorboard"}  # read by Hydra, and by torch, by name


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel of this checkout, built without network."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    built = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """An environment with the wheel, and with the packages of this one in place of its dependencies.

    The folder of packages is on its path without being searched for ``.pth`` files, so that the checkout is not.
    """
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder)
    here = {sysconfig.get_path(kind) for kind in ("purelib", "platlib")}
    there = sysconfig.get_path("purelib", vars={"base": str(folder), "platbase": str(folder)})
    (Path(there) / "dependencies.pth").write_text("".join(f"{path}\n" for path in sorted(here)))
    pip = [sys.executable, "-m", "pip", "--python", str(folder / "bin" / "python")]
    command = [*pip, "install", "--quiet", "--no-index", "--no-deps", str(wheel)]
    subprocess.run(command, check=True, capture_output=True)
    return folder / "bin"


@pytest.fixture
def run(installed, tmp_path):
    """Runs a program of that environment in an empty folder; returns its output."""

    def call(name: str, *arguments: str) -> str:
        kept = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "AUV_CONF")}
        environment = {**kept, "OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg", "PYTHONNOUSERSITE": "1"}
        command = [str(installed / name), *arguments]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return call


def test_the_wheel_holds_the_configuration_and_nothing_of_the_tests(wheel):
    """All files of conf/, the example log, the two commands; no tests, benches or examples' scripts."""
    with zipfile.ZipFile(wheel) as content:
        names = set(content.namelist())
        (commands,) = (content.read(name).decode() for name in names if name.endswith("entry_points.txt"))
    for path in CONF.rglob("*.yaml"):
        assert f"auv_torchrl/conf/{path.relative_to(CONF)}" in names
    assert {"auv_torchrl/examples/flight.csv", "auv_torchrl/examples/path.csv"} <= set(names)
    assert {name.split("/")[0].split("-")[0] for name in names} == {"auv_torchrl"}
    assert not any("make_flight" in name for name in names)
    assert (
        "auv-train = " in commands
        and "auv-diagnose = " in commands
        and "auv-calibrate = " in commands
        and "auv-sim = " in commands
        and "auv-export = " in commands
        and "auv-fly = " in commands
        and "auv-log = " in commands
        and "auv-page = " in commands
    )


def test_twine_takes_the_wheel(wheel):
    """Without a warning: the README is shown as it stands."""
    pytest.importorskip("twine", reason="pip install twine")
    check = [sys.executable, "-m", "twine", "check", "--strict", str(wheel)]
    done = subprocess.run(check, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_the_metadata_are_what_an_index_takes(wheel):
    """Also where twine is not installed: fields by the specification, and README as Markdown."""
    with zipfile.ZipFile(wheel) as content:
        (name,) = (name for name in content.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = Metadata.from_email(content.read(name), validate=True)
    assert metadata.description_content_type == "text/markdown" and metadata.description
    assert (metadata.license_expression, str(metadata.requires_python)) == ("MIT", ">=3.11")
    assert wheel.stat().st_size < 2e6
    base = {one.name for one in metadata.requires_dist or [] if one.marker is None}
    assert "numpy" in base and not base & {"hydra-core", "torch", "pandas"}


def test_every_installed_package_takes_the_python_of_debian_12():
    """Python 3.11.2, which many laptops and small computers have: a pin that needs 3.11.5 installs nothing there."""
    # Once a test has imported importlib_metadata, it answers here, and raises where a field that is missing is read.
    named = [one for one in distributions() if "Requires-Python" in one.metadata]
    asks = {one.name: one.metadata["Requires-Python"] for one in named}
    assert not {name: asked for name, asked in asks.items() if not SpecifierSet(asked).contains("3.11.2")}


def test_what_is_imported_is_declared_and_the_other_way_round():
    """An environment for training has all that the package imports; one for diagnoses has less."""
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    lines = [*project["dependencies"], *extras["train"], *extras["fast"], *extras["mujoco"], *extras["rerun"]]
    declared = {_distribution(line.split(";")[0]) for line in lines} - {"auv-torchrl"}
    imported = set()
    for path in (PROJECT / "auv_torchrl").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
                imported.add(node.module.split(".")[0])
    foreign = imported - sys.stdlib_module_names - {"auv_torchrl"}
    owners = packages_distributions()
    assert {min(_distribution(owner) for owner in owners[name]) for name in foreign} | ADDED == declared


def _distribution(requirement: str) -> str:
    name = next((requirement[:i] for i, sign in enumerate(requirement) if sign in "<>=~! ["), requirement)
    return name.lower().replace("_", "-")


@pytest.mark.slow
def test_the_installed_package_diagnoses_the_example(run, installed, tmp_path):
    """auv-diagnose log=example, in a folder that holds nothing, from the wheel's own files."""
    where = Path(run("python", "-c", "import auv_torchrl; print(auv_torchrl.__file__)").strip())
    assert where.is_relative_to(installed.parent) and not (where.parents[1] / "conf").exists()
    said = run("auv-diagnose", "log=example", FEW)
    (folder,) = (tmp_path / "outputs" / "diagnose").iterdir()
    diagnosis = json.loads((folder / "diagnosis.json").read_text())
    assert diagnosis["summary"] in said
    assert [(effect["name"], effect["thrusters"]) for effect in diagnosis["effects"]] == [("thruster_gain", [4])]


@pytest.mark.slow
@pytest.mark.thorough
def test_a_vehicle_file_of_ones_own_is_flown_from_python(run, tmp_path):
    """Three lines, as README.md has them, with a file in place of a name."""
    (tmp_path / "mine.yaml").write_text(config_path("vehicle", "bluerov2").read_text().replace("11.5 ", "13.5 "))
    lines = (
        "from auv_torchrl.envs import make_fleet; from auv_torchrl.tasks import StationKeeping",
        "from auv_torchrl.vehicle import load_vehicle",
        "fleet = make_fleet('mujoco', load_vehicle('mine.yaml'), StationKeeping(), num_envs=3)",
        "print(fleet.rollout(5).shape, float(load_vehicle('mine.yaml').mass))",
    )
    assert run("python", "-c", "\n".join(lines)).split("\n")[-2] == "torch.Size([3, 5]) 13.5"


@pytest.mark.slow
@pytest.mark.thorough
def test_the_installed_commands_sweep_in_processes_over_files_of_ones_own(run, tmp_path):
    """auv-diagnose and jobs of a sweep of auv-train find conf/, a vehicle file and an effect of one's own."""
    (tmp_path / "mine.yaml").write_text(config_path("vehicle", "paper").read_text().replace("12.0 ", "12.1 "))
    (tmp_path / "lab" / "effects").mkdir(parents=True)
    (tmp_path / "lab" / "effects" / "growth.py").write_text(FOULING)
    rows = EXAMPLE_LOG.read_text().splitlines(keepends=True)
    (tmp_path / "short.csv").write_text("".join(rows[: len(rows) // 4]))
    parallel = ("-m", "--config-dir", "lab", "hydra/launcher=joblib")
    run("auv-diagnose", "short.csv", "--config-dir", "lab", "--vehicle", "mine.yaml", FEW, "--output", "diagnosed")
    diagnosis = json.loads((tmp_path / "diagnosed" / "diagnosis.json").read_text())
    assert [effect["name"] for effect in diagnosis["effects"]] == ["thruster_gain"]
    assert "fouling" in {candidate["name"] for candidate in diagnosis["candidates"]}
    mine = ("vehicle=mine.yaml", "+randomization.fouling.factor=[1.0,2.0]", "flight.fly=false")
    run("auv-train", *parallel, *TINY, *mine, "output=trained")
    assert (tmp_path / "trained" / "0" / "results.json").is_file()
    assert "mass: 12.1" in (tmp_path / "trained" / "0" / "config.yaml").read_text()
