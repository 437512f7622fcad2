"""The gymnasium entry: its own checker, the same physics, options that are checked."""

import warnings
from typing import cast

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env

from auv_torchrl.envs import BACKENDS, ID, RegulationEnv, make_fleet
from auv_torchrl.paths import config_names, config_path
from auv_torchrl.tasks import Lemniscate, StationKeeping, fitted, read_task
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.yaml_file import read_yaml
from tests.few_thrusters import without_sway

backends = pytest.mark.parametrize("backend", BACKENDS)


@backends
def test_gymnasium_accepts_the_environment(backend):
    """Gymnasium's check_env passes without a warning, for a vehicle, a scenario and a task of one's own."""
    env = gymnasium.make(
        ID, vehicle="bluerov2", backend=backend, scenario="swap", task={"episode_s": 2.0}, render_mode="rgb_array"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


@backends
def test_it_is_the_fleet(backend):
    """The same seed and actions give the fleet's observations and rewards."""
    env = gymnasium.make(ID, backend=backend).unwrapped
    fleet = make_fleet(backend, load_vehicle("paper"), StationKeeping(), 1)
    observation, _ = env.reset(seed=4)
    fleet.set_seed(4)
    now = fleet.reset()
    np.testing.assert_array_equal(observation, now["observation"][0].numpy())
    for action in np.linspace(-1, 1, 20, dtype=np.float32).reshape(5, 4):
        observation, reward, terminated, truncated, info = env.step(action)
        now = fleet.step(now.set("action", torch.from_numpy(action)[None]))["next"]
        np.testing.assert_array_equal(observation, now["observation"][0].numpy())
        np.testing.assert_array_equal(info["position"], now["position"][0].numpy())
        assert reward == float(now["reward"]) and not terminated and not truncated


def test_many_vehicles_in_one_environment():
    """The vector entry runs one fleet; an ended episode begins anew in that step and leaves its last observation."""
    env = gymnasium.make_vec(
        ID, num_envs=3, vectorization_mode="vector_entry_point", backend="torch", task={"episode_s": 0.2}
    )
    env.reset(seed=0)
    for step in range(1, 9):
        observation, reward, terminated, truncated, info = env.step(np.ones((3, 4), dtype=np.float32))
        assert observation.shape == env.observation_space.shape and reward.shape == (3,)
        assert truncated.tolist() == [step % 4 == 0] * 3 and not terminated.any()
        assert ("final_obs" in info) == (step % 4 == 0)
        if "final_obs" in info:
            assert not np.array_equal(info["final_obs"], observation)


@pytest.mark.parametrize("name", config_names("task"))
def test_a_task_is_chosen_by_name(name):
    """As vehicle= and scenario=, from conf/task; settings alone are those of station keeping."""
    env = cast(RegulationEnv, gymnasium.make(ID, backend="torch", task=name).unwrapped)
    assert env.fleet.task.name == name
    content = read_yaml(config_path("task", name), "task")
    given = read_task({key: value for key, value in content.items() if key != "defaults"})
    assert env.fleet.task == fitted(given, load_vehicle("paper"))
    env.reset(seed=0)
    env.step(env.action_space.sample())


def test_a_task_is_chosen_by_settings_or_as_an_object():
    """The settings of another task name it."""
    slow = {"name": "lemniscate", "speed": 0.1}
    for task in (slow, Lemniscate(speed=0.1)):
        flown = RegulationEnv(backend="torch", task=task).fleet.task
        assert flown == Lemniscate(speed=0.1)


def test_an_action_that_is_no_number_ends_the_episode():
    """One vehicle and several: what is observed and rewarded stays finite."""
    env = gymnasium.make(ID, backend="torch").unwrapped
    env.reset(seed=0)
    observation, reward, terminated, truncated, _ = env.step(np.array([0, np.nan, 0, 0], dtype=np.float32))
    assert terminated and not truncated and np.isfinite(observation).all() and np.isfinite(float(reward))
    several = gymnasium.make_vec(ID, num_envs=3, vectorization_mode="vector_entry_point", backend="torch")
    several.reset(seed=0)
    actions = np.zeros((3, 4), dtype=np.float32)
    actions[1, 2] = np.inf
    observation, reward, terminated, _, info = several.step(actions)
    assert terminated.tolist() == [False, True, False] and info["_final_obs"].tolist() == [False, True, False]
    assert np.isfinite(observation).all() and np.isfinite(reward).all() and np.isfinite(info["final_obs"]).all()


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros(3), r"has shape \(3,\): give 4 numbers in \[-1, 1\]"),
        (np.zeros((1, 4)), r"has shape \(1, 4\): give 4"),
        (0.0, r"has shape \(\): give 4"),
        ("ahead", "is 'ahead': give 4"),
        ([None] * 3 + ["x"], "is .*: give 4"),
    ],
)
def test_an_action_of_another_shape_is_named(action, message):
    """The error says what came and what to give."""
    env = gymnasium.make(ID, backend="torch").unwrapped
    env.reset()
    with pytest.raises(ValueError, match=message):
        env.step(action)
    with pytest.raises(ValueError, match="give 3x4 numbers"):
        several = gymnasium.make_vec(ID, num_envs=3, vectorization_mode="vector_entry_point", backend="torch")
        several.reset()
        several.step(np.zeros(4))


def test_a_step_before_a_reset_is_refused():
    """Unwrapped, too, where gymnasium itself does not look."""
    with pytest.raises(RuntimeError, match="step before the first reset"):
        RegulationEnv(backend="torch").step(np.zeros(4))


def test_starts_can_be_given():
    """options={"start": ...} puts the vehicle there."""
    env = gymnasium.make(ID, backend="torch").unwrapped
    start = {"position": [1, 2, 3], "quaternion": [1, 0, 0, 0], "velocity": [0] * 6}
    _, info = env.reset(options={"start": start})
    np.testing.assert_array_equal(info["position"], [1, 2, 3])


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"vehicle": "submarine"}, FileNotFoundError, "there are .*bluerov2_heavy"),
        ({"scenario": "storm"}, FileNotFoundError, "there are accelerometer_bias, added_mass"),
        ({"backend": "gazebo"}, ValueError, "there are mujoco, torch"),
        ({"task": "figure"}, FileNotFoundError, "there are circle, cruise, docking, helix, lawnmower, lemniscate"),
        ({"task": {"name": "figure"}}, ValueError, "there are station_keeping, waypoints"),
        ({"vehicle": without_sway()}, ValueError, "task station_keeping also needs sway"),
        ({"task": {"box": 1.0}}, ValueError, "box.*box_m"),
        ({"render_mode": "human"}, ValueError, "rgb_array"),
    ],
)
def test_wrong_options_are_refused(options, error, message):
    """Unknown names are errors that list what there is."""
    with pytest.raises(error, match=message):
        RegulationEnv(**options)


def test_unknown_reset_options_are_refused():
    """Reset takes start and nothing else."""
    env = gymnasium.make(ID, backend="torch").unwrapped
    with pytest.raises(ValueError, match="there is start"):
        env.reset(options={"position": [0, 0, 0]})
