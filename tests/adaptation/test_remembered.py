"""What is remembered between control steps travels with ``state_dict``."""

import numpy as np
import pytest
import torch
from adapted_flights import VEHICLE, adapted_fleet, scenario, task

from auv_torchrl.adaptation import InFlightAdapter
from auv_torchrl.adaptation.memory import Memory


class Counter(Memory):
    """Remembers one array of each type."""

    sums: np.ndarray
    times: np.ndarray
    seen: np.ndarray

    def __init__(self, count):
        super().__init__()
        self.remember(sums=np.zeros(count), times=np.zeros(count, dtype=np.int64), seen=np.zeros(count, dtype=bool))


def test_remembered_arrays_are_numpy_and_stay_as_they_are_when_a_module_is_moved():
    """They are changed in place or replaced, and keep their type in a module of halves."""
    counter = torch.nn.Sequential(Counter(3)).half()[0]
    assert isinstance(counter, Counter)
    counter.sums[1] = 0.1
    counter.times = counter.times + 2
    counter.seen[:] = True
    assert counter.sums.dtype == np.float64 and counter.sums.tolist() == [0.0, 0.1, 0.0]
    state = counter.state_dict()
    assert state["times"].tolist() == [2, 2, 2] and state["seen"].all()
    other = Counter(3)
    other.load_state_dict(state)
    counter.sums[1] = 7.0
    assert other.sums[1] == 0.1


def test_a_state_of_another_number_of_vehicles_is_refused():
    """The error names the array and both sizes."""
    with pytest.raises(RuntimeError, match=r"sums.*\[3\].*\[2\]"):
        Counter(2).load_state_dict(Counter(3).state_dict())


def test_a_flight_learns_on_from_state_dict_as_if_never_interrupted():
    """Saved in the middle of a search, every array is bit for bit the same 20 steps later."""
    env, whole = adapted_fleet(2, 20.0, scenario("command_delay"))
    rng = np.random.default_rng(0)
    learners = [whole.learner]
    env.reset()
    whole.learner.search(np.arange(2))

    def step(number):
        measured = np.eye(13)[3] + 0.01 * np.sin(number + np.arange(26)).reshape(2, 13)
        nominal = rng.uniform(-1.0, 1.0, (2, 6))
        for learner in learners:
            learner.observe(learner.thrusts(nominal), measured, np.full(2, 0.05 * (number + 1)))

    for number in range(20):
        step(number)
    learners.append(InFlightAdapter(VEHICLE, task(20.0), whole.config, 2).learner)
    learners[1].load_state_dict(whole.learner.state_dict())
    for number in range(20, 40):
        step(number)
    for one, other in zip(*(learner.state_dict().values() for learner in learners), strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=0, equal_nan=True)
