"""The command ``auv-fly`` in processes of its own, over TCP on the loopback."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress

import pytest

from auv_torchrl.flightlog import read_flightlog
from auv_torchrl.paths import PROJECT
from auv_torchrl.vehicle import load_vehicle
from tests.command_lines import answers_of
from tests.fly.double import STABILIZE, STEP_S, Vehicle

BLOCKED = """
import sys
from importlib.abc import MetaPathFinder

ALLOWED = {"auv_torchrl", "numpy", "onnxruntime", "array_api_compat", "omegaconf", "antlr4", "yaml",
           "filelock", "packaging", "flatbuffers", "google", "_yaml", "coloredlogs"}

class Blocked(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        top = name.partition(".")[0]
        if top not in ALLOWED and top not in sys.stdlib_module_names and not top.startswith("_sysconfigdata"):
            raise ModuleNotFoundError(f"{name} is blocked", name=name)

sys.meta_path.insert(0, Blocked())
from auv_torchrl.fly.command import main
main()
"""


class Served:
    """A vehicle behind a TCP port, in a thread, on the clock of the wall."""

    def __init__(self):
        self.vehicle = Vehicle()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"tcp:127.0.0.1:{self._listener.getsockname()[1]}"
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self):
        self._listener.settimeout(0.2)
        peer = None
        while peer is None and not self._over.is_set():
            with suppress(TimeoutError):
                peer, _ = self._listener.accept()
        if peer is None:
            return
        peer.setblocking(False)
        following = time.monotonic()
        while not self._over.is_set():
            try:
                self.vehicle.hear(peer.recv(65536))
            except BlockingIOError:
                pass
            except OSError:
                break
            with suppress(OSError):  # nobody is there; the vehicle goes on
                peer.send(self.vehicle.step())
            following = max(following + STEP_S, time.monotonic())
            time.sleep(max(0.0, following - time.monotonic()))
        peer.close()

    def wait_for(self, condition, within_s=60.0):
        """Until the vehicle is so."""
        end = time.monotonic() + within_s
        while not condition(self.vehicle):
            assert time.monotonic() < end, "it did not come to that"
            time.sleep(0.02)

    def close(self):
        """End the thread."""
        self._over.set()
        self._thread.join()
        self._listener.close()


@pytest.fixture
def served():
    """The vehicle."""
    made = Served()
    yield made
    made.close()


@pytest.fixture
def begun(served, exported, tmp_path):
    """The command, where no library but those of the lean installation can be imported; it flies."""
    environment = {**os.environ, "PYTHONPATH": str(PROJECT), "OMP_NUM_THREADS": "1"}
    line = [sys.executable, "-c", BLOCKED, f"connection={served.address}", f"policy={exported}", "arm=true",
            f"output={tmp_path / 'out'}"]  # fmt: skip
    process = subprocess.Popen(
        line, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        served.wait_for(lambda vehicle: process.poll() is not None or (vehicle.armed and moves(vehicle)))
        yield process
    finally:
        process.kill()
        process.communicate()


def moves(vehicle):
    """Whether something was asked of it."""
    return any(set(inputs.values()) != {1500} for _, inputs in list(vehicle.commands))


def is_as_found(vehicle):
    """Whether it is disarmed, in its mode, and neutral."""
    neutral = set(vehicle.commands[-1][1].values()) == {1500}
    return not vehicle.armed and vehicle.mode == STABILIZE and neutral


@pytest.mark.parametrize("signum", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.thorough)])
def test_a_signal_ends_the_flight_and_leaves_the_vehicle_as_it_was(begun, served, tmp_path, signum):
    """And says so; what was flown is kept."""
    time.sleep(1.0)  # so that there is a flight to keep
    begun.send_signal(signum)
    said, _ = begun.communicate(timeout=60)
    assert begun.returncode == 0, said
    assert is_as_found(served.vehicle)
    report = json.loads((tmp_path / "out" / "flight.json").read_text())
    assert report["ended"]["why"] == "asked" and "it was asked to end" in said
    (episode,) = read_flightlog(tmp_path / "out" / "flight.csv", load_vehicle("bluerov2_heavy")).episodes
    assert episode.duration > 0.5


@pytest.mark.parametrize("signum", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "hangs"])
def test_where_the_process_dies_or_hangs_the_second_one_sends_neutral(begun, served, signum):
    """And disarms, and gives back the mode; a process that hangs is ended, so that it does not fly on."""
    begun.send_signal(signum)
    at = served.vehicle.time_s
    served.wait_for(is_as_found)
    late = [when - at for when, inputs in served.vehicle.commands if set(inputs.values()) != {1500}]
    assert max(late) < 0.5
    assert begun.wait(timeout=30) == -signal.SIGKILL


LINES = {
    "connection=serial": "give one like tcp:127.0.0.1:5760",
    "connection=udpin:0.0.0.0:14550": "elsewhere=true",
    "connection=tcp:127.0.0.1:1": "cannot be opened",
    "policy=nowhere": "give the folder that auv-export policy=... wrote",
    "task={name: circle}": "was trained on",
    "limits.deepest_m=0.1": "depths grow downwards",
    "interface=joystick": "interface",
    "conection=x": "did you mean connection",
}


@pytest.fixture(scope="module")
def answers(exported):
    """Of all the lines, in one process."""
    usual = {"connection": "tcp:127.0.0.1:1", "policy": str(exported)}
    lines = {}
    for line in LINES:
        rest = [f"{key}={value}" for key, value in usual.items() if not line.startswith(key)]
        lines[line] = [line, *rest]
    return answers_of("auv_torchrl.fly.command", lines)


@pytest.mark.parametrize("line", LINES)
def test_a_mistaken_line_is_answered_by_one_that_says_what_to_give(answers, line):
    """With exit code 2."""
    code, _, errors = answers[line]
    assert code == 2 and LINES[line] in errors and errors.count("\n") == 1, errors
