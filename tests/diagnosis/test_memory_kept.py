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
