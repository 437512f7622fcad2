"""The firmware itself in front of our physics, where the variable ARDUSUB names its program."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from auv_torchrl.flightlog import read_flightlog
from auv_torchrl.fly.known import MANUAL
from auv_torchrl.fly.mavlink import Parser
from auv_torchrl.paths import PROJECT
from benchmarks.trial.dive import ALT_HOLD, Diver
from benchmarks.trial.firmware import Firmware
from benchmarks.trial.stack import Stack

pytestmark = pytest.mark.skipif("ARDUSUB" not in os.environ, reason="ARDUSUB does not name ArduSub's program")
WAIT_S = 120.0  # of the wall clock, on a busy machine


class Ground:
    """A ground station that listens alone."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(1.0)
        self.port = self.socket.getsockname()[1]

    def boot_s(self):
        """The clock of the firmware in its next heartbeat's second, s; an error where none comes."""
        parser, end = Parser(), time.monotonic() + WAIT_S
        while time.monotonic() < end:
            try:
                data = self.socket.recv(65536)
            except TimeoutError:
                continue
            for message in parser.feed(data):
                if "time_boot_ms" in message.fields:
                    return message.fields["time_boot_ms"] / 1000
        raise AssertionError("the firmware says nothing")

    def after(self, seconds):
        """Wait until the clock of the firmware is beyond."""
        end = time.monotonic() + WAIT_S
        while (now := self.boot_s()) < seconds:
            assert time.monotonic() < end, f"the firmware's clock stands at {now} s"
        return now


@pytest.fixture
def simulated(tmp_path):
    """Starts ``auv-sim``; the process, and the port at which it waits."""
    running = []

    def start(folder, port=0):
        environment = {**os.environ, "PYTHONPATH": str(PROJECT), "OMP_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"}
        line = [sys.executable, "-m", "auv_torchrl.link.command", "--vehicle", "bluerov2_heavy", "--paced=false",
                "--bind", f"127.0.0.1:{port}", "--output", folder]  # fmt: skip
        said = (tmp_path / f"{folder}.txt").open("w+")
        running.append(subprocess.Popen(line, cwd=tmp_path, env=environment, stdout=said, stderr=subprocess.STDOUT))
        end = time.monotonic() + WAIT_S
        while not (found := re.search(r"waiting for ArduSub at 127\.0\.0\.1:(\d+)", Path(said.name).read_text())):
            assert time.monotonic() < end and running[-1].poll() is None, Path(said.name).read_text()
            time.sleep(0.2)
        return running[-1], int(found[1])

    yield start
    for process in running:
        process.kill()
        process.wait()


def test_either_side_may_be_started_anew(simulated, tmp_path):
    """The firmware, which begins another episode, and the physics, under which the firmware goes on."""
    ground = Ground()
    physics, port = simulated("first")
    firmware = Firmware(tmp_path / "ardusub", port, ground.port, {"FRAME_CONFIG": 2})
    ground.after(5.0)
    firmware.close()
    firmware = Firmware(tmp_path / "ardusub", port, ground.port, {"FRAME_CONFIG": 2})
    reached = ground.after(5.0)
    physics.send_signal(signal.SIGTERM)
    physics.wait(WAIT_S)
    said = (tmp_path / "first.txt").read_text()
    assert "1 restart of the firmware" in said
    flown = np.genfromtxt(tmp_path / "first" / "truth.csv", delimiter=",", names=True)
    assert set(flown["episode"]) == {0, 1}
    try:
        second, _ = simulated("second", port)
        ground.after(reached + 5.0)
        second.send_signal(signal.SIGTERM)
        second.wait(WAIT_S)
        assert firmware.ended is None
        assert "Detected physics reset" in (tmp_path / "ardusub" / "ardusub.txt").read_text()
    finally:
        firmware.close()


def test_the_firmware_flies_our_vehicle(plant, tmp_path):
    """Armed, it goes ahead in MANUAL and keeps its depth in ALT_HOLD; its log is one of a dive of that vehicle."""
    stack = Stack(plant(down=5.0, held=True), tmp_path, {"FRAME_CONFIG": 2})
    try:
        diver = Diver(stack)
        diver.begin(stack.plant.start.let_down_s)
        diver.arm(MANUAL)
        diver.push((0.2, 0.0, 0.0, 0.0), 4.0)
        gone = stack.plant.moment.state[0][0]
        diver.arm(ALT_HOLD)
        diver.wait(5.0)
        held = stack.plant.moment.state[0][0][2]
        diver.wait(15.0)
        assert gone[0] > 0.5
        assert stack.plant.moment.state[0][0][2] == pytest.approx(held, abs=0.15)
        diver.disarm()
    finally:
        stack.close()
    (path,) = stack.firmware.logs()
    log = read_flightlog(path, plant().vehicle)
    assert log.duration > 20 and {"x", "y", "z", "p", "ax"} <= set(log.axes)
