"""How a command ends: stopped, on a full disk, on a terminal without Unicode; and what its arguments may be."""

import errno
import io
import json
import logging
import signal
import sys
from contextlib import redirect_stderr
from pathlib import Path

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import given
from hypothesis import strategies as st

from auv_torchrl.agents.interrupt import interruptible
from auv_torchrl.agents.storage import storing
from auv_torchrl.command import BadInput, LogFile, checking_input
from auv_torchrl.command.arguments import quote_files, refuse_unknown_keys
from auv_torchrl.command.compose import compose
from auv_torchrl.command.errors import CANNOT_WRITE, CannotWrite, writing
from auv_torchrl.command.terminal import spell_signs
from auv_torchrl.diagnosis.command import request
from auv_torchrl.diagnosis.command.schema import SCHEMAS
from auv_torchrl.diagnosis.report import write_files
from auv_torchrl.experiment.run import STORE
from auv_torchrl.flightlog import FlightLog
from auv_torchrl.hydra_command import callback
from auv_torchrl.hydra_command.explain import composed
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind import schema as blind_schema
from tests.diagnosis.example import example

QUIET = ("hydra/job_logging=none", "hydra/hydra_logging=none")  # pytest's logging stays as it is


@pytest.fixture
def train(monkeypatch, capsys):
    """Runs train.py in process with another function in place of the experiment; returns exit code and errors."""
    from auv_torchrl.experiment import command as train
    from auv_torchrl.experiment import job

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it

    def call(run, *arguments: str) -> tuple[int, str]:
        monkeypatch.setattr(job, "run", run)
        monkeypatch.setattr(sys, "argv", ["train.py", *arguments, *QUIET])
        code = 0
        try:
            train.main()
        except SystemExit as ended:
            code = int(ended.code or 0)
        return code, capsys.readouterr().err

    yield call
    signal.signal(signal.SIGINT, before)


def finishes(experiment, folder: Path) -> None:
    (folder / "seed.txt").write_text(str(experiment.seed))


def stops(signum: int):
    def run(experiment, folder: Path) -> None:
        signal.raise_signal(signum)

    return run


@pytest.mark.parametrize(
    ("signum", "expected"), [pytest.param(signal.SIGINT, 130, marks=pytest.mark.thorough), (signal.SIGTERM, 143)]
)
def test_a_stopped_run_is_continued_by_the_same_command_and_then_used_up(train, tmp_path, signum, expected):
    """Ctrl-C and SIGTERM alike: one line, the exit code of the signal; the folder goes on with the same settings."""
    out = f"output={tmp_path / 'out'}"
    code, error = train(stops(signum), "seed=3", out)
    assert code == expected and error == "train: interrupted: run the same command to go on\n"
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    code, error = train(finishes, "seed=4", out)
    assert code == 2 and "seed is 3 there and 4 here" in error and error.count("\n") == 1
    code, error = train(finishes, "seed=3", out)
    assert (code, error) == (0, "")
    assert json.loads((tmp_path / "out" / "run.json").read_text())["finished"]
    code, error = train(finishes, "seed=3", out)
    assert code == 2 and "a run that has finished" in error and "output=DIR" in error


def test_a_sweep_goes_on_with_the_jobs_that_have_not_finished(train, tmp_path):
    """Those that have are not done again."""
    done = []

    def run(experiment, folder: Path) -> None:
        done.append(experiment.seed)
        if done == [0, 1]:
            signal.raise_signal(signal.SIGTERM)
        finishes(experiment, folder)

    sweep = ("-m", "seed=0,1,2", f"output={tmp_path / 'out'}")
    assert train(run, *sweep)[0] == 143
    assert done == [0, 1]
    code, error = train(run, "-m", "seed=0,1,3", sweep[2])
    assert code == 2 and "seed=0,1,2 is given only there" in error
    assert train(run, *sweep)[0] == 0
    assert done == [0, 1, 1, 2]


def test_nothing_runs_where_its_folder_could_not_be_claimed(train, monkeypatch, tmp_path):
    """Hydra only warns of what goes wrong in callbacks; for us it is the end, also of a value that cannot be read."""
    begun = []

    def run(experiment, folder: Path) -> None:
        begun.append(folder)

    code, error = train(run, "device=${nope}", f"output={tmp_path / 'out'}")
    assert (code, error) == (2, "train: device: Interpolation key 'nope' not found\n")

    def defect(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setattr(callback, "claim_folder", defect)
    code, error = train(run, f"output={tmp_path / 'out'}")
    assert code == 1 and "ZeroDivisionError" in error
    assert not begun


def test_training_asks_for_the_signal_and_a_cluster_keeps_its_own_handler():
    """SIGTERM is a wish like Ctrl-C, unless somebody else handles it."""
    with interruptible() as asked:
        assert asked() is None
        signal.raise_signal(signal.SIGTERM)
        assert asked() == signal.SIGTERM
    heard = []
    signal.signal(signal.SIGTERM, lambda number, frame: heard.append(number))
    try:
        with interruptible() as asked:
            signal.raise_signal(signal.SIGTERM)
            assert asked() is None and heard == [signal.SIGTERM]
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def full(*_, **__):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_ends_training_with_one_line_and_keeps_the_folder(train, tmp_path):
    """The remedy is the same command."""

    def run(experiment, folder: Path) -> None:
        (folder / "results.json").write_text("kept")
        full()

    code, error = train(run, f"output={tmp_path / 'out'}")
    assert code == CANNOT_WRITE
    assert error.startswith("train: no space left") and "same command" in error and error.count("\n") == 1
    assert (tmp_path / "out" / "results.json").read_text() == "kept"
    assert train(finishes, f"output={tmp_path / 'out'}")[0] == 0


def test_a_policy_store_on_a_full_disk_ends_training_as_any_full_disk_does(train, tmp_path):
    """It says how to go on, and the folder waits for that."""

    def run(experiment, folder: Path) -> None:
        with checking_input(STORE), storing(tmp_path / "policies"):
            full()

    code, error = train(run, f"output={tmp_path / 'out'}")
    assert code == CANNOT_WRITE
    assert "nothing can be kept in" in error and "policies=DIR" in error and error.count("\n") == 1
    assert train(finishes, f"output={tmp_path / 'out'}")[0] == 0


def test_a_full_disk_keeps_the_verdict_and_the_same_diagnosis_goes_on(monkeypatch, capsys, caplog, tmp_path):
    """diagnose.py says what it found before it writes; half a file does not stay."""
    from auv_torchrl.diagnosis.command import diagnose_job as job
    from auv_torchrl.monitoring import command as diagnose

    caplog.set_level(logging.INFO)
    made = example()
    paper = load_vehicle("paper")
    asked = request.Request("paper", paper, (), None, (FlightLog("a", (), ()),))  # type: ignore[arg-type]
    monkeypatch.setattr(job, "read_request", lambda config: asked)
    monkeypatch.setattr(job, "diagnose", lambda *_, **__: made)
    log = tmp_path / "a(1)=b.csv"
    log.write_text("t\n")
    monkeypatch.setattr(sys, "argv", ["diagnose.py", f"log={log}", f"output={tmp_path / 'out'}"])
    with monkeypatch.context() as patched:
        patched.setattr("pyarrow.parquet.write_table", full)
        with pytest.raises(SystemExit) as ended:
            diagnose.main()
    error = capsys.readouterr().err
    assert ended.value.code == CANNOT_WRITE
    assert made.summary in caplog.text
    assert error.startswith("diagnose: no space left") and error.count("\n") == 1
    assert not list((tmp_path / "out").glob(".*"))
    diagnose.main()
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {
        "report.html",
        "predictions.parquet",
        "diagnosis.rrd",
    }
    with pytest.raises(SystemExit) as ended:
        diagnose.main()
    assert ended.value.code == 2 and "has finished" in capsys.readouterr().err


def test_files_of_a_diagnosis_are_replaced_only_where_that_is_asked_for(tmp_path):
    """The folder of an unfinished run is written anew, others are not."""
    paper = load_vehicle("paper")
    write_files(example(), paper, tmp_path)
    with pytest.raises(FileExistsError):
        write_files(example(), paper, tmp_path)
    write_files(example(), paper, tmp_path, replace=True)


@pytest.mark.parametrize(
    "error",
    [
        OSError(errno.ENOSPC, "No space left on device"),
        OSError(errno.EDQUOT, "Disk quota exceeded"),
        RuntimeError("Error while serializing: I/O error: No space left on device (os error 28)"),
        OSError(errno.EACCES, "Permission denied", "policies"),
    ],
    ids=str,
)
def test_what_cannot_be_written_is_one_line_with_a_remedy(error):
    """Whichever library says it, also as the cause of another error."""
    with pytest.raises(CannotWrite, match="give a file or folder|make room"), writing():
        raise error
    with pytest.raises(CannotWrite, match="give a file or folder|make room"), writing():
        raise RuntimeError("unexpected pos") from error
    with pytest.raises(ZeroDivisionError), writing():
        _ = 1 / 0


def test_a_log_on_a_full_disk_says_so_once_and_stops_nothing():
    """/dev/full is a disk without room."""
    handler, error = LogFile("/dev/full"), io.StringIO()
    record = logging.LogRecord("x", logging.INFO, "", 0, "said", (), None)
    with redirect_stderr(error):
        for _ in range(3):
            if record.levelno >= handler.level:
                handler.handle(record)
        handler.close()
    assert error.getvalue() == "/dev/full ends here: No space left on device\n"


def test_signs_that_a_terminal_lacks_are_spelt(monkeypatch):
    """No UnicodeEncodeError, and every sign that we print has a spelling."""
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding="ascii"))
    spell_signs()
    print("── ±1 m, ≥ 5, 0.2 → 0.1, 99\u202f%, “no effect”, flüg", flush=True)
    assert raw.getvalue() == b'-- +-1 m, >= 5, 0.2 -> 0.1, 99 %, "no effect", fl\\xfcg\n'


@pytest.mark.parametrize(
    ("given", "names"),
    [
        ("log=flüg.csv", "flüg.csv"),
        ("log=flight(1).csv", "flight(1).csv"),
        ("log=a=b.csv", "a=b.csv"),
        ("log=my flight.csv", "my flight.csv"),
        ("log=it's & so.csv", "it's & so.csv"),
        ("log=2024", "2024"),
        ("log=1e3", "1e3"),
        (
            "log=[a=b.csv, flight(1).csv,'x,y.csv', my flight.csv]",
            ["a=b.csv", "flight(1).csv", "x,y.csv", "my flight.csv"],
        ),
        ("log='quoted, already.csv'", "quoted, already.csv"),
        ("log=[a.csv,b.csv]", ["a.csv", "b.csv"]),
        ("log=null", None),
        ("log={MOT_1_DIRECTION: -1}", {"MOT_1_DIRECTION": -1}),
        ("log=${oc.env:HOME}/a.csv", "${oc.env:HOME}/a.csv"),
    ],
)
def test_names_of_files_need_no_quotes(given, names):
    """As a shell hands them on."""
    (argument,) = quote_files([given], ["log"])
    value = OverridesParser.create().parse_override(argument).value()
    assert value == names or str(value) == names


@given(st.text(st.characters(blacklist_categories=("Cs", "Cc")), min_size=1))
def test_every_name_of_a_file_is_read_as_it_is(name):
    """Whatever signs are in it, unless they mean something to Hydra or to us."""
    if name.strip() != name or set(name) & set(",[]{}'\"\\~$") or name.lower() in ("null", "true", "false"):
        return
    (argument,) = quote_files([f"log={name}"], ["log"])
    parsed = OverridesParser.create().parse_override(argument)
    assert parsed.is_sweep_override() or str(parsed.value()) == name


def test_several_files_without_brackets_are_told_from_a_sweep(tmp_path, monkeypatch):
    """A list is proposed; with -m it is a sweep; a file that is there is that file."""
    with pytest.raises(BadInput, match=r"give log=\[a\(1\)\.csv,b\.csv\] for several"):
        quote_files(["log=a(1).csv,b.csv"], ["log"])
    assert quote_files(["-m", "log=a(1).csv,b.csv"], ["log"]) == ["-m", "log='a(1).csv','b.csv'"]
    assert quote_files(["log=a,b.csv"], ["log"]) == ["log=a,b.csv"]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a,b.csv").touch()
    assert quote_files(["log=a,b.csv"], ["log"]) == ["log='a,b.csv'"]


def test_files_with_spaces_between_are_a_list_where_one_of_them_is_there(tmp_path, monkeypatch):
    """As make hands them on; a name with a space in it is one file where there is such a file, or none at all."""
    monkeypatch.chdir(tmp_path)
    for name in ("a.csv", "b c.csv", "d, e.csv", "it's.csv"):
        (tmp_path / name).touch()
    for files, names in {
        "a.csv 'b c.csv'": ["a.csv", "b c.csv"],
        "a.csv 'd, e.csv' nowhere.csv": ["a.csv", "d, e.csv", "nowhere.csv"],
        "a.csv it's.csv": ["a.csv", "it's.csv"],
        "b c.csv": "b c.csv",
        "d, e.csv": "d, e.csv",
        "no where.csv": "no where.csv",
    }.items():
        (argument,) = quote_files([f"healthy={files}"], ["healthy"])
        assert OverridesParser.create().parse_override(argument).value() == names


@pytest.mark.parametrize(
    ("command", "given", "near"),
    [
        ("diagnose", "+foo=1", "there are alike, diagnosis"),
        ("diagnose", "+lgo=1", "did you mean log"),
        ("diagnose", "+scenario=swap", "no config key 'scenario'"),
        ("blind", "+sed=1", "did you mean seed"),
        ("blind", "+case=1", "did you mean cases"),
    ],
)
def test_a_key_misspelt_after_a_plus_is_refused_by_every_command(command, given, near):
    """train.py is above; nothing is added that nothing would read."""
    blind_schema.register()
    settings = compose("diagnose", schemas=SCHEMAS).config if command == "diagnose" else composed(command)
    with pytest.raises(BadInput, match=near):
        refuse_unknown_keys(lambda: settings, [given], ())
    refuse_unknown_keys(lambda: settings, ["+vehicle.rigid_body.mass=3"] if command == "diagnose" else [], ())
