"""Training and flights run where ``device=`` says: nothing lies elsewhere, and nothing else changes."""

import json
import math
import re
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest
import torch
from tensordict.nn import TensorDictModule
from torchrl.envs import TransformedEnv

from auv_torchrl import evaluation
from auv_torchrl.adaptation import InFlightAdapter, load_adaptation_config
from auv_torchrl.adaptation.flight import fly_adapting
from auv_torchrl.agents.config import load_agent_config
from auv_torchrl.agents.fine_tune import FineTuning
from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.agents.score import Examiner
from auv_torchrl.compensation import close as close_module
from auv_torchrl.compensation.diagnosed import Diagnosed
from auv_torchrl.ddr.transform import observing
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
SIZE = {
    "task": TASK, "total_frames": 16, "stretch_steps": 2, "steps_per_batch": 2, "random_frames": 8,
    "evaluation_starts": 2,
}  # fmt: skip

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


def small_policy() -> TensorDictModule:
    """A policy that does something."""
    layer = torch.nn.Linear(16, 4)
    for number, weight in enumerate(layer.parameters()):
        torch.nn.init.uniform_(weight, -1.0, 1.0, generator=torch.Generator().manual_seed(number))
    return TensorDictModule(torch.nn.Sequential(layer, torch.nn.Tanh()), ["observation"], ["action"])


def adapted_and_closed(device: str, backend: str) -> dict[str, list]:
    """What maps to the thrusters do on a device: one that learns while a fault sets in, and one of a diagnosis."""
    vehicle, task, starts = load_vehicle("paper"), replace(TASK, thruster_commands=True), draw_starts(TASK, 3, seed=1)
    fault = read_scenario("fault", {"effects": {"thruster_gain": {"gain_1": -1.0, "start_s": 0.1}}}, vehicle)
    fleet = make_fleet(backend, vehicle, task, 3, scenario=fault, seed=0, device=device)
    fleet.simulator.delay_scenario(torch.tensor([0.0, 0.05, 0.1]))
    adapter = InFlightAdapter(vehicle, task, load_adaptation_config(), 3)
    policy = small_policy()
    flown = fly_adapting(TransformedEnv(fleet, observing(adapter, task)), policy, starts, 5)
    assert flown.flight.position.device.type == flown.effectiveness.device.type == "cpu"
    gone, rehearsed = [], []
    swap = read_scenario("told", {"effects": {"thruster_swap": {"pair": [1, 2]}}}, vehicle)
    pilot = SourcePolicy(cast(Any, policy), {"hash": "small"})

    def rehearse(fleet, policy, starts, steps):
        gone.append(fleet.device.type)
        rehearsed.append(fly(fleet, policy, starts, steps))
        return rehearsed[-1]

    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(close_module, "fly", rehearse)
        patch.setattr(evaluation, "STEADY_FROM_S", 0.1)  # flights take 0.25 s, ...
        for floor in ("FLOOR_M", "FLOOR_RAD"):  # ... and their errors are none to train for
            patch.setattr(evaluation, floor, math.inf)
        given = (pilot, TASK, 1.0, load_agent_config(), FineTuning(160, 0), 0, backend, Path(folder), device)
        close_module.close(Diagnosed(vehicle, swap, {}), *given)
    assert gone == [torch.device(device).type] * 3
    return {
        "adapted": flown.flight.position.tolist(),
        "map": flown.effectiveness.tolist(),
        "rehearsed": [flight.position.tolist() for flight in rehearsed],
    }


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
        patch.setattr(
            NumpyArrays,
            "native",
            lambda self, values: values.numpy().astype(float) if isinstance(values, torch.Tensor) else values,
        )
        patch.setattr(TorchArrays, "native", lambda self, values: torch.as_tensor(values, dtype=self.dtype))
        trained_and_flown(device, backend, False)
    return str(found.value)


@pytest.fixture(scope="module")
def on_standin() -> dict[str, Any]:
    """What the functions above give for each backend in a process that has the stand-in."""
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


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_maps_to_the_thrusters_do_is_the_same_on_a_device(on_standin, backend, monkeypatch):
    """The adaptation, as a fault sets in, and rehearsals of a diagnosed vehicle fly where they are told."""
    monkeypatch.setenv("AUV_PHYSICS", "numpy")
    assert on_standin["adapted_and_closed"][backend] == adapted_and_closed("cpu", backend)


@NO_GPU
@pytest.mark.gpu
@pytest.mark.parametrize("backend", BACKENDS)
def test_maps_to_the_thrusters_fly_on_a_gpu(backend):
    """They do so with the numbers of the CPU, up to rounding."""
    there, here = adapted_and_closed("cuda", backend), adapted_and_closed("cpu", backend)
    for key, flown in there.items():
        torch.testing.assert_close(torch.tensor(flown), torch.tensor(here[key]), rtol=1e-3, atol=1e-4)


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
        "adapted_and_closed": {backend: adapted_and_closed(on, backend) for backend in BACKENDS},
        "left_behind": {backend: left_behind(on, backend) for backend in BACKENDS},
    }
    sys.stdout.write("\n" + json.dumps(found) + "\n")
