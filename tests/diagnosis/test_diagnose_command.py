"""python diagnose.py: the files of a good log, one line and exit code 2 for a bad one."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import yaml
from omegaconf import OmegaConf

from auv_torchrl.command import BAD_INPUT
from auv_torchrl.diagnosis.command.logs import names
from auv_torchrl.diagnosis.command.request import refuse_copies
from auv_torchrl.diagnosis.verdict import from_json
from auv_torchrl.flightlog import FlightLogError, write_flightlog
from auv_torchrl.paths import PROJECT
from auv_torchrl.scenario import read_scenario
from auv_torchrl.vehicle import load_vehicle
from tests.command_lines import answers_of
from tests.flightlog.simulate import POSE_ONLY, simulated_logs

SHIPPED = PROJECT / "examples" / "flight.csv"
BAD = {  # what is wrong: command line, what the answer names
    "nothing": ([], "log=flight.csv"),
    "no log in the list": (["log=[]"], "log=flight.csv"),
    "missing file": (["log=nowhere.csv"], "nowhere.csv"),
    "two times a log": ([str(SHIPPED), "log=other.csv"], "log is given twice"),
    "a missing file without a key": (["my dives/1(a).BIN"], "my dives/1(a).BIN"),
    "a pattern that matches nothing": (["nowhere/*.BIN"], "no file matches nowhere/*.BIN"),
    "an option misspelt": ([str(SHIPPED), "--helthy", "a.csv"], "did you mean --healthy?"),
    "a sweep": ([str(SHIPPED), "-m"], "auv-diagnose has no sweeps"),
    "a word without a key": (["paper"], ": give key=value, --help lists the keys"),
    "missing healthy file": ([f"log={SHIPPED}", "healthy=nowhere.csv"], "nowhere.csv"),
    "healthy is the log": ([f"log={SHIPPED}", f"healthy={SHIPPED}"], "is the log to explain itself"),
    "not a log": ([f"log={PROJECT / 'Makefile'}"], "Makefile"),
    "a folder": ([f"log={PROJECT}"], "directory"),
    "unknown vehicle": ([f"log={SHIPPED}", "vehicle=papr"], "bluerov2"),
    "wrong vehicle": ([f"log={SHIPPED}", "vehicle=bluerov2_heavy"], "8 thrusters"),
    "misspelt vehicle entry": ([f"log={SHIPPED}", "vehicle.rigid_body.mas=3"], "did you mean mass"),
    "impossible vehicle": ([f"log={SHIPPED}", "vehicle.rigid_body.mass=-1"], "above 0"),
    "misspelt setting": ([f"log={SHIPPED}", "diagnosis.window=3"], "window_s"),
    "misspelt key": ([f"log={SHIPPED}", "lgo=3"], "did you mean log"),
    "wrong type": ([f"log={SHIPPED}", "trust_log=maybe"], "trust_log"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the logs and outputs of this module are."""
    return tmp_path_factory.mktemp("command")


@pytest.fixture(scope="module")
def answers(folder):
    """Exit code, output and errors of every command line that needs no diagnosis."""
    (folder / "used").mkdir()
    (folder / "used" / "precious.txt").write_text("mine")
    log = replace(simulated_logs("paper", [{}])[0], axes=POSE_ONLY)
    turn, offset = np.array([1, 1, -1, 1, -1, -1]), np.array([0, 0, 0, 0, 0, np.pi / 2])
    episodes = tuple(replace(e, pose=e.pose[:, [1, 0, 2, 3, 4, 5]] * turn + offset) for e in log.episodes)
    enu = write_flightlog(replace(log, episodes=episodes), folder / "enu.csv")
    lines = {case: [*arguments, f"output={folder / case}"] for case, (arguments, _) in BAD.items()}
    lines["used"] = [f"log={SHIPPED}", f"output={folder / 'used'}"]
    lines["enu"] = [f"log={enu}", f"output={folder / 'enu'}"]
    lines["help"] = ["--help"]
    return answers_of("diagnose", lines)


def test_the_shipped_log_is_explained(folder):
    """The log in examples is diagnosed as it was made: thruster 4 gives 55 %, and nothing else is wrong."""
    out = folder / "shipped"
    command = [sys.executable, "diagnose.py", f"log={SHIPPED}", f"output={out}"]
    environment = {**os.environ, "PYTHONPATH": str(PROJECT), "OMP_NUM_THREADS": "1"}
    run = subprocess.run(command, capture_output=True, text=True, cwd=PROJECT, env=environment)
    assert run.returncode == 0, run.stderr
    diagnosis = from_json(json.loads((out / "diagnosis.json").read_text()))
    assert [(effect.name, effect.thrusters) for effect in diagnosis.effects] == [("thruster_gain", (4,))]
    gain = diagnosis.effects[0].parameters["gain_4"]
    assert gain.value == pytest.approx(0.55, abs=0.03)
    assert gain.low < 0.55 < gain.high
    assert diagnosis.gap.closed is not None and diagnosis.gap.closed > 0.9
    assert diagnosis.summary in run.stdout
    wanted = {"report.html", "diagnosis.json", "scenario.yaml", "predictions.parquet", "diagnosis.rrd", "config.yaml"}
    assert {path.name for path in out.iterdir()} >= wanted
    paper = load_vehicle("paper")
    scenario = read_scenario("found", yaml.safe_load((out / "scenario.yaml").read_text()), paper)
    assert float(scenario.vehicle_at(paper).gain[3]) == pytest.approx(0.55, abs=0.03)


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line(answers, folder, case):
    """What is wrong with a command line is said in one line that names it; exit code 2, and no folder stays."""
    code, _, err = answers[case]
    assert code == BAD_INPUT
    assert BAD[case][1] in err
    assert err.count("\n") == 1
    assert not (folder / case).exists()


def test_an_existing_folder_is_not_touched(answers, folder):
    """A folder with something in it is refused and stays as it is."""
    code, _, err = answers["used"]
    assert code == BAD_INPUT
    assert "already used" in err
    assert [path.name for path in (folder / "used").iterdir()] == ["precious.txt"]


def test_a_log_in_the_wrong_frame_gets_no_verdict(answers):
    """ENU for NED is refused with the remedy; the answer says how to insist."""
    code, _, err = answers["enu"]
    assert code == BAD_INPUT
    assert "down" in err and "trust_log=true" in err
    assert err.count("\n") == 1


def test_help_explains_every_setting(answers):
    """--help names each key of conf/diagnose.yaml."""
    code, out, _ = answers["help"]
    assert code == 0
    keys = yaml.safe_load((PROJECT / "conf" / "diagnose.yaml").read_text())
    for key in set(keys) - {"defaults", "help"}:
        assert key in out or f"--{key.replace('_', '-')}" in out


def test_a_healthy_log_that_is_the_log_is_refused(tmp_path):
    """Neither a copy, nor a link, nor a log to test on passes; an empty name is no log."""
    one, two, other = tmp_path / "a.csv", tmp_path / "b.csv", tmp_path / "c.csv"
    one.write_text("t,x\n0,1\n")
    two.write_text("t,x\n0,1\n")
    other.write_text("t,x\n0,2\n")
    (tmp_path / "link.csv").symlink_to(one)
    refuse_copies({"log": (one,), "healthy": (other,), "test": ()})
    with pytest.raises(FlightLogError, match=r"healthy=b\.csv is a copy of a\.csv"):
        refuse_copies({"log": (one,), "healthy": (other, two), "test": ()})
    with pytest.raises(FlightLogError, match=r"test=link\.csv is the log to explain itself"):
        refuse_copies({"log": (one,), "healthy": (), "test": (tmp_path / "link.csv",)})
    assert names(OmegaConf.create({"healthy": ""}), "healthy") == ()
