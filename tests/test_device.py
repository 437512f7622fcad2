"""Training and flights run where ``device=`` says: nothing lies elsewhere, and nothing else changes."""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
import torch

from auv_torchrl.agents.score import Examiner
from auv_torchrl.envs import BACKENDS, make_fleet
from auv_torchrl.evaluation import draw_starts, fly
from auv_torchrl.paths import PROJECT
from auv_torchrl.scenario import read_scenario
from auv_torchrl.simulator import NumpyArrays, TorchArrays
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle
from tests import standin
from tests.agents.tiny_training import train_tiny

NO_GPU = pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no CUDA device")
TASK = StationKeeping(episode_s=0.25, box_m=1.0)
SIZE = {"task": TASK, "total_frames": 40, "stretch_steps": 5, "random_frames": 20, "evaluation_starts": 2}


NOISE = {"position": 0.01}
SWAP = {"pair": [1, 2], "start_s": 0.1}


def trained_and_flown(device: str, backend: str, broken: bool) -> dict[str, list]:
    """What a policy trained on a device does on it, on a vehicle that changes; ``broken``: the training was resumed."""
    with tempfile.TemporaryDirectory() as folder:
        if broken:
            break_off_and_resume(Path(folder), device, backend)
        policy = train_tiny(Path(folder), backend=backend, device=device, **SIZE)
    weights = list(policy.module.parameters())
    assert {weight.device.type for weight in weights} == {torch.device(device).type}
    vehicle = load_vehicle("paper")
    scenario = read_scenario("changing", {"effects": {"sensor_noise": NOISE, "thruster_swap": SWAP}}, vehicle)
    fleet = make_fleet(backend, vehicle, TASK, 3, scenario=scenario, seed=0, device=device)
    flight = fly(fleet, policy.module, draw_starts(TASK, 3, seed=1), 5)
    assert flight.position.device.type == "cpu"
    return {"weights": [weight.tolist() for weight in weights], "positions": flight.position.tolist()}


def break_off_and_resume(folder: Path, device: str, backend: str) -> None:
    """Leave the checkpoint of a training that ended, as by an error, in its second stretch."""
    examine, examined = Examiner.__call__, []

    def fail(self, policy):
        examined.append(policy)
        if len(examined) == 2:
            raise RuntimeError("broken off")
        return examine(self, policy)

    with pytest.MonkeyPatch.context() as patch, pytest.raises(RuntimeError, match="broken off"):
        patch.setattr(Examiner, "__call__", fail)
        train_tiny(folder, backend=backend, device=device, **SIZE)


def left_behind(device: str, backend: str) -> str:
    """What is said where the border between the devices forgets one."""
    with pytest.MonkeyPatch.context() as patch, pytest.raises((RuntimeError, TypeError), match=standin.NAME) as found:
        patch.setattr(NumpyArrays, "native", lambda self, values: values.numpy().astype(float))
        patch.setattr(TorchArrays, "native", lambda self, values: torch.as_tensor(values, dtype=self.dtype))
        trained_and_flown(device, backend, False)
    return str(found.value)


@pytest.fixture(scope="module")
def on_standin() -> dict[str, Any]:
    """What the two functions above give for each backend in a process that has the stand-in."""
    given = [sys.executable, "-m", "tests.test_device"]
    done = subprocess.run(given, cwd=PROJECT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_device_changes_nothing_but_the_place(on_standin, backend, monkeypatch):
    """On a device that takes no tensor of the CPU, training, its resumption and a flight are those of the CPU.

    Compiled physics, which only the CPU has, rounds the last digit otherwise; both sides do without it.
    """
    monkeypatch.setenv("AUV_PHYSICS", "numpy")
    assert on_standin["trained_and_flown"][backend] == trained_and_flown("cpu", backend, False)


@NO_GPU
@pytest.mark.gpu
@pytest.mark.parametrize("backend", BACKENDS)
def test_training_and_flight_run_on_a_gpu(backend):
    """A GPU trains and flies; a training that was broken off there ends as one that was not."""
    assert trained_and_flown("cuda", backend, True) == trained_and_flown("cuda", backend, False)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_tensor_that_is_left_behind_is_found(on_standin, backend):
    """The stand-in refuses what a GPU would, so that the tests above can fail."""
    assert re.match("can't convert|.*expected all tensors on", on_standin["left_behind"][backend])


if __name__ == "__main__":
    library = standin.register()
    on = f"{standin.NAME}:0"
    found = {
        "trained_and_flown": {backend: trained_and_flown(on, backend, True) for backend in BACKENDS},
        "left_behind": {backend: left_behind(on, backend) for backend in BACKENDS},
    }
    sys.stdout.write("\n" + json.dumps(found) + "\n")
