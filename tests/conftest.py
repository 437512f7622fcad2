"""What tests of several packages share."""

import gc
import logging
import multiprocessing
from collections import Counter
from collections.abc import Callable, Iterator

import pytest
import torch
from tensordict import TensorDictBase

from auv_torchrl.envs import TorchFleet
from auv_torchrl.evaluation import draw_starts, fly
from auv_torchrl.flight import Flight
from auv_torchrl.scenario import Scenario
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import Vehicle
from tests import everybody  # noqa: F401  # loads the profile of property tests

torch.set_num_threads(1)  # on few cores, threads of small operations wait for each other

GAIN = torch.tensor((1.5, 1.5, 1.5, 1.0))  # per m and per rad
DAMPING = torch.tensor((0.5, 0.5, 0.5, 0.3))  # per m/s and per rad/s


def pytest_addoption(parser: pytest.Parser) -> None:
    """How long random tests go on; without these options they are short."""
    parser.addoption("--damages", type=int, help="examples of tests/diagnosis/test_fuzz_diagnosis.py; few without it")
    parser.addoption("--hostile", type=int, default=30, help="vehicles of tests/adaptation/test_hostile.py, 30")
    parser.addoption("--draws", type=int, default=30, help="logs of each format of tests/flightlog/fuzz, 30")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests come first, so that none is begun when the other processes have run out of work.

    A file stays in one process (``--dist loadfile``), which makes what its tests share once.
    """
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: -slow[item.path])


def pytest_collection_finish() -> None:
    """What is imported and collected stays to the end: the collector of garbage need not look through it again.

    There are a million objects then, and looking took a tenth of the time of many tests.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def handlers_of_one_test() -> Iterator[None]:
    """A command that a test calls logs to that test's console, which is closed for the tests after it."""
    root = logging.getLogger()
    before = set(root.handlers)
    yield
    for handler in set(root.handlers) - before:
        root.removeHandler(handler)


@pytest.fixture
def forked() -> Iterator[None]:
    """Processes that a test starts have imported everything: a fork takes 0.1 s, a fresh Python with torch 5 s."""
    before = multiprocessing.get_start_method(allow_none=True)
    multiprocessing.set_start_method("fork", force=True)
    yield
    multiprocessing.set_start_method(before, force=True)


def pd_controller(tensordict: TensorDictBase) -> TensorDictBase:
    """Action from the first nine entries of the observation of a regulation task."""
    observation = tensordict["observation"]
    velocity, error = observation[..., :4], observation[..., 4:7]
    heading = torch.atan2(observation[..., 7], observation[..., 8])
    action = GAIN * torch.cat((error, heading[..., None]), -1) - DAMPING * velocity
    return tensordict.set("action", action.clamp(-1, 1))


@pytest.fixture(scope="session")
def pd_policy() -> Callable[[TensorDictBase], TensorDictBase]:
    """A controller without learning, for tests that need plausible flights quickly."""
    return pd_controller


@pytest.fixture(scope="session")
def pd_flight() -> Callable[..., Flight]:
    """Flies vehicles with that controller from within 1 m."""

    def flight(vehicle: Vehicle, scenario: Scenario | None = None, count: int = 6, seconds: float = 20.0) -> Flight:
        task = StationKeeping().for_evaluation(box_m=1.0)
        fleet = TorchFleet(vehicle, task, count, scenario=scenario, seed=0, dtype=torch.float64)
        return fly(fleet, pd_controller, draw_starts(task, count, seed=1), round(seconds / task.control_dt))

    return flight
