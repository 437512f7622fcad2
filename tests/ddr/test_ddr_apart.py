"""The adapter around fleets that step apart: side by side, in other processes, in the process of a collector."""

from functools import partial

import pytest
import torch
from tensordict import TensorDict
from torchrl.collectors import Collector
from torchrl.envs import ParallelEnv, SerialEnv, TransformedEnv

from auv_torchrl.ddr import AdapterConfig, DDRAdapter
from auv_torchrl.evaluation import draw_starts

APART = {"SerialEnv": SerialEnv, "ParallelEnv": partial(ParallelEnv, mp_start_method="fork")}
ELSEWHERE = {"backend": "process", "num_collectors": 1, "sync": True}  # a collector in a process of its own
apart = pytest.mark.parametrize("batched", APART.values(), ids=APART)
PUSHED = "learner.bag.pushed"
CONFIG = AdapterConfig(seed=3)


def learning(models) -> DDRAdapter:
    adapter = DDRAdapter(models, CONFIG)
    adapter.learning = True
    return adapter


def flown(env, policy, task, steps=60):
    starts = TensorDict({"start": draw_starts(task, 4, seed=1).reshape(env.batch_size)}, env.batch_size)
    first = env.reset(starts, set_state=True)
    return env.rollout(steps, policy, auto_reset=False, tensordict=first, break_when_any_done=False)


@apart
def test_a_map_around_two_fleets_learns_as_around_one(batched, models, fleet, policy, scenario, task):
    """Four vehicles in two fleets get the commands that they get in one, and leave the same map, bag and dither."""
    reversed_ = scenario("reversed")
    one, two = learning(models), learning(models)
    together = flown(TransformedEnv(fleet(4, reversed_), one), policy, task)
    env = TransformedEnv(batched(2, partial(fleet, 2, reversed_)), two)
    side_by_side = flown(env, policy, task)
    env.close()
    assert side_by_side.shape == (2, 2, 60) and int(one.learner.bag.pushed) > 100
    for key in ("action", ("next", "applied_action"), ("next", "position")):
        torch.testing.assert_close(side_by_side[key].flatten(0, 1), together[key], rtol=0, atol=0)
    for name, value in one.state_dict().items():
        torch.testing.assert_close(two.state_dict()[name], value, rtol=0, atol=0, msg=name, equal_nan=True)


@apart
def test_only_the_vehicle_whose_episode_ended_begins_anew(batched, models, fleet):
    """The third of four vehicles in two fleets is row 2 of the map."""
    adapter, begun = DDRAdapter(models), []
    adapter.begin = lambda rows, tensordict: begun.append(rows.tolist())
    env = TransformedEnv(batched(2, partial(fleet, 2)), adapter)
    now = env.reset()
    ended = torch.zeros(2, 2, 1, dtype=torch.bool)
    ended[1, 0] = True
    env.reset(now.set("_reset", ended), set_state=False)
    env.close()
    assert begun == [[0, 1, 2, 3], [2]]


def learning_env(fleet, scenario, models) -> TransformedEnv:
    return TransformedEnv(fleet(2, scenario("reversed")), learning(models))


def test_a_map_that_learns_in_the_process_of_a_collector_comes_back(models, fleet, policy, scenario, forked):
    """``state_dict`` of the collector has what was learnt there, and a new adapter here goes on with it."""
    make, frames = (
        partial(learning_env, fleet, scenario, models),
        {"frames_per_batch": 40, "total_frames": 80, "auto_register_policy_transforms": False},
    )
    here = make()
    collector = Collector(here, policy, **frames)
    near = torch.cat([data["next", "applied_action"] for data in collector], 1)
    collector.shutdown()
    collector = Collector([make], policy, **ELSEWHERE, **frames)
    far = torch.cat([data["next", "applied_action"][0] for data in collector], 1)
    state = collector.state_dict()["worker0"]["env_state_dict"]
    collector.shutdown()
    torch.testing.assert_close(far, near, rtol=0, atol=0)
    back = make()
    assert here.state_dict()[PUSHED] > 40 and back.state_dict()[PUSHED] == 0
    back.load_state_dict(state)
    for name, value in here.state_dict().items():
        torch.testing.assert_close(back.state_dict()[name], value, rtol=0, atol=0, msg=name, equal_nan=True)
