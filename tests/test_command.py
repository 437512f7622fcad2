"""Bad input ends with one line that says what there is, and nothing is overwritten."""

import sys
from importlib import import_module

import pytest

from auv_torchrl import __version__
from auv_torchrl.command import BadInput, checking_input, claim_folder
from tests.command_lines import answers_of


def like_another(argument: str, names: list[str]):
    """A command line that is wrong as another one of these is, which CI leaves out."""
    return pytest.param(argument, names, marks=pytest.mark.thorough)


@pytest.fixture
def train(monkeypatch, capsys):
    """Runs train.py in process; returns exit code and standard error. The experiment itself must not begin."""
    from auv_torchrl.experiment import command as train
    from auv_torchrl.experiment import job

    def must_not_run(*_):
        raise AssertionError("the experiment began in spite of bad input")

    monkeypatch.setattr(job, "run", must_not_run)

    def call(*arguments: str) -> tuple[int, str]:
        quiet = ["hydra/job_logging=none", "hydra/hydra_logging=none"]  # pytest's logging stays as it is
        monkeypatch.setattr(sys, "argv", ["train.py", *arguments, *quiet])
        with pytest.raises(SystemExit) as ended:
            train.main()
        assert isinstance(ended.value.code, int)
        return ended.value.code, capsys.readouterr().err

    return call


@pytest.mark.parametrize(
    ("argument", "names"),
    [
        ("+scenario=foo", ["'foo'", "swap", "two_dead"]),
        like_another("+scenario=[swap,foo]", ["'foo'", "swap", "two_dead"]),
        ("vehicle=foo", ["'foo'", "paper", "bluerov2_heavy"]),
        ("agent=foo", ["'foo'", "sac"]),
        ("agent=sac_schema", ["no agent named 'sac_schema'", "there are gradient, ppo, sac, td3\n"]),
        like_another("task=line_schema", ["no task named 'line_schema'", "line"]),
        like_another("adapter=foo", ["'foo'", "affine"]),
        ("randomization=foo", ["'foo'", "none"]),
        ("scenario=swap", ["+scenario=swap"]),
        ("sed=3", ["'sed'", "did you mean seed"]),
        ("agent.gama=0.9", ["'gama'", "did you mean gamma"]),
        ("task.box=3", ["'box'", "did you mean box_m"]),
        ("seed=x", ["seed=x", "Integer"]),
        like_another("starts=2.5", ["starts=2.5", "Integer"]),
        ("backend=foo", ["foo", "mujoco", "torch"]),
        ("device=foo", ["'foo'", "cpu"]),
        ("box_m=-1", ["box_m", "above 0"]),
        like_another("starts=0", ["starts", "1 or more"]),
        ("task.episode_s=5", ["episode_s", "10 s"]),
        ("agent.loss=foo", ["loss", "fused", "stock"]),
        ("adapter.map=foo", ["map", "affine"]),
        ("vehicle.rigid_body.mass=-3", ["rigid_body.mass", "above 0"]),
        ("vehicle.thrusters.volts=16", ["leaves out vehicle.thrusters.volts: give +vehicle.thrusters.volts=16\n"]),
        ("vehicle.sensors.dvl_position=[0,0,1]", [": give '+vehicle.sensors.dvl_position=[0,0,1]'\n"]),
        like_another("vehicle.air=1", [": give +vehicle.air=1\n"]),
        ("vehicle.thrusters.vlts=16", ["no config key 'vlts' in vehicle.thrusters"]),
        ("+scenario.effects.curent.north=0.2", ["'curent'", "current"]),
        ("+scenario.effects.current.nord=0.2", ["'nord'", "north"]),
        ("+scenario.effects.current.north=200", ["north", "[-2, 2]"]),
        ("+randomization.curent.north=[0,1]", ["'curent'", "did you mean current"]),
        ("+scenaro=swap", ["'scenaro'", "did you mean scenario"]),
        ("+sede=3", ["'sede'", "did you mean seed"]),
        like_another("++sede=3", ["'sede'", "did you mean seed"]),
        ("+agent.gama=0.9", ["'gama'", "did you mean gamma"]),
        like_another("++agent.gama=0.9", ["'gama'", "did you mean gamma"]),
        ("+adapter.windw=3", ["'windw'", "did you mean window"]),
        ("+adaptation.ditherr=0.1", ["'ditherr'", "did you mean dither"]),
        ("+randomization.x=1", ["'x'", "added_mass"]),
        ("+vehicle.mixr=1", ["'mixr'", "did you mean mixer"]),
        ("+diagnosis.x=1", ["'diagnosis'", "did you mean diagnose"]),
        ("+scenario.efects.current.north=0.2", ["'efects'", "did you mean effects"]),
        ("+scenario@scene=swap", ["without @scene"]),
        ("+agent=sac", ["agent=... without +"]),
        ("vehicle=null", ["there are", "bluerov2_heavy"]),
        (f"policies={__file__}", ["policies", "give a folder"]),
        like_another("box_m=inf", ["box_m is inf", "above 0"]),
        ("agent.loss=a=b", ["agent.loss", "in quotes"]),
        ("flight.csv", ["flight.csv is given without a key: give key=value"]),
        ("hydra.searchpath=[file:///tmp]", ["--config-dir FOLDER"]),
        ("+hydra.callbacks.mine={_target_:os.system,command:false}", ["os.system"]),
        ("+hydra.callbacks.mine={_target_:logging.os.system,command:false}", ["os.system"]),
    ],
)
def test_bad_input_is_one_line_that_names_what_there_is(train, tmp_path, argument, names):
    """Exit code 2, no traceback, and the words that a person needs to go on."""
    code, error = train(argument, f"output={tmp_path / 'out'}")
    assert code == 2
    assert error.startswith("train: ") and error.count("\n") == 1
    for name in names:
        assert name in error


def test_a_schema_is_no_option_of_a_sweep_either(train, tmp_path):
    """Refused before the folder is made."""
    code, error = train("-m", "agent=sac,sac_schema", f"output={tmp_path / 'out'}")
    assert code == 2 and error.startswith("train: no agent named 'sac_schema': there are ")
    assert not (tmp_path / "out").exists()


def test_help_lists_no_schema():
    """What can be chosen is what lies in ``conf``."""
    _, said, _ = answers_of("auv_torchrl.experiment.command", {"help": ["--help"]})["help"]
    assert "\nagent: gradient, ppo, sac, td3\n" in said and "schema" not in said


def test_a_used_output_folder_is_refused_and_left_as_it_is(train, tmp_path):
    """The message names what is in it and the way out."""
    (tmp_path / "results.json").write_text("mine")
    code, error = train(f"output={tmp_path}")
    assert code == 2 and "already used" in error and "results.json" in error and "output=DIR" in error
    assert [path.name for path in tmp_path.iterdir()] == ["results.json"]
    assert (tmp_path / "results.json").read_text() == "mine"


def test_a_used_folder_of_a_sweep_is_refused_too(train, tmp_path):
    """Nothing is written before the refusal."""
    (tmp_path / "multirun.yaml").write_text("mine")
    code, error = train("-m", "seed=0,1", f"output={tmp_path}")
    assert code == 2 and "already used" in error
    assert (tmp_path / "multirun.yaml").read_text() == "mine"


def test_a_folder_that_cannot_be_written_is_refused(train, tmp_path):
    """Here a file is in the way."""
    (tmp_path / "file").write_text("")
    code, error = train(f"output={tmp_path / 'file' / 'out'}")
    assert code == 2 and "cannot write" in error and "output=DIR" in error


def test_only_one_run_gets_a_folder(tmp_path):
    """Two runs that start in the same second do not write into each other's folder."""
    claim_folder(tmp_path / "run")
    with pytest.raises(BadInput, match="already used"):
        claim_folder(tmp_path / "run")


def test_errors_of_the_program_itself_keep_their_traceback():
    """Only named kinds of errors of checking functions become bad input."""
    with pytest.raises(ZeroDivisionError), checking_input():
        _ = 1 / 0
    with pytest.raises(BadInput, match="^a b$"), checking_input():
        raise ValueError("a\n  b")


@pytest.mark.parametrize(
    "module",
    ["experiment.command", "monitoring.command", "diagnosis.command.calibrate", "flightlog.command", "link.command",
     "export.command"],
)  # fmt: skip
def test_every_command_tells_the_version_of_the_package(module, monkeypatch, capsys):
    """Not that of Hydra, by which most of them read their command line."""
    monkeypatch.setattr(sys, "argv", ["auv", "--version"])
    import_module(f"auv_torchrl.{module}").main()
    assert capsys.readouterr().out == f"auv_torchrl {__version__}\n"


def test_a_shell_completes_names_of_scenarios_and_files(monkeypatch, capsys, tmp_path):
    """By Hydra's completion, which asks the command itself."""
    (tmp_path / "flight.csv").touch()
    own_file = (f"auv-train diagnosis_file={tmp_path}/fl", f"diagnosis_file={tmp_path}/flight.csv")
    for line, found in (("auv-train +scenario=reversed_", "+scenario=reversed_and_dead"), own_file):
        monkeypatch.setenv("COMP_LINE", line)
        monkeypatch.setattr(sys, "argv", ["auv-train", "-sc", "query=bash"])
        import_module("auv_torchrl.experiment.command").main()
        assert capsys.readouterr().out.split() == [found]
