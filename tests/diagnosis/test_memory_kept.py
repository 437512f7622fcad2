"""Memory that arrays gave back is kept for the next ones."""

import subprocess
import sys

import pytest

MAKES_ARRAYS = """
import resource
import numpy as np
from auv_torchrl.diagnosis.memory import keep_freed_memory
keep_freed_memory()
def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
ones = np.ones(2**21)  # 16 MB, of which the C library keeps none by itself
ones * 2.0
before = faults()
for _ in range(40):
    ones * 2.0
print(faults() - before)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other C libraries are left as they are")
def test_pages_are_cleared_once():
    """Forty arrays of 16 MB, each given back before the next, ask for fewer pages than one of them has."""
    run = subprocess.run([sys.executable, "-c", MAKES_ARRAYS], capture_output=True, text=True, check=True)
    assert int(run.stdout) < 16 * 2**20 // 4096


GIVES_BACK = """
import numpy as np
from auv_torchrl.diagnosis.memory import give_back_freed_memory, keep_freed_memory
keep_freed_memory()
def resident():
    return int(open("/proc/self/statm").read().split()[1]) * 4096
arrays = [np.ones(2**20) for _ in range(20)]  # 8 MB each
last = np.ones(2**17)  # behind them, so that they are not the end of what the C library has
del arrays
before = resident()
give_back_freed_memory()
print(before - resident())
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other C libraries are left as they are")
def test_what_is_kept_can_be_given_back():
    """Most of 160 MB of arrays that are gone is the system's again when asked for."""
    run = subprocess.run([sys.executable, "-c", GIVES_BACK], capture_output=True, text=True, check=True)
    assert int(run.stdout) > 100 * 2**20
