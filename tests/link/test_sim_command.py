"""The command ``auv-sim``, from its command line to what it leaves behind."""

import json
import os
import re
import signal
import subprocess
import sys
import threading

import pytest

from auv_torchrl.flightlog import read_flightlog
from auv_torchrl.link.job import Tally, fly, read_outputs, summary
from auv_torchrl.link.lockstep import Lockstep
from auv_torchrl.link.server import open_socket
from auv_torchrl.paths import PROJECT
from tests.command_lines import answers_of
from tests.link.firmware import Firmware

FRAMES = 240
RISING = (1500,) * 4 + (1400,) * 4 + (1500,) * 8


@pytest.fixture
def begun(tmp_path):
    """Starts the command; the process, and the address at which it waits."""
    running = []

    def begin(*arguments):
        environment = {**os.environ, "PYTHONPATH": str(PROJECT), "OMP_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"}
        line = [sys.executable, "-m", "auv_torchrl.link.command", "bind=127.0.0.1:0", *arguments]
        heard = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        process = subprocess.Popen(line, cwd=tmp_path, env=environment, **heard)
        running.append(process)
        assert process.stdout is not None
        for text in process.stdout:
            if found := re.search(r"waiting for ArduSub at 127\.0\.0\.1:(\d+)", text):
                return process, ("127.0.0.1", int(found[1]))
        raise AssertionError(f"it ended with {process.wait()}")

    yield begin
    for process in running:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("signum", [pytest.param(signal.SIGINT, marks=pytest.mark.thorough), signal.SIGTERM])
def test_a_flight_is_saved_when_it_is_ended(begun, tmp_path, vehicle, signum):
    """By Ctrl-C or SIGTERM; with exit code 0, for there is no other end; and the folder is not used again."""
    process, address = begun("+scenario=payload", "output=out")
    firmware = Firmware(address)
    for _ in range(FRAMES):
        firmware.exchange(RISING)
    firmware.close()
    process.send_signal(signum)
    said, _ = process.communicate(timeout=60)
    assert process.returncode == 0, said
    assert f"in {FRAMES} frames" in said
    assert json.loads((tmp_path / "out" / "run.json").read_text())["finished"]
    assert (tmp_path / "out" / "run.rrd").stat().st_size > 0
    (episode,) = read_flightlog(tmp_path / "out" / "flight.csv", vehicle).episodes
    assert episode.duration == pytest.approx(FRAMES / 400, abs=0.06)
    assert (episode.commands == [0.0] * 4 + [-0.25] * 4).all()


def test_it_ends_after_the_time_that_is_set(plant):
    """Of simulated time, that of a firmware before it was started anew included."""
    tally = Tally()
    lockstep = Lockstep(plant(), range(1, 9), observers=[tally])
    with open_socket(("127.0.0.1", 0)) as listener:
        firmware = Firmware(listener.getsockname(), timeout_s=30.0)

        def exchange():
            for frame in (*range(20), *range(20)):
                firmware.frame = frame
                firmware.exchange()

        thread = threading.Thread(target=exchange)
        thread.start()
        fly(listener, lockstep, tally, 0.0999)
        thread.join()
        firmware.close()
    assert summary(lockstep, tally) == "flew 0.1 s in 40 frames, 1 restart of the firmware"


LINES = {
    "bind=0.0.0.0:9002": "elsewhere=true",
    "bind=here": "give one like bind=127.0.0.1:9002",
    "outputs=[1,2]": "give a list of length 8, from 1 to 32",
    "outputs=[1,2,3,4,5,6,7,7]": "give a list of length 8",
    "vehicle=submarine": "no vehicle named 'submarine'",
    "+scenario=sunshine": "no scenario named 'sunshine'",
    "start.down=1e9": "start.down is",
    "until_s=0": "until_s is 0",
    "rerun=7": "give true, false, or the address of a viewer",
    "pased=true": "did you mean paced",
    "output=used": "holds a flight already",
}


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """Of all the lines, in one process."""
    folder = tmp_path_factory.mktemp("used")
    (folder / "flight.csv").touch()
    lines = {line: [line if line != "output=used" else f"output={folder}"] for line in LINES}
    lines = {line: [*given, *(["bind=127.0.0.1:0"] if "bind" not in line else [])] for line, given in lines.items()}
    return answers_of("auv_torchrl.link.command", lines)


@pytest.mark.parametrize("line", LINES)
def test_a_mistaken_line_is_answered_by_one_that_says_what_to_give(answers, line):
    """With exit code 2, and before anything is written."""
    code, _, errors = answers[line]
    assert code == 2 and LINES[line] in errors and errors.count("\n") == 1, errors


def test_outputs_are_those_of_the_motors_unless_they_are_named():
    """Motor n on output n."""
    assert read_outputs(None, 6) == (1, 2, 3, 4, 5, 6)
    assert read_outputs([9, 10, 11, 12], 4) == (9, 10, 11, 12)
