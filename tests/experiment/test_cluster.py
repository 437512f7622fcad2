"""A sweep on a cluster of workers, of which one dies."""

import os
import signal
import subprocess
import sys
import time
from typing import Any

import pytest
from distributed import LocalCluster

from auv_torchrl import parallel
from auv_torchrl.parallel import CLUSTER, each
from auv_torchrl.paths import PROJECT
from tests.experiment.conftest import TINY

SWEEP = ["-m", "seed=0,1", "hydra/launcher=joblib", "flight.fly=false", *TINY]


@pytest.mark.thorough
@pytest.mark.slow
def test_a_sweep_is_complete_though_a_worker_is_killed(policies, tmp_path):
    """Two Dask workers begin two jobs, one worker is killed, and both jobs end with their results."""
    train = [sys.executable, str(PROJECT / "train.py"), *SWEEP, f"policies={policies}", f"output={tmp_path / 'sweep'}"]
    start: Any = LocalCluster  # its types are those of the asynchronous one
    with start(n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1") as workers:
        environment = {**os.environ, CLUSTER: workers.scheduler_address}
        sweep = subprocess.Popen(train, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        while sweep.poll() is None and len(list((tmp_path / "sweep").glob("*/run.json"))) < 2:
            time.sleep(0.05)
        victim = next(iter(workers.workers.values())).pid
        os.kill(victim, signal.SIGKILL)
        said, _ = sweep.communicate(timeout=600)
    assert sweep.returncode == 0, said
    assert len(list((tmp_path / "sweep").glob("*/results.json"))) == 2
    assert "| nominal | paper |" in (tmp_path / "sweep" / "summary.md").read_text()


def test_a_cluster_that_nothing_speaks_to_is_refused(monkeypatch):
    """The package that is missing is named with the command that installs it."""
    monkeypatch.setenv(CLUSTER, "tcp://nowhere:8786")
    monkeypatch.setattr(parallel, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"tcp://nowhere:8786 needs Dask: pip install 'auv_torchrl\[cluster\]'"):
        parallel.use_cluster()


def test_results_come_in_the_order_of_the_tasks():
    """In processes, too."""
    assert list(each(abs, [-3, 2, -1], jobs=2)) == [3, 2, 1]
    assert sorted(each(abs, [-3, 2, -1], jobs=2, in_order=False)) == [1, 2, 3]
