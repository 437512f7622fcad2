"""Contracts of both backends: specs, seeds, partial resets, scenarios, sensors, divergence."""

import logging
import math
import warnings

import pytest
import torch
import yaml
from flights import fly, held_actions, resting
from tensordict import TensorDict
from torchrl.envs import Compose, RewardSum, StepCounter, TransformedEnv, check_env_specs

from auv_torchrl.effects import EFFECTS, get_effect
from auv_torchrl.envs import BACKENDS, RandomizeVehicle, make_fleet
from auv_torchrl.envs.start import BODY
from auv_torchrl.paths import config_path
from auv_torchrl.scenario import read_scenario
from auv_torchrl.sensors import MOTION
from auv_torchrl.tasks import Cruise, Lemniscate, StationKeeping, cruise_speed, fitted
from auv_torchrl.vehicle import load_vehicle
from tests.few_thrusters import without_sway
from tests.hovering import SERVO_EFFECTS, one_for

PAPER = load_vehicle("paper")
SHORT = StationKeeping(episode_s=0.5)
backends = pytest.mark.parametrize("backend", BACKENDS)


@backends
@pytest.mark.parametrize("name", ["paper", "bluerov2", "bluerov2_heavy"])
def test_specs_hold(backend, name):
    """TorchRL's own check of specs passes, for each vehicle, with and without transforms."""
    vehicle = load_vehicle(name)
    check_env_specs(make_fleet(backend, vehicle, StationKeeping(tilt=True), 3, seed=0))
    randomize = RandomizeVehicle(vehicle, {"added_mass": {"scale": [0.8, 1.2]}})
    transformed = TransformedEnv(
        make_fleet(backend, vehicle, SHORT, 3, seed=0), Compose([randomize, StepCounter(), RewardSum()])
    )
    check_env_specs(transformed)


@backends
def test_one_seed_repeats_a_run_exactly(backend):
    """Starts, noise and randomization repeat bit by bit, in a new fleet and after set_seed."""
    noisy = get_effect("sensor_noise").apply(PAPER, {"position": 0.1, "attitude": 0.1})
    ranges = {"thruster_gain": {"gain": [0.5, 1.5]}}

    def make(seed):
        return TransformedEnv(make_fleet(backend, noisy, SHORT, 4, seed=seed), RandomizeVehicle(noisy, ranges))

    def run(env):
        torch.manual_seed(0)
        return env.rollout(25, break_when_any_done=False)

    first = make(5)
    one, other_start = run(first), run(first)
    first.set_seed(5)
    for again in (run(first), run(make(5))):
        assert (one == again).all()
    assert not torch.equal(one["observation"], other_start["observation"])
    assert not torch.equal(one["observation"], run(make(6))["observation"])


def test_backends_start_alike():
    """One seed gives both backends the same starts."""
    starts = [make_fleet(backend, PAPER, StationKeeping(), 5, seed=3).reset()["position"] for backend in BACKENDS]
    torch.testing.assert_close(starts[0], starts[1])


@backends
def test_a_partial_reset_touches_only_its_rows(backend):
    """Rows that are not reset keep state, time, commands and vehicle; the others begin anew."""
    fleet = make_fleet(backend, PAPER, StationKeeping(), 4, seed=0)
    now = fleet.reset()
    for action in held_actions(4, 5):
        now = fleet.step(now.set("action", action))["next"]
    mask = torch.tensor([[False], [True], [False], [True]])
    reset = fleet.reset(now.clone().set("_reset", mask))
    kept, renewed = ~mask[:, 0], mask[:, 0]
    for key in (*BODY, "thrust", "command", "time", "observation"):
        assert torch.equal(reset[key][kept], now[key][kept]), key
        assert not torch.equal(reset[key][renewed], now[key][renewed]), key
    assert (reset["time"][renewed] == 0).all() and (reset["command"][renewed] == 0).all()
    after = fleet.step(TensorDict({"action": torch.zeros(4, 4)}, [4]))["next"]
    torch.testing.assert_close(after["time"][:, 0], torch.tensor([0.30, 0.05, 0.30, 0.05]))


@backends
def test_episodes_end_after_their_time_and_go_on(backend):
    """Truncation at 20 s exactly, then a new episode of that vehicle alone."""
    fleet = make_fleet(backend, PAPER, StationKeeping(episode_s=1.0), 3, seed=0)
    mask = torch.tensor([[True], [False], [False]])
    now, data = fleet.reset(), []
    for step in range(45):
        if step == 7:
            now = fleet.reset(now.set("_reset", mask.clone()), set_state=False)
        done, now = fleet.step_and_maybe_reset(now.set("action", torch.zeros(3, 4)))
        data.append(done["next", "truncated"][:, 0])
    ends = torch.stack(data).nonzero().tolist()
    assert ends == [[19, 1], [19, 2], [26, 0], [39, 1], [39, 2]]


@backends
def test_starts_can_be_given(backend):
    """A start is flown exactly, with transforms around the fleet too, and the returned start repeats a flight."""
    fleet = TransformedEnv(make_fleet(backend, PAPER, StationKeeping(), 2, seed=0), StepCounter())
    drawn = fleet.reset()
    fleet.rollout(3)
    again = fleet.reset(drawn.select("start"), set_state=True)
    for key in BODY:
        assert torch.equal(again[key], drawn[key])


@backends
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"quaternion": torch.ones(2, 4)}, "unit length"),
        ({"position": torch.zeros(2, 2)}, "start.position is of shape"),
        ({"velocity": torch.full((2, 6), math.nan)}, "not finite"),
    ],
)
def test_impossible_starts_are_refused(backend, change, message):
    """A wrong start is an error that names the entry."""
    fleet = make_fleet(backend, PAPER, StationKeeping(), 2, seed=0)
    start = resting(2).update(change)
    with pytest.raises(ValueError, match=message):
        fleet.reset(TensorDict({"start": start}, [2]), set_state=True)
    with pytest.raises(ValueError, match="needs a 'start'"):
        fleet.reset(TensorDict({}, [2]), set_state=True)


@backends
def test_a_scenario_changes_each_vehicle_at_its_own_time(backend):
    """The thruster dies from 0.2 to 0.4 s of each vehicle's episode, whenever that began."""
    scenario = read_scenario(
        "later", {"effects": {"thruster_gain": {"gain_5": 0.0, "start_s": 0.2, "stop_s": 0.4}}}, PAPER
    )
    fleet = make_fleet(backend, PAPER, StationKeeping(), 2, scenario=scenario, seed=0)
    now, thrust = fleet.reset(), []
    for step in range(16):
        if step == 3:
            now = fleet.reset(now.set("_reset", torch.tensor([[False], [True]])), set_state=False)
        now = fleet.step(now.set("action", torch.tensor([[0.0, 0, 1, 0]] * 2)))["next"]
        thrust.append(now["thrust"][:, 4] > 0)
    alive = torch.stack(thrust).T.tolist()
    assert alive[0] == [True] * 4 + [False] * 4 + [True] * 8
    assert alive[1] == [True] * 7 + [False] * 4 + [True] * 5
    assert fleet.vehicle.gain[:, 4].tolist() == [1.0, 1.0]


@backends
def test_late_sensors_and_commands_need_no_preparation(backend):
    """A delay that only appears in mid-flight lengthens the memories: commands and poses arrive late from then on."""
    scenario = read_scenario(
        "late",
        {"effects": {"command_delay": {"delay": 0.2, "start_s": 0.3}, "pose_delay": {"delay": 0.3, "start_s": 0.3}}},
        PAPER,
    )
    actions = torch.zeros(20, 1, 4)
    actions[10:, :, 0] = 1.0
    late = fly(make_fleet(backend, PAPER, StationKeeping(), 1, scenario=scenario, seed=0), actions, resting(1))
    surge = late["velocity"][:, 0, 0]
    assert (surge[:15].abs() < 1e-9).all() and surge[15] > 0.01
    error, position = late["observation"][:, 0, 4], late["position"][:, 0, 0]
    torch.testing.assert_close(error[12:], -position[6:-6], rtol=0, atol=1e-6)


@backends
@pytest.mark.parametrize(
    "effect", [effect for effect in EFFECTS.values() if effect.trial.is_asked(MOTION)], ids=lambda e: e.name
)
def test_every_effect_is_felt(backend, effect):
    """Away from nominal, each effect changes the motion or the observation, but of sensors that no policy has."""
    sound, task = (
        load_vehicle(one_for(effect.name, "paper")),
        Cruise() if effect.name in SERVO_EFFECTS else StationKeeping(),
    )
    nominal = effect.nominal(sound)
    declared = effect.member_parameters(sound)
    values = {k: v + 0.4 * (declared[k].high - v) for k, v in nominal.items()}
    if effect.name == "thruster_swap":
        values = effect.read(PAPER, {"pair": [1, 2]})
    if effect.name == "thrust_limit":
        values = effect.read(PAPER, {"limit": 20.0})
    if effect.name == "tether":
        values = {"north": 5.0, "stiffness": 20.0, "slack": 1.0}
    start = resting(2, [0.4, -0.3, 0.2], [0.1, 0.3, -0.4], ahead=cruise_speed(task))
    actions = held_actions(2, 30)[..., : len(fitted(task, sound).axes)]
    plain, changed = (
        fly(make_fleet(backend, vehicle, task, 2, seed=1), actions, start)
        for vehicle in (sound, effect.apply(sound, values))
    )
    assert (plain["observation"] - changed["observation"]).abs().max() > 1e-3


@backends
def test_the_sensor_model_leaves_the_true_state_alone(backend):
    """Bias, delay and noise of the sensors change the observation, not position, quaternion or reward."""
    start, actions = resting(2, [0.4, -0.3, 0.2]), held_actions(2, 20)
    blurred = PAPER
    for name, values in {
        "heading_bias": {"angle": 0.5},
        "pose_delay": {"delay": 0.2},
        "sensor_noise": {"position": 0.1, "attitude": 0.1},
    }.items():
        blurred = get_effect(name).apply(blurred, values)
    plain, changed = (
        fly(make_fleet(backend, vehicle, StationKeeping(), 2, seed=1), actions, start) for vehicle in (PAPER, blurred)
    )
    assert torch.equal(plain["position"], changed["position"])
    assert torch.equal(plain["quaternion"], changed["quaternion"])
    assert not torch.equal(plain["observation"], changed["observation"])


@backends
def test_a_vehicle_that_diverges_ends_alone(backend, caplog):
    """An impossible start speed terminates that vehicle with a warning; its neighbours fly on, all stays finite."""
    fleet = make_fleet(backend, PAPER, StationKeeping(), 3, seed=0)
    start = resting(3)
    start["velocity"] = torch.zeros(3, 6)
    start["velocity"][1, 0] = 99.0
    fleet.reset(TensorDict({"start": start}, [3]), set_state=True)
    with caplog.at_level(logging.WARNING, logger="auv_torchrl"):
        after = fleet.step(TensorDict({"action": torch.ones(3, 4)}, [3]))["next"]
    assert after["terminated"][:, 0].tolist() == [False, True, False]
    assert "vehicles [1]" in caplog.text
    for key, value in after.items():
        assert value.isfinite().all() if value.is_floating_point() else True, key
    assert torch.equal(after["velocity"][0], after["velocity"][2])


NO_NUMBERS = [math.nan, math.inf, -math.inf, 3e38]


@backends
@pytest.mark.parametrize("task", [SHORT, Lemniscate(), StationKeeping(thruster_commands=True)], ids=str)
def test_an_action_that_is_no_number_ends_that_episode_alone(backend, task, caplog):
    """NaN, infinity and what overflows: the episode ends, all that is reported is finite, the neighbours fly on."""
    fleets = [make_fleet(backend, PAPER, task, 6, seed=0) for _ in range(2)]
    good = torch.ones(fleets[0].action_spec.shape)
    bad = good.clone()
    bad[torch.arange(4), torch.arange(4)] = torch.tensor(NO_NUMBERS)
    ends = []
    for fleet, action in zip(fleets, (good, bad), strict=True):
        now = fleet.reset()
        with caplog.at_level(logging.WARNING, logger="auv_torchrl"):
            ends.append(fleet.step(now.set("action", action))["next"])
    sound, after = ends
    assert after["terminated"][:, 0].tolist() == after["done"][:, 0].tolist() == [True] * 4 + [False] * 2
    assert not sound["terminated"].any() and caplog.text.count("vehicles [0, 1, 2, 3] were given actions") == 1
    for key, value in after.items(include_nested=True, leaves_only=True):
        assert not value.is_floating_point() or value.isfinite().all(), key
        assert torch.equal(value[4:], sound[key][4:]), key


@backends
def test_a_policy_that_gives_no_numbers_is_rolled_out(backend):
    """A rollout goes on through ends and resets: each step ends the episodes of the vehicles with such an action."""

    def policy(tensordict):
        action = torch.zeros(3, 4)
        action[1] = math.nan
        return tensordict.set("action", action)

    data = make_fleet(backend, PAPER, SHORT, 3, seed=0).rollout(15, policy, break_when_any_done=False)
    assert data["next", "terminated"][..., 0].sum(1).tolist() == [0, 15, 0]
    assert data["next", "observation"].isfinite().all() and data["next", "reward"].isfinite().all()


def test_a_gradient_through_such_a_step_is_finite():
    """No gradient flows to an action that is no number, and those of the neighbours are as ever."""
    fleet = make_fleet("torch", PAPER, SHORT, 2, seed=0, straight_through=True)
    action = torch.full((2, 4), 0.5)
    action[0, 2] = math.nan
    action.requires_grad_()
    after = fleet.step(fleet.reset().set("action", action))["next"]
    assert after["terminated"][:, 0].tolist() == [True, False] and after["observation"].isfinite().all()
    (slope,) = torch.autograd.grad(after["reward"].sum(), action)
    assert slope.isfinite().all() and not slope[0].any() and slope[1].all()


@backends
@pytest.mark.parametrize(
    ("action", "found"),
    [
        (torch.zeros(2, 3), r"torch.float32 of shape \[2, 3\]"),
        (torch.zeros(2, 4, 1), r"torch.float32 of shape \[2, 4, 1\]"),
        (torch.zeros(2, 4).double(), r"torch.float64 of shape \[2, 4\]"),
        (torch.zeros(2, 4).long(), r"torch.int64 of shape \[2, 4\]"),
    ],
)
def test_an_action_of_another_shape_is_named(backend, action, found):
    """The error says what came and what to give."""
    fleet = make_fleet(backend, PAPER, SHORT, 2, seed=0)
    fleet.reset()
    with pytest.raises(ValueError, match=rf"the action is {found}: give torch.float32 of shape \[2, 4\]"):
        fleet.step(TensorDict({"action": action}, [2]))


@backends
def test_a_step_before_a_reset_is_refused(backend):
    """Where the vehicles are then is nobody's start."""
    fleet = make_fleet(backend, PAPER, SHORT, 2, seed=0)
    with pytest.raises(RuntimeError, match="step before the first reset: call reset"):
        fleet.step(TensorDict({"action": torch.zeros(2, 4)}, [2]))


@pytest.mark.parametrize("name", ["paper", "bluerov2", "bluerov2_heavy"])
def test_wide_starts_and_randomization_stay_stable(name):
    """Starts at 2 m/s per axis with the wide ranges never diverge."""
    ranges = yaml.safe_load(config_path("randomization", "wide").read_text())
    vehicle = load_vehicle(name)
    fleet = make_fleet("torch", vehicle, StationKeeping(episode_s=1.0), 512, seed=2)
    data = TransformedEnv(fleet, RandomizeVehicle(vehicle, ranges)).rollout(60, break_when_any_done=False)
    assert not data["next", "terminated"].any()


def test_the_observation_is_the_target_as_seen_from_the_body():
    """Facing east at (1, 2, 3) north-east-down, the target is 2 m behind, 1 m to starboard, 3 m above."""
    quarter = math.sqrt(0.5)
    start = resting(1, [1.0, 2.0, 3.0]).set("quaternion", torch.tensor([[quarter, 0.0, 0.0, quarter]]))
    fleet = make_fleet("torch", PAPER, StationKeeping(), 1, seed=0)
    seen = fleet.reset(TensorDict({"start": start}, [1]), set_state=True)["observation"][0]
    names = fleet.task.observation_names
    observed = dict(zip(names, seen.tolist(), strict=True))
    assert observed["error_x"] == pytest.approx(-2.0, abs=1e-6)
    assert observed["error_y"] == pytest.approx(1.0, abs=1e-6)
    assert observed["error_z"] == pytest.approx(-3.0, abs=1e-6)
    assert (observed["heading_error_sin"], observed["heading_error_cos"]) == pytest.approx((-1.0, 0.0), abs=1e-6)


def test_a_share_of_the_training_starts_is_near():
    """Training starts: near_share of them log-uniform, the others in the box; evaluation starts all in the box."""
    task = StationKeeping(box_m=10.0, near_share=0.5, near_m=(0.05, 2.0), start_speed=2.0)
    position, quaternion, velocity = task.draw_starts(4000, torch.Generator().manual_seed(0))
    distance = position.norm(dim=-1)
    assert 0.45 < (distance < 2.0).double().mean() < 0.55
    assert 0.22 < (distance < math.sqrt(0.05 * 2.0)).double().mean() < 0.28
    assert position.abs().max() < 10 and velocity[:, :3].abs().max() > 1.9
    torch.testing.assert_close(quaternion.norm(dim=-1), torch.ones(4000).double())
    position, _, _ = task.for_evaluation(1.0).draw_starts(4000, torch.Generator().manual_seed(0))
    assert 0.98 < position.abs().max() <= 1.0
    torch.testing.assert_close(position.abs().mean(), torch.tensor(0.5).double(), atol=0.02, rtol=0)


def test_the_reward_is_eq_6():
    """Minus the weighted norms, worked out by hand for one state."""
    task = StationKeeping(error_weight=2.0, heading_weight=0.5, velocity_weight=0.1, action_weight=0.01)
    position = torch.tensor([[3.0, 4.0, 0.0]])
    quaternion = torch.tensor([[math.cos(0.2), 0.0, 0.0, math.sin(0.2)]])
    velocity = torch.tensor([[1.0, 0.0, 0.0, 7.0, 7.0, 0.0]])
    action = torch.tensor([[1.0, -1.0, 1.0, 1.0]])
    expected = -(2.0 * 5.0 + 0.5 * 0.4 + 0.1 * 1.0 + 0.01 * 2.0)
    assert float(task.reward(position, quaternion, velocity, action, torch.zeros(()))) == pytest.approx(
        expected, abs=1e-6
    )


@pytest.mark.parametrize(
    "wrong",
    [{"episode_s": 0.0}, {"box_m": -1.0}, {"near_share": 1.5}, {"near_m": (2.0, 1.0)}, {"start_speed": math.nan}],
)
def test_impossible_tasks_are_refused(wrong):
    """Each wrong value is named."""
    with pytest.raises(ValueError, match=next(iter(wrong))):
        StationKeeping(**wrong)


def test_wrong_fleets_are_refused():
    """Backend, size and batch of vehicles are checked; errors say what there is."""
    with pytest.raises(ValueError, match="there are mujoco, torch"):
        make_fleet("gazebo", PAPER, SHORT, 1)
    with pytest.raises(ValueError, match="num_envs is 0"):
        make_fleet("torch", PAPER, SHORT, 0)
    with pytest.raises(ValueError, match="batch"):
        make_fleet("torch", PAPER.expand(3), SHORT, 2)
    with pytest.raises(ValueError, match="thrusters push surge, heave and yaw both ways.*also needs sway"):
        make_fleet("torch", load_vehicle(without_sway()), SHORT, 2)
    with pytest.raises(ValueError, match="also needs pitch"):
        make_fleet("torch", PAPER, Lemniscate(attitude=True, thruster_commands=True), 2)


@backends
def test_reported_values_are_not_changed_later(backend):
    """What a step handed out stays as it was when the fleet flies on and resets."""
    fleet = make_fleet(backend, PAPER, SHORT, 2, seed=0)
    now = fleet.reset()
    kept = now.clone()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        for _ in range(3):
            fleet.step(TensorDict({"action": torch.ones(2, 4)}, [2]))
            fleet.reset(TensorDict({"_reset": torch.tensor([[True], [False]])}, [2]))
    assert (kept == now).all()


@backends
def test_thruster_commands_bypass_the_mixer(backend):
    """With thruster_commands=True an action is what each thruster gets, one entry per thruster of the vehicle."""
    vehicle = load_vehicle("bluerov2_heavy")
    fleet = make_fleet(backend, vehicle, StationKeeping(thruster_commands=True), 1, seed=0)
    fleet.reset()
    action = torch.linspace(-1, 1, 8)[None]
    after = fleet.step(TensorDict({"action": action}, [1]))["next"]
    torch.testing.assert_close(after["command"], action)


@backends
def test_what_the_sensors_say_has_keys_of_its_own(backend):
    """The observation is the task's of the measured state, and that is the true one where the sensors are true."""
    effects = {"sensor_noise": {"position": 0.1, "attitude": 0.1}, "pose_delay": {"delay": 0.2}}
    for noisy in (False, True):
        scenario = read_scenario("sensors", {"effects": effects if noisy else {}}, PAPER)
        fleet = make_fleet(backend, PAPER, SHORT, 3, scenario=scenario, seed=0)
        now = fleet.reset()
        for _ in range(5):
            now = fleet.step(now.set("action", torch.ones(3, 4)))["next"]
        position, quaternion, velocity = (now["measured", key] for key in BODY)
        seen = SHORT.observe(position, quaternion, velocity, now["time"][:, 0])
        torch.testing.assert_close(now["observation"], seen, atol=1e-5, rtol=0)
        apart = (now["measured", "position"] - now["position"]).abs().max()
        assert (apart > 0.01) == noisy and (noisy or torch.equal(now["measured", "quaternion"], now["quaternion"]))
