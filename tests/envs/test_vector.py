"""The fleet behind gymnasium's vector interface: spaces, resets, infos, seeds, wrappers, the end."""

import warnings
from typing import Any, cast

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.error import ClosedEnvironmentError
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from gymnasium.wrappers.vector import DictInfoToList, RecordEpisodeStatistics
from tensordict import TensorDict

from auv_torchrl.envs import BACKENDS, ID, RegulationVectorEnv
from auv_torchrl.envs.gymnasium_env import fleet_by_names
from auv_torchrl.simulator.scene import SIZE

SHORT = {"episode_s": 0.2}  # four control steps
backends = pytest.mark.parametrize("backend", BACKENDS)


def vehicles(count: int = 3, **settings: Any) -> RegulationVectorEnv:
    settings = {"backend": "torch", "task": SHORT, **settings}
    return cast(RegulationVectorEnv, gymnasium.make_vec(ID, num_envs=count, **settings))


def actions(env, steps: int):
    rng = np.random.default_rng(0)
    return rng.uniform(-1, 1, (steps, *env.action_space.shape)).astype(np.float32)


@backends
def test_make_vec_takes_the_native_fleet(backend):
    """Without a mode of vectorization, and without a warning: spaces are batched and the mode of resets is there."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = vehicles(5, backend=backend, vehicle="bluerov2", scenario="swap")
    assert isinstance(env.unwrapped, RegulationVectorEnv) and env.fleet.num_envs == 5
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert env.action_space == batch_space(env.single_action_space, 5)
    assert env.observation_space == batch_space(env.single_observation_space, 5)
    observation, _ = env.reset(seed=1)
    for action in actions(env, 6):
        observation, reward, terminated, truncated, _ = env.step(action)
        assert env.observation_space.contains(observation)
        assert reward.shape == terminated.shape == truncated.shape == (5,)
        assert reward.dtype == np.float32 and terminated.dtype == truncated.dtype == np.bool_


@backends
def test_it_flies_as_the_fleet_does(backend):
    """The same seed and actions give the fleet's observations, rewards and infos, over the ends of episodes."""
    env, fleet = vehicles(backend=backend), fleet_by_names(3, backend=backend, task=SHORT)
    observation, info = env.reset(seed=4)
    fleet.set_seed(4)
    now = fleet.reset()
    np.testing.assert_array_equal(observation, now["observation"])
    for action in actions(env, 9):
        observation, reward, _, truncated, info = env.step(action)
        given = TensorDict({"action": torch.from_numpy(action)}, [3])
        done, now = fleet.step_and_maybe_reset(given)
        np.testing.assert_array_equal(observation, now["observation"])
        np.testing.assert_array_equal(reward, done["next", "reward"][:, 0])
        np.testing.assert_array_equal(info["position"], now["position"])
        if truncated.any():
            np.testing.assert_array_equal(info["final_obs"], done["next", "observation"])
            np.testing.assert_array_equal(info["final_info"]["command"], done["next", "command"])


def test_a_seed_repeats_a_flight_with_the_resets_in_it():
    """Starts of later episodes and sensor noise included; another seed gives another flight."""
    env = vehicles(scenario="sensor_noise")

    def fly(seed):
        return np.stack([env.reset(seed=seed)[0], *(env.step(action)[0] for action in actions(env, 10))])

    first, other = fly(7), fly(8)
    np.testing.assert_array_equal(fly(7), first)
    assert not np.array_equal(other, first)
    assert env.np_random_seed == 7


def test_what_was_returned_stays_as_it_was():
    """No array of a step is used again by the next."""
    env = vehicles()
    returned = [env.reset(seed=0)[0]]
    kept = [returned[0].copy()]
    for action in actions(env, 5):
        observation, reward, *_, info = env.step(action)
        for array in (observation, reward, info["position"]):
            returned.append(array)
            kept.append(array.copy())
    for array, copy in zip(returned, kept, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_only_marked_vehicles_are_reset():
    """``reset_mask`` leaves the others in mid-episode, and a start counts for the marked alone."""
    env = vehicles(task={"episode_s": 10.0})
    with pytest.raises(RuntimeError, match="before the first reset"):
        env.reset(options={"reset_mask": np.ones(3, dtype=np.bool_)})
    env.reset(seed=0)
    before = env.step(np.ones((3, 4)))[-1]["position"]
    start = {"position": np.full((3, 3), 0.5), "quaternion": [[1, 0, 0, 0]] * 3, "velocity": np.zeros((3, 6))}
    _, info = env.reset(options={"reset_mask": np.array([False, True, False]), "start": start})
    np.testing.assert_array_equal(info["position"][[0, 2]], before[[0, 2]])
    np.testing.assert_array_equal(info["position"][1], [0.5] * 3)
    for mask in ([True] * 3, np.ones(2, dtype=np.bool_), np.ones(3)):
        with pytest.raises(ValueError, match="give a numpy array of 3 bool"):
            env.reset(options={"reset_mask": mask})
    with pytest.raises(ValueError, match="there is start"):
        env.reset(options={"place": 1})
    placed = env.reset(options={"reset_mask": np.array([True, False, False])})[1]["position"]
    assert (placed[0] != info["position"][0]).all() and (placed[1:] == info["position"][1:]).all()
    flown = env.step(np.zeros((3, 4)))[-1]["position"]
    assert np.abs(flown - placed).max() < 0.1  # m: nothing leaps, the vehicles are where the reset said


def test_gymnasiums_wrappers_understand_it():
    """Statistics count whole episodes, and infos become lists in which the last one is that of the ended episode."""
    env = DictInfoToList(RecordEpisodeStatistics(vehicles()))  # pyright: ignore[reportArgumentType]
    env.reset(seed=0)
    total = np.zeros(3)
    for step, action in enumerate(actions(env, 8), 1):
        _, reward, _, _, infos = env.step(action)
        total += reward
        for row, info in enumerate(infos):
            assert info["position"].shape == (3,) and ("final_obs" in info) == (step % 4 == 0)
            if step % 4 == 0:
                assert info["episode"]["l"] == 4 and info["episode"]["r"] == pytest.approx(total[row], rel=1e-5)
                assert not np.array_equal(info["final_info"]["position"], info["position"])
        total *= step % 4 != 0


def test_every_vehicle_is_photographed():
    """One picture each with a render mode, none without."""
    env = vehicles(2, render_mode="rgb_array")
    env.reset(seed=0)
    frames = cast(tuple, env.render())
    assert len(frames) == 2 and all(frame.shape == (*SIZE, 3) for frame in frames)
    assert vehicles().render() is None
    with pytest.raises(ValueError, match="give 'rgb_array' or None"):
        vehicles(render_mode="human")


def test_a_closed_fleet_refuses_to_fly():
    """Closing twice is harmless."""
    env = vehicles()
    env.reset(seed=0)
    env.close()
    env.close()
    for call in (env.reset, lambda: env.step(np.zeros((3, 4)))):
        with pytest.raises(ClosedEnvironmentError, match="make another one"):
            call()
