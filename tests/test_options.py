"""A plain command line: files as arguments, options, help and the Tab key."""

import os
import subprocess
import sys

import pytest

from auv_torchrl.command import BadInput
from auv_torchrl.command.completion import SCRIPTS, candidates
from auv_torchrl.command.entry import help_of
from auv_torchrl.diagnosis.command import calibrate
from auv_torchrl.export import command as export
from auv_torchrl.flightlog import command as flightlog
from auv_torchrl.flightlog.command import _parsed
from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.readers import READERS
from auv_torchrl.link import command as link
from auv_torchrl.monitoring import command as diagnose
from auv_torchrl.paths import PROJECT

LINES = {command.LINE.name: command.LINE for command in (diagnose, calibrate, link, export)}


@pytest.fixture
def dives(tmp_path, monkeypatch):
    """A folder with three dives, which is the working directory."""
    for name in ("a.BIN", "b c.BIN", "sound=1.csv"):
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("words", "overrides"),
    [
        (["a.BIN", "--vehicle", "paper", "--healthy", "b c.BIN"], "log='a.BIN' vehicle='paper' healthy='b c.BIN'"),
        (["a.BIN", "b c.BIN"], "log=['a.BIN','b c.BIN']"),
        (["--healthy", "a.BIN", "sound=1.csv", "--", "b c.BIN"], "healthy=['a.BIN','sound=1.csv'] log='b c.BIN'"),
        (["--healthy=a.BIN", "b c.BIN"], "healthy='a.BIN' log='b c.BIN'"),
        (["--healthy", "a.BIN", "--healthy", "b c.BIN", "log=x.csv"], "log=x.csv healthy=['a.BIN','b c.BIN']"),
        (["*.BIN"], "log=['a.BIN','b c.BIN']"),
        (["sound=1.csv"], "log='sound=1.csv'"),
        (["example", "--explain", "--trust-log"], "log='example' explain=true trust_log=true"),
        (["a.BIN", "--explain=false"], "log='a.BIN' explain=false"),
        (["a.BIN", "--modes", "MANUAL", "ALT_HOLD"], "log='a.BIN' modes=[MANUAL,ALT_HOLD]"),
        (["a.BIN", "--jobs", "-1", "--system", "2"], "log='a.BIN' jobs=-1 system=2"),
        (["a.BIN", "--params", "{MOT_1_DIRECTION: -1}"], "log='a.BIN' params={MOT_1_DIRECTION: -1}"),
        (["log=a.BIN", "vehicle.coriolis=1", "+vehicle.air=1"], "log=a.BIN vehicle.coriolis=1 +vehicle.air=1"),
        (["diagnosis.ignored=[" + "a," * 500 + "b]"], "diagnosis.ignored=[" + "a," * 500 + "b]"),
        ([], ""),
    ],
)  # fmt: skip
def test_files_and_options_are_settings(dives, words, overrides):
    """Names of files are taken as they are; what is a list takes all that follows."""
    assert " ".join(LINES["diagnose"].overrides(words)) == overrides


def test_a_scenario_is_added():
    """One is a name, several are a list."""
    assert LINES["sim"].overrides(["--scenario", "swap", "--seed", "3"]) == ["+scenario='swap'", "seed=3"]
    assert LINES["sim"].overrides(["--scenario", "swap", "current"]) == ["+scenario=['swap','current']"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--helthy", "a.BIN"], "did you mean --healthy"),
        (["-v"], "no such option, --help lists them"),
        (["--vehicle"], "--vehicle needs a value"),
        (["--vehicle", "--healthy", "a.BIN"], "--vehicle needs a value"),
        (["--vehicle", "paper", "--vehicle", "bluerov2"], "--vehicle takes one value: paper and bluerov2"),
        (["a.BIN", "log=b.BIN"], "log is given twice"),
        (["--healthy", "a.BIN", "healthy=b.BIN"], "healthy is given twice"),
        (["none*.BIN"], r"no file matches none\*\.BIN"),
        (["paper"], "paper is given without a key"),
        (["--multirun", "a.BIN"], "auv-diagnose has no sweeps"),
    ],
)
def test_a_mistaken_option_is_one_line_that_says_what_to_give(dives, words, says):
    """It names the option."""
    with pytest.raises(BadInput, match=says):
        LINES["diagnose"].overrides(words)


@pytest.mark.parametrize("name", LINES)
def test_every_setting_is_an_option_that_help_names(name):
    """Settings that are mappings are given as name=value alone."""
    text = help_of(LINES[name])
    missing = [option for option in LINES[name].keys if option not in text and option not in ("--help", "--diagnosis")]
    named = {"diagnose": "--log", "calibrate": "--healthy", "export": "--policy"}.get(name)
    assert [option for option in missing if option != named] == []
    assert "$" not in text.replace('"$(auv-', "") and max(map(len, text.split("\n"))) <= 125


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("auv-diagnose --vehicle blu", ["bluerov2", "bluerov2_heavy"]),
        ("auv-diagnose vehicle=pa", ["vehicle=paper"]),
        ("auv-diagnose --vehicle=pa", ["--vehicle=paper"]),
        ("auv-diagnose --he", ["--healthy", "--help"]),
        ("auv-diagnose dives_", ["dives_per_false_alarm="]),
        ("auv-diagnose --healthy a", ["alike="]),
        ("auv-diagnose ", []),
        ("auv-diagnose --healthy ", []),
    ],
)
def test_the_tab_key_proposes_what_may_stand_there(line, found):
    """Names of files are the shell's part."""
    assert candidates(LINES["diagnose"].keys, line) == found


def test_bash_completes_a_line(tmp_path):
    """The script is loaded by a shell of its own, in which the command is a function."""
    program = f"""
auv-diagnose() {{ {sys.executable} {PROJECT / "diagnose.py"} "$@"; }}
eval "$(auv-diagnose --completion bash)"
complete -p auv-diagnose
for COMP_LINE in "auv-diagnose vehicle=blu" "auv-diagnose --vehi"; do
  COMP_POINT=${{#COMP_LINE}}; _auv_diagnose; echo "${{COMPREPLY[*]}}"
done
"""
    environment = {**os.environ, "PYTHONPATH": str(PROJECT)}
    said = subprocess.run(["bash", "-c", program], capture_output=True, text=True, cwd=tmp_path, env=environment)
    assert said.stdout.split() == [
        "complete", "-o", "default", "-F", "_auv_diagnose", "auv-diagnose", "bluerov2", "bluerov2_heavy", "--vehicle",
    ]  # fmt: skip
    assert set(SCRIPTS) == {"bash", "zsh", "fish"}


@pytest.mark.parametrize("words", [["--help"], ["example", "--cfg", "job"]])
def test_nobody_has_to_read_to_the_end(words):
    """As after ``auv-diagnose --help | head -1``."""
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, str(PROJECT / "diagnose.py"), *words]
    ended = subprocess.run(
        command, stdout=write, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": ""}
    )
    os.close(write)
    assert (ended.returncode, ended.stderr) == (0, "")


def test_the_console_goes_on_where_nobody_reads():
    """The log of the run has all; there is no word about the pipe."""
    code = """
import logging, sys
from auv_torchrl.command import Console
log = logging.getLogger("diagnose")
log.addHandler(Console(sys.stdout))
for _ in range(2):
    log.error("found")
"""
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-c", code]
    ended = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, cwd=PROJECT)
    os.close(write)
    assert (ended.returncode, ended.stderr) == (0, "")


def test_logs_are_named_by_options_too(dives):
    """As for the other commands; a file alone is looked into."""
    assert _parsed(["a.BIN", "--healthy", "b c.BIN"])[::2] == ("info", {"healthy": "b c.BIN"})
    assert [str(path) for path in _parsed(["info", "*.BIN"])[1]] == ["a.BIN", "b c.BIN"]
    assert _parsed(["convert", "a.BIN", "--output=x.csv", "--replace"])[2] == {"output": "x.csv", "replace": "true"}
    for words, says in (
        (["info", "a.BIN", "--helthy", "x"], "did you mean --healthy"),
        (["a.BIN", "--params"], "needs a"),
    ):
        with pytest.raises(FlightLogError, match=says):
            _parsed(words)


def test_the_help_of_logs_names_every_format():
    """It is written there, because --help imports no reader."""
    assert ", ".join(READERS) in flightlog.HELP
