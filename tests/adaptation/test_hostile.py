"""Bad measurements and bad actions: commands stay finite and within limits, what was learnt survives."""

import numpy as np
import pytest
import torch
from adapted_flights import VEHICLE, adapted_fleet, scenario, task
from hypothesis import example, given, settings
from hypothesis import strategies as st

from auv_torchrl.adaptation import InFlightAdapter, load_adaptation_config
from auv_torchrl.adaptation.learner import FROZEN
from auv_torchrl.effects import get_effect
from auv_torchrl.scenario import Change, Scenario

REST = np.eye(13)[3]  # at the origin, level, heading north
HOSTILE = (
    "fine",
    "nan",
    "inf",
    "huge",
    "frozen",
    "far",
    "skip_time",
    "stop_time",
    "nan_time",
    "nan_action",
    "full_action",
)


class Abuse:
    """Drives an adapter's two halves with whatever a hostile world reports."""

    def __init__(self, count, seed, **overrides):
        self.adapter = InFlightAdapter(VEHICLE, task(20.0), load_adaptation_config(overrides=overrides), count)
        self.learner, self.count = self.adapter.learner, count
        self.rng = np.random.default_rng(seed)
        self.time = np.zeros(count)
        self.measured = np.tile(REST, (count, 1))
        self.learner.begin(np.arange(count), self.measured)

    def step(self, what):
        """One control step in which ``what`` happens."""
        action = torch.from_numpy(self.rng.uniform(-1, 1, (self.count, 4))).float()
        if what == "nan_action":
            action[0] = torch.nan
        if what == "full_action":
            action[:] = 1.0
        command = self.adapter.translate(action)
        self.time = self.time + {"skip_time": 3.0, "stop_time": 0.0}.get(what, 0.05)
        if what != "frozen":
            self.measured = REST + 0.3 * self.rng.standard_normal((self.count, len(REST)))
        reported = self.measured.copy()
        value = {"nan": np.nan, "inf": -np.inf, "huge": 1e30, "far": 50.0}.get(what)
        if value is not None:
            reported[:, self.rng.integers(0, len(REST), 3)] = value
        time = np.full(self.count, np.nan) if what == "nan_time" else self.time
        self.learner.observe(self.adapter.actuation.delivered(command).double().numpy(), reported, time)
        assert command.isfinite().all() and command.abs().max() <= 1.0
        belief = self.learner.estimate.belief
        assert np.isfinite(belief.mean).all() and np.isfinite(belief.covariance).all()


@pytest.mark.parametrize("sensed", ["velocity", "pose"])
@settings(max_examples=10, deadline=None)
@example(events=[("skip_time", 24), ("huge", 8), ("fine", 1), ("huge", 14)], seed=310)
@given(events=st.lists(st.tuples(st.sampled_from(HOSTILE), st.integers(1, 15)), max_size=6), seed=st.integers(0, 999))
def test_no_sequence_of_bad_input_gives_a_bad_command(sensed, events, seed):
    """Whatever is lost, frozen, huge, late or not a number, commands are numbers in [-1, 1] and beliefs finite."""
    abuse = Abuse(3, seed, sensed=sensed)
    for what, times in events:
        for _ in range(times):
            abuse.step(what)


def test_no_random_hostile_steps_give_a_bad_command(pytestconfig):
    """400 steps of 30 vehicles, one bad event after another; a million steps with --hostile 2500."""
    abuse = Abuse(pytestconfig.getoption("hostile"), 1)
    for what in abuse.rng.choice(HOSTILE, 400):
        abuse.step(what)


@pytest.mark.parametrize("what", ["nan", "frozen", "nan_time"])
def test_what_was_learnt_is_frozen_while_measurements_are_lost(what, caplog):
    """After half a second without a usable measurement the map stays bit by bit, that is said, and flight resumes."""
    env, adapter = adapted_fleet(1, 60.0, scenario("reversed"))
    tensordict = env.reset()
    generator = torch.Generator().manual_seed(0)

    def fly(steps, spoil):
        nonlocal tensordict
        for _ in range(steps):
            tensordict["action"] = torch.rand(1, 4, generator=generator) * 2 - 1
            tensordict = env.step_mdp(env.step(tensordict))

    learner, estimate = adapter.learner, adapter.learner.estimate
    fly(60, False)
    observe, last = learner.observe, {}

    def spoilt(share, measured, time):
        last.setdefault("measured", measured.copy())
        if what == "nan":
            measured = np.full_like(measured, np.nan)
        if what == "frozen":
            measured = last["measured"]
        return observe(share, measured, np.full_like(time, np.nan) if what == "nan_time" else time)

    learner.observe = spoilt
    fly(15, True)
    assert learner.phase[0] == FROZEN
    assert "no usable measurement" in caplog.text
    before = estimate.map[0].copy()
    fly(20, True)
    np.testing.assert_array_equal(estimate.map[0], before)
    learner.observe = observe
    fly(10, False)
    assert learner.phase[0] != FROZEN


def test_a_vehicle_without_any_thruster_left_is_survived():
    """With all thrusters dead commands stay finite and the estimate says that nothing moves the vehicle."""
    dead = Scenario("dead", (Change("dead", get_effect("thruster_gain"), {f"gain_{i}": 0.0 for i in range(1, 7)}),))
    env, adapter = adapted_fleet(2, 20.0, dead)
    tensordict = env.reset()
    generator = torch.Generator().manual_seed(0)
    for _ in range(100):
        tensordict["action"] = torch.rand(2, 4, generator=generator) * 2 - 1
        tensordict = env.step_mdp(env.step(tensordict))
        assert tensordict["applied_action"].isfinite().all()
        assert tensordict["applied_action"].abs().max() <= 1.0
    found, _ = adapter.learner.estimate.map
    assert np.abs(found / adapter.learner.motion.full_wrench[:, None]).max() < 0.1
