"""YAML files that people write: what cannot be meant is one line with file, cause and remedy."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.singleton import Singleton
from hydra.plugins.config_source import ConfigLoadError
from hydra.types import RunMode

from auv_torchrl.experiment import schema
from auv_torchrl.hydra_command.config_source import check_config_files
from auv_torchrl.paths import CONF, OWN, PROJECT, config_path
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.yaml_file import MOST_BYTES, YamlFileError, read_yaml

PAPER = config_path("vehicle", "paper").read_text()
BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 10)}]\n" for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)
BROKEN = {
    "broken": ("mass: [1, 2\nname: x\n", r"line 2 is no YAML .*: mend that line"),
    "tab": ("rigid_body:\n\tmass: 3\n", r"line 2 is no YAML"),
    "repeated": (PAPER + "coriolis: 1.0\n", r"line \d+: 'coriolis' is given twice, first in line 13: keep one"),
    "repeated inside": ("rigid_body:\n  mass: 1\n  mass: 2\n", r"line 3: 'mass' is given twice, first in line 2"),
    "scalar": ("12\n", "expected a mapping, .* got one value: write it so"),
    "list": ("- 1\n- 2\n", "expected a mapping, .* got a list"),
    "empty": ("# nothing\n", "expected a mapping, .* got nothing"),
    "bomb": (BOMB, r"more than 10,000 entries with aliases written out: write the values"),
    "loop": ("a: &a [1, *a]\n", "an alias contains itself"),
    "interpolation": (PAPER.replace("name: paper", "name: ${oc.env:HOME}"), r"line \d: '\$\{oc.env:HOME\}' refers to"),
    "python object": ("a: !!python/object/apply:os.getcwd []\n", "is no YAML"),
    "two documents": ("a: 1\n---\nb: 2\n", "is no YAML"),
    "number as name": ("1: 2\n", "line 1: '1' is no name: give a word, in quotes"),
    "yes as name": ("on: 2\n", "line 1: 'on' is no name"),
    "latin-1": ("name: é\n".encode("latin-1"), "not in UTF-8 .*byte 7.*save it as UTF-8"),
    "utf-16": ("name: a\n".encode("utf-16"), r"not in UTF-8 \(UTF-16\): save it as UTF-8"),
    "binary": (b"a: \x00\x01\n", "is no YAML .*: save it as plain text"),
    "huge": ("# " + "x" * MOST_BYTES, "100,000 at most"),
    "no date": ("a: 2024-13-45\n", "line 1 is no YAML .no number or date: month must be in 1..12"),
    "no integer": (f"a:\n  b: {'9' * 5000}\n", "line 2 is no YAML .no number or date: Exceeds the limit"),
    "octal": ("a: 1\nmass: 011\n", "line 2: YAML reads '011' to the base 8 or 60: write it as a decimal number"),
    "sexagesimal": ("mass: 11:50\n", "line 1: YAML reads '11:50' to the base 8 or 60"),
    "sexagesimal with a point": ("mass: 11:50.5\n", "line 1: YAML reads '11:50.5' to the base"),
    "deep": ("a: " + "[" * 5000, "nested too deeply"),
}


@pytest.mark.parametrize(("content", "message"), BROKEN.values(), ids=BROKEN)
def test_a_file_that_cannot_be_meant_is_refused_in_one_line(tmp_path, content, message):
    """The line names the file, the cause and the remedy."""
    path = tmp_path / "mine.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(YamlFileError, match=message) as error:
        load_vehicle(path)
    assert str(error.value).startswith(f"vehicle file {path}") and "\n" not in str(error.value)
    assert len(str(error.value)) < 400


def test_what_is_no_regular_file_is_refused_at_once(tmp_path):
    """A directory, a pipe, a device, and nothing at all."""
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "folder.yaml").mkdir()
    (tmp_path / "zero.yaml").symlink_to("/dev/zero")
    for name, message in {
        "pipe": "is a pipe or device",
        "folder": "is a directory",
        "zero": "is a pipe or device",
    }.items():
        with pytest.raises(YamlFileError, match=f"{name}.yaml {message}: give a YAML file"):
            load_vehicle(tmp_path / f"{name}.yaml")
    with pytest.raises(FileNotFoundError, match=r"no vehicle file .*nowhere\.yaml: give"):
        load_vehicle(tmp_path / "nowhere.yaml")


def test_an_impossible_entry_names_its_file(tmp_path):
    """Not the entry alone: a vehicle may be read from anywhere."""
    path = tmp_path / "mine.yaml"
    path.write_text(PAPER.replace("mass: 12.0", "mass: -12.0"))
    with pytest.raises(ValueError, match=r"mine\.yaml: vehicle: rigid_body\.mass is -12\.0: give values above 0"):
        load_vehicle(path)


def test_every_file_of_the_project_is_read(tmp_path):
    """With the values that are in it, aliases and 1e-3 as Hydra reads them, and a byte-order mark."""
    for path in CONF.rglob("*.yaml"):
        read_yaml(path, "configuration", plain=path.parent.name in ("vehicle", "scenario", "randomization"))
    path = tmp_path / "mine.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: &row [1, 2]\nb: [*row, *row]\nc: 1e-3\nd: {<<: {x: 1}, y: 2}\n")
    assert read_yaml(path, "test") == {"a": [1, 2], "b": [[1, 2], [1, 2]], "c": 1e-3, "d": {"x": 1, "y": 2}}


def in_folder(folder, group, kind):
    """A file of that kind as the entry ``mine`` of a configuration group, and what is said about it."""
    path = folder / group / "mine.yaml"
    if kind == "a folder":
        path.mkdir(parents=True)
        return path, "is a directory"
    path.parent.mkdir()
    content, message = BROKEN[kind]
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path, message


@pytest.mark.parametrize("group", ["vehicle", "+scenario", "randomization"])
@pytest.mark.parametrize(
    "kind", ["broken", "repeated inside", "scalar", "interpolation", "latin-1", "bomb", "a folder"]
)
def test_commands_read_such_files_with_the_same_errors(tmp_path, monkeypatch, group, kind):
    """Whatever names the file: Hydra loads none that is not checked."""
    path, message = in_folder(tmp_path, group.strip("+"), kind)
    monkeypatch.setenv(OWN, str(tmp_path))
    schema.register()
    check_config_files()
    with initialize_config_dir(str(CONF), version_base="1.3"), pytest.raises(ConfigLoadError, match=message) as error:
        compose("train", [f"{group}=mine"])
    assert str(path) in str(error.value)


def test_a_command_ends_with_that_line(tmp_path):
    """Exit code 2, and nothing outside of the file is looked up."""
    path, _ = in_folder(tmp_path, "vehicle", "interpolation")
    arguments = ["log=nowhere.csv", "vehicle=mine", f"output={tmp_path / 'out'}", "--config-dir", tmp_path]
    done = subprocess.run([sys.executable, PROJECT / "diagnose.py", *arguments], capture_output=True, text=True)
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert str(path) in line and "oc.env" in line and str(Path.home()) not in line.replace(str(tmp_path), "")
    assert not (tmp_path / "out").exists()


def test_processes_of_a_sweep_check_the_files_too(tmp_path, monkeypatch):
    """They get Hydra's state and its loader from the process that started them, and look for plugins anew."""
    path, message = in_folder(tmp_path, "vehicle", "interpolation")
    monkeypatch.setenv(OWN, str(tmp_path))
    schema.register()
    check_config_files()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        loader, state = GlobalHydra.instance().config_loader(), Singleton.get_state()
        with monkeypatch.context() as another_process, pytest.raises(ConfigLoadError, match=message) as error:
            another_process.setattr(Singleton, "_instances", {})
            Singleton.set_state(state)
            loader.load_configuration("train", ["vehicle=mine"], RunMode.RUN)
    assert str(path) in str(error.value)
