"""The firmware itself between our physics and our policy, where the variable ARDUSUB names its program."""

import json
import os
import subprocess
import sys
import time

import pytest

from auv_torchrl.paths import PROJECT
from benchmarks.trial.control import FRAME, VEHICLE, by_policy, hold

PARAMETERS = "FRAME_CONFIG 2\nSIM_RATE_HZ 400\nBARO_EXT_BUS 1\nBARO_SPEC_GRAV 1.024\nBATT_MONITOR 0\nBTN4_FUNCTION 4\n"
TRIES = 12  # of a flight, until the firmware has a position: 10 s each


@pytest.mark.skipif("ARDUSUB" not in os.environ, reason="ARDUSUB does not name ArduSub's program")
def test_a_place_is_held_through_the_firmware(exported, tmp_path):
    """20 s, ended by the time that was set."""
    (tmp_path / "link.parm").write_text(PARAMETERS)
    environment = {**os.environ, "PYTHONPATH": str(PROJECT), "OMP_NUM_THREADS": "1"}
    python = [sys.executable, "-m"]
    physics = [*python, "auv_torchrl.link.command", "vehicle=bluerov2_heavy", "start.down=2"]
    firmware = [os.environ["ARDUSUB"], "--model", "JSON:127.0.0.1", "--home", "33.81,-118.39,0,0", "-I0", "-w",
                "--serial0", "udpclient:127.0.0.1:14550", "--defaults", "link.parm"]  # fmt: skip
    folder = tmp_path
    running = [subprocess.Popen(line, cwd=tmp_path, env=environment) for line in (physics, firmware)]
    try:
        for number in range(TRIES):
            folder = tmp_path / str(number)
            line = [*python, "auv_torchrl.fly.command", "connection=udpin:127.0.0.1:14550", f"policy={exported}",
                    "arm=true", "until_s=20", f"output={folder}"]  # fmt: skip
            if subprocess.run(line, cwd=tmp_path, env=environment).returncode == 0:
                break
            time.sleep(1.0)
        report = json.loads((folder / "flight.json").read_text())
        assert report["ended"]["why"] == "time" and report["mean_distance_after_10_s_m"] < 0.3
    finally:
        for process in running:
            process.kill()
            process.wait()


@pytest.mark.skipif("ARDUSUB" not in os.environ, reason="ARDUSUB does not name ArduSub's program")
def test_a_place_is_held_in_lock_step(exported, tmp_path):
    """The same on the clock of the simulation, by the true position, to what the autopilot's estimate drifts."""
    found = hold(VEHICLE, FRAME, {}, tmp_path / "ardusub", by_policy(exported, adapted=False))
    assert found["ended"] == "time" and found["mean_m"] < 0.15
    assert found["mean_m"] == pytest.approx(found["reported_m"], abs=0.05)
