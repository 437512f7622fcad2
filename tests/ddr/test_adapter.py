"""The adapter as a transform: specs, keys, limits, learning, state."""

import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from tensordict.nn import TensorDictModule
from torchrl.envs import TransformedEnv
from torchrl.envs.utils import check_env_specs

from auv_torchrl.ddr import AdapterConfig, DDRAdapter
from auv_torchrl.scenario import read_scenario


@pytest.mark.parametrize(
    "config", [AdapterConfig(map=m) for m in ("affine", "network", "thrusters")], ids=lambda c: c.map
)
def test_the_adapted_environment_keeps_its_specs(config, models, fleet):
    """check_env_specs holds with every kind of map, learning or not."""
    for learning in (False, True):
        adapter = DDRAdapter(models, config)
        adapter.learning = learning
        check_env_specs(TransformedEnv(fleet(3, thrusters=config.map == "thrusters"), adapter))


def test_the_rollout_keeps_the_action_of_the_policy_beside_the_executed_one(models, fleet, policy, scenario):
    """``action`` is what the policy said, ``applied_action`` what moved the thrusters; one map serves all rows."""
    adapter = DDRAdapter(models)
    adapter.g.weight.neg_()
    env = TransformedEnv(fleet(4), adapter)
    flight = env.rollout(30, policy, break_when_any_done=False)
    torch.testing.assert_close(flight["action"], policy(flight.select("observation").clone())["action"])
    applied = flight["next", "applied_action"]
    command = (applied @ models.actuation.mixer.mT).clamp(-1, 1)
    torch.testing.assert_close(flight["next", "command"], command)
    slow = (flight["action"].abs().sum(-1) < 0.9) & (flight["action"].abs().sum(-1) > 0.1)
    torch.testing.assert_close(applied[slow], -flight["action"][slow], atol=1e-3, rtol=0)
    assert (env.reset()["applied_action"] == 0).all()


def test_a_policy_may_write_another_entry(models, fleet, policy, scenario):
    """With another first of ``out_keys_inv`` the policy acts there, and vehicle and map do what they do without it."""
    flights, adapters = [], [DDRAdapter(models, AdapterConfig(seed=3)) for _ in range(2)]
    adapters[1].out_keys_inv = ["channels", *adapters[1].out_keys_inv[1:]]
    renamed = TensorDictModule(policy.module, in_keys=["observation"], out_keys=["channels"])
    for adapter, acting in zip(adapters, (policy, renamed), strict=True):
        env = TransformedEnv(fleet(2, scenario("reversed")), adapter)
        check_env_specs(env)  # of random actions nothing is to be learnt
        assert env.action_keys == adapter.out_keys_inv[:1]
        adapter.learning = True
        env.set_seed(5)
        flights.append(env.rollout(20, acting, break_when_any_done=False))
    assert "action" not in flights[1] and torch.equal(flights[1]["channels"], flights[0]["action"])
    torch.testing.assert_close(flights[1]["next", "applied_action"], flights[0]["next", "applied_action"])


def test_without_a_fault_the_adapter_changes_nothing(models, fleet):
    """A healthy map passes on actions that saturate no thruster, in the short form exactly."""
    adapter = DDRAdapter(models)
    action = 0.3 * (2 * torch.rand(50, 4, generator=torch.Generator().manual_seed(0)) - 1)
    measured = fleet(50).reset()["measured"]
    state = models.state_of(measured["quaternion"], measured["velocity"])
    torch.testing.assert_close(adapter.translate(state, action), action, atol=2e-4, rtol=0)


def test_actions_of_another_width_are_refused(models, fleet):
    """A map to the thrusters on an environment of channels says what to change."""
    with pytest.raises(ValueError, match="thruster_commands=True"):
        _ = TransformedEnv(fleet(2), DDRAdapter(models, AdapterConfig(map="thrusters"))).action_spec


@pytest.mark.parametrize("kind", ["affine", "thrusters"])
@pytest.mark.parametrize("composition", ["short", "long"])
@given(
    rows=hnp.arrays("float32", (2, 16), elements=st.floats(width=32, allow_nan=True, allow_infinity=True)),
    gain=st.sampled_from([-1.0, 0.0, 1e-6, 1.6]),
)
@settings(max_examples=15, deadline=None)
def test_commands_are_finite_and_within_limits_whatever_comes_in(kind, composition, rows, gain, models):
    """Not-a-number and infinite measurements and actions, and singular maps, never give a bad command."""
    adapter = DDRAdapter(models, AdapterConfig(map=kind, composition=composition, least_pairs=2))
    adapter.learning = True
    adapter.g.weight[:, 0] *= gain
    values = torch.from_numpy(rows)
    before, after = (models.state_of(values[:, at : at + 4], values[:, at + 4 : at + 10]) for at in (0, 2))
    for _ in range(3):
        command = adapter.translate(before, values[:, 12:])
        assert command.isfinite().all() and (command.abs() <= 1).all()
        adapter.learner.observe(before, command, adapter.models.R(before, after), torch.ones(2, dtype=torch.bool))
        assert adapter.g.weight.isfinite().all()


def test_what_is_not_a_number_is_not_learnt(models):
    """Transitions with NaN or an impossible jump are counted and enter no bag."""
    adapter = DDRAdapter(models)
    command = torch.tensor((0.5, 0.0, 0.5, 0.0)).expand(3, -1)
    source = command.clone()
    source[0, 1], source[1, 2] = math.nan, 1e6
    adapter.learner.observe(torch.zeros(3, 4), command, source, torch.ones(3, dtype=torch.bool))
    assert int(adapter.learner.ignored) == 2
    assert adapter.learner.bag.count == 1


def test_a_fault_in_flight_empties_the_bag_and_is_learnt(models, fleet, policy, vehicle):
    """Two seconds after thruster 1 reverses, the settled map has been refitted from new pairs and holds the vehicle."""
    change = {"gain_1": -1.0, "start_s": 4.0}
    late = read_scenario("late", {"effects": {"thruster_gain": change}}, vehicle)
    adapter = DDRAdapter(models, AdapterConfig(tolerance=0.015))
    adapter.learning = True
    env = TransformedEnv(fleet(1, late), adapter)
    with torch.no_grad():
        state = env.rollout(79, policy, break_when_any_done=False)
        assert not adapter.learner.uncertain
        healthy, pairs = adapter.g.weight.clone(), adapter.learner.bag.count
        torch.testing.assert_close(healthy, torch.eye(4), atol=0.05, rtol=0)
        # from rest at the target there is nothing to learn from; a push away from it makes the fault matter
        tensordict = state[:, -1]["next"].clone()
        counts = []
        for _ in range(160):
            tensordict["action"] = policy(tensordict.clone())["action"]
            tensordict["action"][:, 0] += 0.5 * math.cos(0.3 * len(counts))
            tensordict["action"].clamp_(-1, 1)
            tensordict = env.step(tensordict)["next"]
            counts.append(adapter.learner.bag.count)
    assert min(counts) < pairs, "the bag was never emptied"
    assert not adapter.learner.uncertain
    thruster_1 = models.actuation.channels_per_share[:, :1] @ models.actuation.mixer[:1]
    torch.testing.assert_close(adapter.g.weight, torch.eye(4) - 2 * thruster_1, atol=0.08, rtol=0)


def test_nothing_is_learnt_unless_asked(models, fleet, policy, scenario):
    """Without ``learning`` a rollout leaves every entry of state_dict as it is."""
    adapter = DDRAdapter(models)
    before = {name: value.clone() for name, value in adapter.state_dict().items()}
    TransformedEnv(fleet(2, scenario("swap")), adapter).rollout(20, policy)
    for name, value in adapter.state_dict().items():
        torch.testing.assert_close(value, before[name], rtol=0, atol=0, msg=name, equal_nan=True)


@pytest.mark.parametrize("kind", ["affine", "network"])
def test_a_flight_goes_on_from_state_dict_as_if_never_interrupted(kind, models, fleet, policy, scenario, tmp_path):
    """Bag, map, modes and dither saved in the middle of collecting continue bit for bit in a new adapter."""
    config = AdapterConfig(map=kind, seed=3)

    def fly(adapter, seed):
        env = TransformedEnv(fleet(1, scenario("reversed"), seed=seed), adapter)
        return env.rollout(20, policy, break_when_any_done=False)["next", "applied_action"]

    whole = DDRAdapter(models, config)
    whole.learning = True
    fly(whole, seed=0)
    torch.save(whole.state_dict(), tmp_path / "adapter.pt")
    restored = DDRAdapter(models, replace(config, seed=99))
    restored.load_state_dict(torch.load(tmp_path / "adapter.pt", weights_only=True))
    assert restored.learning
    torch.testing.assert_close(fly(restored, seed=1), fly(whole, seed=1), rtol=0, atol=0)
