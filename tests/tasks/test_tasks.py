"""What holds for every task, and how one is chosen."""

from dataclasses import dataclass, fields

import numpy as np
import pytest
import torch
import yaml
from array_api_compat import array_namespace
from hypothesis import given, settings
from hypothesis import strategies as st
from torchrl.envs.utils import check_env_specs

from auv_torchrl.envs import TorchFleet
from auv_torchrl.paths import config_path
from auv_torchrl.physics.kinematics import heading_of, quaternion_from_euler, rotation_matrix
from auv_torchrl.tasks import TASKS, StationKeeping, read_task
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")
DEFAULTS = [kind() for kind in TASKS.values()]
number = st.floats(-2.0, 2.0)


@dataclass(frozen=True)
class Shallow(StationKeeping):
    """A task of one's own: episodes end where the vehicle dives deeper than 1 m."""

    def terminated(self, position, quaternion, velocity, time):
        """Deeper than 1 m."""
        return position[..., 2] > 1.0


@pytest.mark.parametrize("name", TASKS)
def test_the_file_of_a_task_says_what_its_defaults_are(name):
    """Every field is in conf/task with its default, so that reading the file gives the task itself."""
    content = yaml.safe_load(config_path("task", name).read_text())
    content.pop("defaults")
    assert set(content) - {"name"} == {entry.name for entry in fields(TASKS[name])}
    assert read_task(content) == TASKS[name]()


@pytest.mark.parametrize("task", DEFAULTS, ids=lambda task: task.name)
@settings(max_examples=25)
@given(st.tuples(number, number, number), number, st.tuples(number, number, number))
def test_nothing_is_rewarded_more_than_being_where_the_reference_is(task, position, yaw, speed):
    """Moving with the reference without a command the reward is 0, elsewhere it is less."""
    silent, time = np.zeros((1, 4)), np.array([7.0])
    reference = task.reference(time)
    to_body = rotation_matrix(reference.quaternion).mT
    moving = reference.moving(to_body) + np.zeros((1, 6))
    best = task.reward(reference.position, reference.quaternion, moving, silent, time)
    attitude = quaternion_from_euler(*np.array([[0.0], [0.0], [yaw]]))
    velocity = np.array([[*speed, 0.0, 0.0, 0.0]])
    other = task.reward(np.array([position]), attitude, velocity, silent, time)
    assert best == pytest.approx(0.0, abs=1e-12) and other <= best + 1e-12


@pytest.mark.parametrize("task", DEFAULTS, ids=lambda task: task.name)
def test_an_observation_has_the_names_that_it_says_on_both_array_libraries(task):
    """Numpy and torch give the same numbers, one for each name."""
    rng = np.random.default_rng(0)
    state = rng.normal(size=(5, 3)), rng.normal(size=(5, 4)), rng.normal(size=(5, 6)), np.arange(5.0)
    seen = task.observe(*state)
    assert seen.shape == (5, len(task.observation_names))
    np.testing.assert_allclose(task.observe(*map(torch.from_numpy, state)).numpy(), seen, atol=1e-12)
    assert array_namespace(seen).all(task.terminated(*state) == False)  # noqa: E712


@pytest.mark.parametrize("task", DEFAULTS, ids=lambda task: task.name)
def test_a_heading_that_a_reference_knows_is_that_of_its_quaternion(task):
    """To the bit, at all times."""
    reference = task.reference(np.linspace(0.0, 40.0, 9))
    np.testing.assert_array_equal(reference.yaw, heading_of(reference.quaternion))


def test_a_task_may_end_episodes():
    """An episode ends in the step in which the task says so, and the specs of the environment hold."""
    task = Shallow(box_m=0.5, near_share=0.0, start_speed=0.0)
    fleet = TorchFleet(PAPER, task, 2, seed=0)
    check_env_specs(fleet)
    now = fleet.reset()
    down = torch.tensor([[0.0, 0, 1, 0], [0.0, 0, 0, 0]])
    for _ in range(task.steps):
        now = fleet.step(now.set("action", down))["next"]
        deep = now["position"][:, 2:] > 1.0
        assert torch.equal(now["terminated"], deep) and not now["terminated"][1]
        if deep.any():
            return
    raise AssertionError("a vehicle that dives for 20 s should come deeper than 1 m")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"name": "station_keping"}, "no task named 'station_keping': there are station_keeping, .*did you mean"),
        ({"box": 1.0}, "task station_keeping has no box: .*did you mean box_m"),
        ({"episode_s": -1.0}, "episode_s"),
    ],
)
def test_a_task_that_is_not_there_is_named_with_those_that_are(given, message):
    """Names, settings and values are checked before anything is flown."""
    with pytest.raises(ValueError, match=message):
        read_task(given)
