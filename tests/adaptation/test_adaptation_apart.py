"""The adaptation around fleets that step apart: side by side, in other processes, in the process of a collector."""

from functools import partial

import pytest
import torch
from adapted_flights import INTEGRAL, VEHICLE, adapted_fleet, scenario, task
from tensordict import TensorDict
from torchrl.collectors import Collector
from torchrl.envs import ParallelEnv, SerialEnv, TransformedEnv

from auv_torchrl.adaptation import InFlightAdapter, load_adaptation_config
from auv_torchrl.agents.pid import PID
from auv_torchrl.ddr.transform import observing
from auv_torchrl.envs import TorchFleet
from auv_torchrl.evaluation import draw_starts

SECONDS = 5.0
FAULT = scenario("reversed", start_s=0.5)
REPORTED = ("applied_action", "phase", "alarm", "statistic", "effectiveness", "observation")
APART = {"SerialEnv": SerialEnv, "ParallelEnv": partial(ParallelEnv, mp_start_method="fork")}
ELSEWHERE = {"backend": "process", "num_collectors": 1, "sync": True}  # a collector in a process of its own
apart = pytest.mark.parametrize("batched", APART.values(), ids=APART)


def bare(count):
    return TorchFleet(VEHICLE, task(SECONDS), count, scenario=FAULT, seed=0, dtype=torch.float64)


def flown(env):
    starts = TensorDict({"start": draw_starts(task(SECONDS), 4, seed=1).reshape(env.batch_size)}, env.batch_size)
    first = env.reset(starts, set_state=True)
    policy = PID(task(SECONDS), state="expected")
    return env.rollout(70, policy, auto_reset=False, tensordict=first, break_when_any_done=False)


@apart
def test_around_two_fleets_it_adapts_as_around_one(batched):
    """Four vehicles in two fleets are given and reported what they are in one, alarms included."""
    env, one = adapted_fleet(4, SECONDS, FAULT)
    together = flown(env)
    two = InFlightAdapter(VEHICLE, task(SECONDS), load_adaptation_config(), 4)
    env = TransformedEnv(batched(2, partial(bare, 2)), observing(two, task(SECONDS)))
    side_by_side = flown(env)
    env.close()
    assert side_by_side.shape == (2, 2, 70) and one.learner.alarms.min() >= 1
    for key in REPORTED:
        found, expected = side_by_side["next", key].flatten(0, 1), together["next", key]
        torch.testing.assert_close(found, expected, rtol=0, atol=0, msg=key)
    for name, value in one.state_dict().items():
        torch.testing.assert_close(two.state_dict()[name], value, rtol=0, atol=0, msg=name, equal_nan=True)


def test_what_is_learnt_in_the_process_of_a_collector_comes_back(forked):
    """``state_dict`` of the collector has what was learnt there, and a new adapter here goes on with it."""
    make, policy = partial(adapted_env, 2), PID(task(SECONDS), integral=INTEGRAL, state="expected")
    frames = {"frames_per_batch": 60, "total_frames": 120, "auto_register_policy_transforms": False}
    here = make()
    collector = Collector(here, policy, **frames)
    near = torch.cat([data["next", "effectiveness"] for data in collector], 1)
    collector.shutdown()
    policy = PID(task(SECONDS), integral=INTEGRAL, state="expected")
    collector = Collector([make], policy, **ELSEWHERE, **frames)
    far = torch.cat([data["next", "effectiveness"][0] for data in collector], 1)
    state = collector.state_dict()["worker0"]["env_state_dict"]
    collector.shutdown()
    torch.testing.assert_close(far, near, rtol=0, atol=0)
    back = make()
    back.load_state_dict(state)
    learnt, fresh = here.state_dict(), make().state_dict()
    assert any(not torch.equal(value.nan_to_num(), fresh[name].nan_to_num()) for name, value in learnt.items())
    for name, value in learnt.items():
        torch.testing.assert_close(back.state_dict()[name], value, rtol=0, atol=0, msg=name, equal_nan=True)


def adapted_env(count):
    return adapted_fleet(count, SECONDS, FAULT)[0]
