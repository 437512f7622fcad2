"""What commands import before their work begins, by sys.modules and not by the clock."""

import gc
import json
import os
import subprocess
import sys
from importlib import import_module

import pytest

from auv_torchrl.importing import importing
from auv_torchrl.paths import PROJECT

HEAVY = {"torch", "torchrl", "tensordict", "mujoco", "dm_control", "pandas", "pyarrow", "scipy", "matplotlib", "rerun"}
TRAIN, DIAGNOSE, CALIBRATE, LOG = (
    f"auv_torchrl.{part}.command" for part in ("experiment", "diagnosis", "diagnosis.calibrate", "flightlog")
)
CALL = """
import json, sys
from importlib import import_module

program, code = sys.argv.pop(1), 0
try:
    import_module(program).main()
except SystemExit as ended:
    code = ended.code
print(json.dumps([code or 0, sorted(sys.modules)]))
"""


def loaded(*words):
    """Exit code, and the modules that a process has imported when it ends; ``words`` follow ``python -c``."""
    environment = {**os.environ, "PYTHONPATH": str(PROJECT), "OMP_NUM_THREADS": "1"}
    run = subprocess.run([sys.executable, "-c", *words], capture_output=True, text=True, cwd=PROJECT, env=environment)
    assert run.returncode == 0, run.stderr
    code, modules = json.loads(run.stdout.splitlines()[-1])
    return code, set(modules)


@pytest.mark.parametrize(
    ("program", "arguments", "code"),
    [
        (TRAIN, ["--help"], 0),
        (TRAIN, ["vehicle=submarine"], 2),
        (TRAIN, ["agent.gama=0.9"], 2),
        (DIAGNOSE, ["--help"], 0),
        (DIAGNOSE, ["lgo=flight.csv"], 2),
        (CALIBRATE, ["--help"], 0),
        (CALIBRATE, ["helthy=flight.csv"], 2),
        (CALIBRATE, ["output=mine.yaml"], 2),
        (LOG, ["--help"], 0),
        (LOG, ["inform", "flight.csv"], 2),
    ],
)
def test_help_and_a_mistaken_command_line_are_answered_without_what_takes_long_to_import(program, arguments, code):
    """Neither torch nor a simulator nor a library for tables is loaded before work begins."""
    ended, modules = loaded(CALL, program, *arguments)
    assert ended == code
    assert not modules & HEAVY


def test_a_log_that_there_is_not_is_refused_before_torch_is_imported(tmp_path):
    """Also a file that is another than its name says."""
    (tmp_path / "flight.BIN").write_text("t,x\n")
    for log in ("nowhere.csv", "flight.BIN"):
        ended, modules = loaded(CALL, DIAGNOSE, f"log={tmp_path / log}", f"output={tmp_path / 'out'}")
        assert ended == 2
        assert not modules & HEAVY


@pytest.mark.parametrize("enabled", [True, False])
def test_imports_without_collections_leave_the_collector_as_it_was(enabled):
    """Also where what is imported fails."""
    before = gc.isenabled()
    try:
        (gc.enable if enabled else gc.disable)()
        with pytest.raises(ModuleNotFoundError), importing():
            assert not gc.isenabled()
            import_module("no_such_module")
        assert gc.isenabled() is enabled
    finally:
        (gc.enable if before else gc.disable)()


def test_a_diagnosis_imports_neither_torchrl_nor_an_environment_nor_a_compiler():
    """Of torch it needs the vehicle and the gradient of the physics."""
    code = """
import json, sys
from auv_torchrl.importing import importing_without_compiler
with importing_without_compiler():
    import auv_torchrl.diagnosis.job
print(json.dumps([0, sorted(sys.modules)]))
"""
    _, modules = loaded(code)
    assert "auv_torchrl.diagnosis.pipeline" in modules
    assert not modules & {"torchrl", "torch._dynamo", "gymnasium", "pandas", "scipy.stats", "matplotlib"}


def test_lists_become_columns_and_chi_squares_are_looked_up_without_pandas_and_fortran():
    """Otherwise pyarrow and scipy load them otherwise, for nothing that a recording or a diagnosis asks for."""
    code = """
import json, sys
from auv_torchrl.importing import importing, spare_pandas
with importing():
    import array_api_compat, scipy.special
    import numpy
    array_api_compat.array_namespace(numpy.zeros(1))
assert "f2py" in dir(numpy) and "f2py" in numpy.__all__
spare_pandas()
import pyarrow
assert pyarrow.array(["a", "b"]).to_pylist() == ["a", "b"]
print(json.dumps([0, sorted(sys.modules)]))
"""
    _, modules = loaded(code)
    assert {"pyarrow", "scipy.special"} <= modules
    assert not modules & {"pandas", "numpy.f2py"}
