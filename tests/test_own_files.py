"""Vehicles, scenarios, randomizations and effects outside of the package: found, used, and refused where they clash."""

import logging
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
import yaml
from hydra import compose, initialize_config_dir

from auv_torchrl.command.arguments import quote_files, without_config_dir
from auv_torchrl.command.errors import BadInput
from auv_torchrl.command.own_files import own_files
from auv_torchrl.diagnosis import diagnose
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.verdict import Verdict
from auv_torchrl.effects import EFFECTS, Effect, get_effect
from auv_torchrl.envs import MujocoFleet
from auv_torchrl.envs.randomize import RandomizeVehicle
from auv_torchrl.experiment import schema
from auv_torchrl.flightlog import read_flightlog
from auv_torchrl.hydra_command.config_source import check_config_files
from auv_torchrl.paths import CONF, OWN, PROJECT, config_names, config_path
from auv_torchrl.physics.kinematics import quaternion_from_euler
from auv_torchrl.registry import Registry
from auv_torchrl.scenario import read_scenario
from auv_torchrl.simulator import PlainSimulator, at_rest
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.vehicle.tensors import tensors
from tests.diagnosis.flown_logs import fly, hold
from tests.own_python import BELOW, BOW_GAUGE, FOULING, SEMICOLONS

PAPER = config_path("vehicle", "paper").read_text()


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.fixture
def lab(tmp_path, monkeypatch):
    """A folder of one's own with a vehicle, a scenario, a randomization and an effect, in use."""
    folder = tmp_path / "my lab"
    write(folder / "vehicle" / "mine.yaml", PAPER.replace("name: paper", "name: mine").replace("12.0 ", "14.0 "))
    write(folder / "scenario" / "summer.yaml", "effects: {fouling: {factor: 2.2}}\n")
    write(folder / "randomization" / "mine.yaml", "fouling: {factor: [1.0, 3.0]}\n")
    write(folder / "effects" / "growth.py", FOULING)
    monkeypatch.setenv(OWN, str(folder))
    return folder


def composed(*overrides):
    schema.register()
    check_config_files()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return compose("train", list(overrides))


def test_a_folder_of_ones_own_holds_vehicles_scenarios_and_randomizations(lab):
    """They are chosen by name beside those of the package, by commands and from Python."""
    assert {"mine", "paper"} <= set(config_names("vehicle"))
    assert float(load_vehicle("mine").mass) == 14.0
    config = composed("vehicle=mine", "+scenario=summer")
    assert config.vehicle.rigid_body.mass == 14.0
    assert config.scenario.effects.fouling.factor == 2.2
    assert config.randomization == {"fouling": {"factor": [1.0, 3.0]}}  # by the name of the vehicle


def test_an_effect_of_ones_own_is_flown_and_drawn(lab):
    """A scenario with it slows the vehicle down in MuJoCo, and a randomization draws it."""
    vehicle = load_vehicle("mine")
    content = yaml.safe_load((lab / "scenario" / "summer.yaml").read_text())
    scenario = read_scenario("summer", content, vehicle)
    ahead = torch.tensor([1.0, 0.0, 0.0, 0.0])
    speed = {}
    for name, flown in (("clean", None), ("fouled", scenario)):
        fleet = MujocoFleet(vehicle, StationKeeping(), 1, scenario=flown, seed=0)
        start = fleet.reset()
        for _ in range(100):  # 5 s, long enough for a steady speed
            start = fleet.step(start.set("action", ahead.expand(1, 4)))["next"]
        speed[name] = float(start["observation"][0, 0])
    assert 0 < speed["fouled"] < 0.8 * speed["clean"]
    ranges = yaml.safe_load((lab / "randomization" / "mine.yaml").read_text())
    drawn = RandomizeVehicle(vehicle, ranges).draw(50, torch.Generator().manual_seed(0))
    share = drawn.quadratic_drag / tensors(vehicle).quadratic_drag
    assert share.min() > 1 and share.max() < 3 and share.std() > 0.1


def test_an_effect_of_ones_own_is_named_by_the_diagnosis(lab):
    """Among all effects of the package, with its value."""
    vehicle = hold(load_vehicle("mine"))
    log = fly(vehicle, {"fouling": {"factor": 2.2}}, episodes=2, seconds=20.0)
    (found,) = diagnose(log, vehicle).effects
    assert found.name == "fouling"
    assert found.parameters["factor"].value == pytest.approx(2.2, abs=0.05)


def test_the_contracts_of_all_effects_hold_for_ones_own(lab):
    """The tests of the registry run on it, and on a vehicle of one's own: identity, batch, bounds, sentences."""
    files = ["--noconftest", "tests/test_effects.py"]  # of conftest.py they need nothing
    command = [sys.executable, "-m", "pytest", "-q", *files, "-k", "fouling or mine"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=PROJECT)
    assert done.returncode == 0, done.stdout
    count = re.search(r"(\d+) passed", done.stdout)
    assert count is not None and int(count[1]) > len(EFFECTS)


@pytest.mark.parametrize("name", ["mine.yaml", "mine.yml", "my boat, 1.yaml", "paper.yaml"])
@pytest.mark.parametrize("relative", [True, False])
def test_a_vehicle_is_a_file_anywhere(tmp_path, monkeypatch, name, relative):
    """Relative to the working directory or absolute; a file that is there comes before an entry of that name."""
    path = write(tmp_path / "boats" / name, PAPER.replace("12.0 ", "14.0 "))
    monkeypatch.chdir(path.parent if relative else "/")
    (argument,) = quote_files([f"vehicle={name if relative else path}"], ("vehicle",))
    config = composed(argument)
    assert config.vehicle.rigid_body.mass == 14.0
    assert config.randomization == yaml.safe_load(config_path("randomization", "default").read_text())


def test_scenarios_and_randomizations_are_files_anywhere(tmp_path, monkeypatch):
    """Also several, and together with names."""
    write(tmp_path / "weak.yaml", "effects: {thruster_gain: {gain_1: 0.5}}\n")
    write(tmp_path / "calm.yaml", "linear_drag: {scale: [0.9, 1.1]}\n")
    monkeypatch.chdir(tmp_path)
    config = composed("+scenario=[weak.yaml,swap]", "randomization=calm.yaml")
    assert set(config.scenario.effects) == {"thruster_gain", "thruster_swap"}
    assert config.randomization == {"linear_drag": {"scale": [0.9, 1.1]}}


def test_the_default_randomization_works_for_every_vehicle():
    """It names nothing that depends on the size of the vehicle; servos have no thrust to draw."""
    ranges = yaml.safe_load(config_path("randomization", "default").read_text())
    for name in config_names("vehicle"):
        vehicle = load_vehicle(name)
        drawn = RandomizeVehicle(vehicle, ranges).draw(4, torch.Generator().manual_seed(0))
        assert [i for i, spread in enumerate(drawn.gain.std(0).tolist()) if not spread] == list(vehicle.servos)


REFUSED = {  # what is written where, and what is said
    "a name of the package": ("vehicle/paper.yaml", PAPER, "has the name of a vehicle of the package: rename it"),
    "a folder misspelt": ("vehicles/mine.yaml", PAPER, "nothing is read from .*vehicles: call it vehicle"),
    "another folder": ("stuff/mine.yaml", PAPER, "give one with folders out of adaptation, .*effects.*vehicle"),
    "an effect of the package": ("effects/mine.py", FOULING.replace('"fouling"', '"current"'), "'current' .*rename it"),
    "no Python": ("effects/mine.py", "EFFECTS = (\n", r"mine.py cannot be read \(SyntaxError.*line 1"),
    "no EFFECTS": ("effects/mine.py", "effect = 3\n", "no attribute 'EFFECTS'"),
    "no effect": ("effects/mine.py", "EFFECTS = (3,)\n", r"3 in .*mine.py is no Effect: end it with EFFECTS ="),
    "no name": ("effects/mine.py", FOULING.replace('"fouling"', '"Gill net"'), "'Gill net' in .*small letters"),
    "an error": ("effects/mine.py", "1 / 0\n", r"cannot be read \(ZeroDivisionError"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_meant_is_refused_in_one_line(tmp_path, case):
    """A clash, a misspelt folder, a file that is none."""
    path, content, message = REFUSED[case]
    write(tmp_path / path, content)
    with pytest.raises(BadInput, match=message) as refused, own_files(str(tmp_path)):
        pass
    assert "\n" not in str(refused.value)


def test_a_name_that_is_in_both_folders_is_refused_from_python_too(tmp_path, monkeypatch):
    """Nobody flies another vehicle than was meant."""
    write(tmp_path / "vehicle" / "paper.yaml", PAPER)
    monkeypatch.setenv(OWN, str(tmp_path))
    with pytest.raises(ValueError, match="rename it"):
        load_vehicle("paper")


def test_a_missing_file_and_a_missing_folder_are_named(tmp_path, monkeypatch):
    """In one line that says what to give."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(Exception, match=r"there is no vehicle file .*nowhere.yaml: give a YAML file that exists"):
        composed("vehicle=nowhere.yaml")
    with pytest.raises(BadInput, match="there is no folder '.*nowhere'"), own_files("nowhere"):
        pass


def test_the_folder_of_a_command_line_holds_for_that_command_alone(lab, tmp_path, monkeypatch):
    """--config-dir stands for AUV_CONF, and what was set before is there afterwards."""
    other = write(tmp_path / "other" / "vehicle" / "another.yaml", PAPER).parents[1]
    assert without_config_dir(["--config-dir", "a b", "seed=1"]) == (["seed=1"], "a b")
    assert without_config_dir(["seed=1", "-cd=x"]) == (["seed=1"], "x")
    with own_files(str(other)):
        assert "another" in config_names("vehicle") and "mine" not in config_names("vehicle")
        assert "fouling" not in EFFECTS
    assert "mine" in config_names("vehicle") and "fouling" in EFFECTS
    monkeypatch.delenv(OWN)
    with own_files(str(other)):
        assert "another" in config_names("vehicle")
    assert "another" not in config_names("vehicle") and "fouling" not in EFFECTS


def test_a_task_of_ones_own_is_trained_on(tmp_path, monkeypatch, capsys):
    """``task=below`` takes its class, its settings and its types, and vehicles start and are drawn to where it says."""
    from auv_torchrl.experiment import command, job

    write(tmp_path / "lab" / "tasks" / "below.py", BELOW)
    write(tmp_path / "lab" / "task" / "below.yaml", "defaults: [below_schema, _self_]\nname: below\ndepth_m: 3.0\n")
    asked = []
    monkeypatch.setattr(job, "run", lambda experiment, folder: asked.append(experiment))
    quiet = ["hydra/job_logging=none", "hydra/hydra_logging=none", f"output={tmp_path / 'out'}"]
    own = ["--config-dir", str(tmp_path / "lab"), "task=below"]
    monkeypatch.setattr(sys, "argv", ["train.py", *own, "task.box_m=0.5", *quiet])
    command.main()
    (experiment,) = asked
    assert (experiment.task.name, experiment.task.depth_m, experiment.task.box_m) == ("below", 3.0, 0.5)
    fleet = MujocoFleet(load_vehicle("paper"), replace(experiment.task, near_share=0.0), 4, seed=0)
    depth = fleet.reset()["measured", "position"][:, 2]
    assert ((depth > 2.4) & (depth < 3.6)).all()
    monkeypatch.setattr(sys, "argv", ["train.py", *own, "task.depth_m=deep", *quiet])
    with pytest.raises(SystemExit):
        command.main()
    assert "task.depth_m" in capsys.readouterr().err


def test_a_sensor_of_ones_own_is_what_simulators_and_the_diagnosis_read(tmp_path, monkeypatch):
    """A pressure gauge at the bow rises when the bow does; a log of it is sound to who knows that, and else is not."""
    write(tmp_path / "sensors" / "gauge.py", BOW_GAUGE)
    monkeypatch.setenv(OWN, str(tmp_path))
    vehicle = load_vehicle("bluerov2")
    state = at_rest(np.zeros((1, 3)), np.zeros(1), vehicle.thrusters)
    bow_up = quaternion_from_euler(np.zeros(1), np.full(1, 0.3), np.zeros(1))
    simulator = PlainSimulator(vehicle.expand(1), 0.05)
    simulator.resume(state._replace(quaternion=bow_up))
    assert simulator.report().position[0, 2] == pytest.approx(-0.4 * np.sin(0.3))
    log = fly(vehicle, {}, episodes=4, seconds=15.0, axes=("x", "y", "z", "roll", "pitch", "yaw"))
    settings = replace(load_settings(), ignored=tuple(name for name in EFFECTS if name != "thruster_gain"))
    assert diagnose(log, vehicle, settings=settings).verdict is Verdict.NO_GAP
    monkeypatch.delenv(OWN)
    simulator.resume(state._replace(quaternion=bow_up))
    assert simulator.report().position[0, 2] == 0.0
    assert diagnose(log, vehicle, settings=settings).verdict is not Verdict.NO_GAP


def test_a_reader_of_ones_own_reads_a_log_that_is_diagnosed(tmp_path, monkeypatch):
    """Whatever its name, by its first bytes; the rows are those of the same log as CSV."""
    write(tmp_path / "lab" / "readers" / "semicolons.py", SEMICOLONS)
    monkeypatch.setenv(OWN, str(tmp_path / "lab"))
    vehicle = load_vehicle("paper")
    log = fly(hold(vehicle), {}, episodes=1, seconds=10.0)
    (episode,) = log.episodes
    columns = {"t": episode.t, "x": episode.pose[:, 0], "y": episode.pose[:, 1], "z": episode.pose[:, 2]}
    columns["yaw"] = episode.pose[:, 5]
    columns |= {f"cmd_{i + 1}": episode.commands[:, i] for i in range(vehicle.thrusters)}
    rows = [";".join(f"{value:.17g}" for value in row) for row in zip(*columns.values(), strict=True)]
    path = write(tmp_path / "dive.log", "\n".join(["SEMI", ";".join(columns), *rows]))
    read = read_flightlog(path, vehicle)
    (same,) = read.episodes
    assert read.axes == ("x", "y", "z", "yaw")
    np.testing.assert_allclose(same.pose[:, [0, 1, 2, 5]], episode.pose[:, [0, 1, 2, 5]], atol=1e-12)
    np.testing.assert_allclose(same.commands, episode.commands, atol=1e-12)


def test_an_installed_package_brings_effects(tmp_path, monkeypatch):
    """By an entry point, also where the package imports this one before the registry reads it."""
    write(tmp_path / "lab_effects.py", FOULING)
    write(tmp_path / "lab-1.0.dist-info" / "METADATA", "Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n")
    write(tmp_path / "lab-1.0.dist-info" / "entry_points.txt", "[auv_torchrl.effects]\nlab = lab_effects:EFFECTS\n")
    monkeypatch.syspath_prepend(tmp_path)
    registry = Registry("effects", Effect, (get_effect("current"),))
    assert list(registry) == ["current", "fouling"] and isinstance(registry["fouling"], Effect)


def test_a_vehicle_without_a_randomization_is_trained_over_the_default_which_is_said(tmp_path, monkeypatch, caplog):
    """In one line, and not where it was asked for."""
    from auv_torchrl.experiment import command, job

    path = write(tmp_path / "mine.yaml", PAPER)
    monkeypatch.setattr(job, "run", lambda experiment, folder: None)
    caplog.set_level(logging.INFO)
    quiet = ["hydra/job_logging=none", "hydra/hydra_logging=none"]
    for number, asked in enumerate(([], ["randomization=default"], ["randomization=wide"])):
        arguments = [f"vehicle={path}", *asked, f"output={tmp_path / str(number)}", *quiet]
        monkeypatch.setattr(sys, "argv", ["train.py", *arguments])
        command.main()
        said = [record.getMessage() for record in caplog.records if "randomization" in record.getMessage()]
        assert said == (
            [f"no randomization for vehicle={path}: training draws from randomization=default"] * (not asked)
        )
        caplog.clear()
