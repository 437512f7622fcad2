"""What commands import before their work begins, by sys.modules and not by the clock."""

import ast
import json
import os
import re
import subprocess
import sys
from functools import cache
from importlib.util import find_spec

import pytest
import yaml

from auv_torchrl.paths import CONF, PROJECT

HEAVY = {"torch", "torchrl", "tensordict", "mujoco", "dm_control", "pandas", "pyarrow", "scipy", "matplotlib", "rerun"}
LIGHT = {"numpy", "omegaconf", "hydra", "antlr4", "jinja2", "logging"}  # what --help of a plain command does without
TRAIN, DIAGNOSE, CALIBRATE, LOG, SIM, EXPORT, FLY, PAGE = (
    f"auv_torchrl.{module}"
    for module in (
        "experiment.command", "monitoring.command", "diagnosis.command.calibrate", "flightlog.command", "link.command",
        "export.command", "fly.command", "page.command",
    )
)  # fmt: skip
CALL = """
import json, sys
from importlib import import_module

answers = []
for program, arguments in json.load(sys.stdin):
    sys.argv, code = [program, *arguments], 0
    try:
        import_module(program).main()
    except SystemExit as ended:
        code = ended.code
    answers.append([code or 0, sorted(sys.modules)])
print("\\n" + json.dumps(answers))
"""
LINES = [  # program, arguments, exit code; training last, for its settings stay, and all help is slower with them
    (DIAGNOSE, ["--help"], 0),
    (DIAGNOSE, ["--version"], 0),
    (DIAGNOSE, ["lgo=flight.csv"], 2),
    (CALIBRATE, ["--help"], 0),
    (CALIBRATE, ["helthy=flight.csv"], 2),
    (CALIBRATE, ["output=mine.yaml"], 2),
    (SIM, ["--help"], 0),
    (SIM, ["bnid=127.0.0.1:9002"], 2),
    (SIM, ["bind=0.0.0.0:9002"], 2),
    (EXPORT, ["--help"], 0),
    (EXPORT, ["polcy=outputs/policies/x"], 2),
    (FLY, ["--help"], 0),
    (FLY, ["conection=tcp:127.0.0.1:5760"], 2),
    (LOG, ["--help"], 0),
    (PAGE, ["--help"], 0),
    (PAGE, ["--host", "0.0.0.0"], 2),
    (LOG, ["--version"], 0),
    (LOG, ["inform", "flight.csv"], 2),
    (TRAIN, ["--help"], 0),
    (TRAIN, ["vehicle=submarine"], 2),
    (TRAIN, ["agent.gama=0.9"], 2),
]
LOGS = ("nowhere.csv", "flight.BIN")
# What a command imports where it comes to it: each takes longer than all that is imported before the work, less numpy.
LATE = {"scipy.linalg", "scipy.optimize", "scipy.special", "scipy.stats", "scipy.interpolate", "scipy.signal",
        "jinja2", "joblib", "llvmlite"}  # fmt: skip
WORK = {  # by module that a command works with, what it imports of these nevertheless
    "auv_torchrl.flightlog.job": set(),
    "auv_torchrl.diagnosis.command.diagnose_job": set(),
    "auv_torchrl.diagnosis.command.calibrate_job": set(),
    "auv_torchrl.monitoring.dive_job": set(),
    "auv_torchrl.monitoring.repeated_runs": set(),
    "auv_torchrl.link.job": set(),
    "auv_torchrl.fly.job": set(),
    "auv_torchrl.export.vehicle_job": set(),
    "auv_torchrl.page.worker": set(),
    "auv_torchrl.page.recognise": set(),
    "auv_torchrl.page.app": {"jinja2"},  # last: every answer of it is a page
}
IMPORT = """
import json, sys
from importlib import import_module

loaded = []
for module in json.load(sys.stdin):
    import_module(module)
    loaded.append(sorted(sys.modules))
print(json.dumps(loaded))
"""


def printed(code, given=None):
    """What a process that runs ``code`` says in its last line; ``given`` is its input. Both are JSON."""
    environment = {**os.environ, "PYTHONPATH": str(PROJECT), "OMP_NUM_THREADS": "1"}
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=PROJECT, env=environment,
                         input=json.dumps(given))  # fmt: skip
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """Exit code of each line and each log, and the modules that are loaded then, in one process for all of them.

    What one of them loads stays for those after it: where nothing heavy is there behind the last, none has loaded it.
    """
    folder = tmp_path_factory.mktemp("logs")
    (folder / "flight.BIN").write_text("t,x\n")
    logs = [(DIAGNOSE, [f"log={folder / name}", f"output={folder / 'out'}"]) for name in LOGS]
    told = printed(CALL, [*(line[:2] for line in LINES), *logs])
    return [(code, set(modules)) for code, modules in told]


@pytest.mark.parametrize("number", range(len(LINES)), ids=[" ".join([line[0], *line[1]]) for line in LINES])
def test_help_and_a_mistaken_command_line_are_answered_without_what_takes_long_to_import(answers, number):
    """Neither torch nor a simulator nor a library for tables is loaded before work begins."""
    ended, modules = answers[number]
    assert ended == LINES[number][2]
    assert not modules & HEAVY


def test_help_of_a_plain_command_imports_next_to_nothing():
    """So that it answers in a tenth of a second."""
    programs = [DIAGNOSE, CALIBRATE, SIM, EXPORT, LOG, PAGE]
    told = printed(CALL, [(program, ["--help"]) for program in programs])
    assert [code for code, _ in told] == [0] * len(programs) and not LIGHT & set(told[-1][1])


def test_a_log_that_there_is_not_is_refused_before_work_begins(answers):
    """Also a file that is another than its name says."""
    for ended, modules in answers[-len(LOGS) :]:
        assert ended == 2
        assert not modules & HEAVY


@pytest.fixture(scope="module")
def imported():
    """By module that a command works with, what is loaded behind it; what one loads stays for those after it."""
    there = [module for module in WORK if module != "auv_torchrl.page.app" or find_spec("fastapi")]
    return {module: set(loaded) for module, loaded in zip(there, printed(IMPORT, there), strict=True)}


@pytest.mark.parametrize("module", WORK)
def test_a_command_begins_its_work_without_what_it_may_not_need(imported, module):
    """Imports take 0.4 s at most on a laptop: scipy, templates and compilers are imported where they are used."""
    if module not in imported:
        pytest.skip("fastapi is not installed: pip install '.[page]'")
    assert imported[module] & (LATE | HEAVY - {"scipy"}) == WORK[module]


WITHOUT = """
import json, sys
from importlib import import_module

missing, given = json.load(sys.stdin)


class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in missing:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


sys.meta_path.insert(0, Missing())
"""
MISSED = """
missed = {}
for name in given:
    try:
        import_module(f"auv_torchrl.{name}")
        missed[name] = ""
    except ModuleNotFoundError as error:
        missed[name] = str(error)
print(json.dumps(missed))
"""
RUN = """
sys.argv = given
import_module(given[0]).main()
print()
print(json.dumps(sorted(sys.modules)))
"""
REFUSED = """
import io
sys.argv, sys.stderr = given, io.StringIO()
try:
    import_module(given[0]).main()
except SystemExit as ended:
    print()
    print(json.dumps([ended.code, sys.stderr.getvalue()]))
"""
UNTRAINED = (
    "monitoring.command", "monitoring.dive_job", "monitoring.repeated_runs", "diagnosis.command.diagnose_job",
    "diagnosis.command.calibrate_job", "link.job", "fly.job", "flightlog.job", "sensors",
    "simulator", "authority", "scenario", "sysid",
)  # fmt: skip
OF_TRAINING = (
    "torch", "tensordict", "torchrl", "gymnasium", "mujoco", "dm_control", "rerun", "pandas", "pyarrow", "matplotlib",
    "tensorboard", "safetensors", "hydra",
)  # fmt: skip


@pytest.fixture(scope="module")
def missed():
    """By module that is imported without what trains, what it misses; in one process, where nothing of that can be."""
    return printed(WITHOUT + MISSED, [OF_TRAINING, UNTRAINED])


@pytest.mark.parametrize("module", UNTRAINED)
def test_what_only_training_needs_need_not_be_installed(missed, module):
    """Diagnosis, calibration, monitoring, logs and the physics behind ArduSub are imported without it."""
    assert missed[module] == ""


def test_a_log_is_diagnosed_where_only_the_diagnosis_is_installed(tmp_path):
    """The verdict is there; the confirmation in MuJoCo and what other libraries write are left out."""
    given = [f"log={PROJECT / 'examples' / 'flight.csv'}", "vehicle=paper", f"output={tmp_path / 'out'}"]
    modules = printed(WITHOUT + RUN, [OF_TRAINING, [DIAGNOSE, *given]])
    assert "auv_torchrl.diagnosis.pipeline" in modules and not {*OF_TRAINING} & set(modules)
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert found["verdict"] == "explained" and found["gap"]["confirmed"] is None
    assert "not_confirmed" in [finding["code"] for finding in found["findings"]]
    assert (tmp_path / "out" / "report.html").is_file() and not (tmp_path / "out" / "diagnosis.rrd").exists()


@pytest.mark.parametrize("program", [TRAIN, EXPORT])
def test_what_trains_says_how_to_get_what_it_needs(program, tmp_path):
    """In one line, where only the diagnosis is installed."""
    name = program.split(".")[1].replace("experiment", "train")
    said = printed(WITHOUT + REFUSED, [OF_TRAINING, [program] if name == "train" else [program, "runs/mine"]])
    assert said[0] == 2 and re.fullmatch(
        rf"{name}: auv-{name} needs \w+, .* pip install 'auv_torchrl\[train\]'\n", said[1]
    )


def test_a_diagnosis_imports_nothing_of_training_where_it_is_installed():
    """Not even what is there: the gradient of the physics is compiled, and vehicles are numpy's."""
    code = """
import json, sys
import auv_torchrl.diagnosis.command.diagnose_job
print(json.dumps(sorted(sys.modules)))
"""
    modules = set(printed(code))
    assert "auv_torchrl.diagnosis.pipeline" in modules
    assert not modules & {*OF_TRAINING, "scipy.stats", "scipy.ndimage", "OpenGL"}


def test_a_confirmation_brings_no_window_system():
    """It loads MuJoCo, which then looks for a display unless it is told to draw nothing."""
    code = """
import json, sys
from auv_torchrl.diagnosis.validate.confirm import is_possible
assert is_possible()
print(json.dumps(sorted(sys.modules)))
"""
    modules = set(printed(code))
    assert "mujoco" in modules and not modules & {"glfw", "OpenGL"}


@cache
def imported_by(path):
    """Modules that a file imports, and those that it names in a string of its own, to import them late."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{name.name}" for name in node.names)}
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
    return found


def test_nothing_but_the_physics_imports_its_kernel():
    """Others take what is compiled from the public names of the physics, whatever stands behind them."""
    kernel, physics = "auv_torchrl.physics.kernel", PROJECT / "auv_torchrl" / "physics"
    files = [path for part in ("auv_torchrl", "benchmarks", "examples") for path in (PROJECT / part).rglob("*.py")]
    users = {path for path in files if any(f"{name}.".startswith(f"{kernel}.") for name in imported_by(path))}
    assert users and all(path.is_relative_to(physics) for path in users), users


def test_the_console_is_not_told_what_opengl_misses():
    """It says so when MuJoCo loads it, to every logger that listens."""
    code = """
import io, json, logging.config, sys
settings = json.load(sys.stdin)
out, sys.stdout = sys.stdout, io.StringIO()
logging.config.dictConfig(settings)
import OpenGL.acceleratesupport
print(json.dumps(sys.stdout.getvalue()), file=out)
"""
    settings = yaml.safe_load((CONF / "hydra" / "job_logging" / "plain.yaml").read_text())
    settings["handlers"] = {"console": settings["handlers"]["console"]}  # no file
    settings["root"]["handlers"] = ["console"]
    assert printed(code, settings) == ""


def test_hydra_is_reached_by_its_public_names():
    """What stands behind them moves with its versions; the name of a logger is none of these."""
    files = [path for part in ("auv_torchrl", "benchmarks", "tests") for path in (PROJECT / part).rglob("*.py")]
    code = {path: imported_by(path) for path in files}
    assert any("hydra" in names for names in code.values())
    inside, logger = ".".join(("hydra", "_")), ".".join(("hydra", "_internal", "callbacks"))
    assert not [path for path, names in code.items() for name in names - {logger} if name.startswith(inside)]
