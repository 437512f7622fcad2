"""A simulator places, steps and reports vehicles, on plain arrays as in MuJoCo."""

import numpy as np
import pytest
import torch

from auv_torchrl.effects import get_effect
from auv_torchrl.effects.effect import changed
from auv_torchrl.physics import ActiveTerms, control_step, prepare
from auv_torchrl.physics.kinematics import euler_angles
from auv_torchrl.scenario import read_scenario
from auv_torchrl.simulator import PlainSimulator, TorchArrays, at_rest, record, replay, simulate
from auv_torchrl.simulator.mujoco import MujocoSimulator
from auv_torchrl.simulator.mujoco_model import compiled, fleet_model
from auv_torchrl.vehicle import load_vehicle, stacked

PAPER = load_vehicle("paper")
DT = 0.05
SIMULATORS = [PlainSimulator, MujocoSimulator]
START = at_rest(np.array([[0.0, 0.0, 1.0], [1.0, -1.0, 0.0], [0.3, 0.2, -0.5]]), np.array([0.0, 1.0, -3.0]), 6)


def with_effect(name, **values):
    return get_effect(name).apply(PAPER, values)


def commands(count=3, steps=60, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (count, steps // 10, 6)).repeat(10, axis=1)


def started(kind, vehicle=PAPER, count=3, **options):
    simulator = kind(vehicle.expand(count), DT, **options)
    simulator.resume(at_rest(START.position[:count], np.zeros(count), 6))
    return simulator


def test_simulating_is_the_equations_of_motion_step_by_step():
    """The shared loop gives what the physics gives, late commands included."""
    vehicle, sent = with_effect("command_delay", delay=0.12), commands()
    c = prepare(vehicle.expand(3).clone()).numpy()
    state = START._replace(commands=np.zeros((3, 4, 6)))
    for command in sent.swapaxes(0, 1):
        state = control_step(c, ActiveTerms.of(c), state, command, DT)
    flown = simulate(vehicle, sent, DT * np.arange(61), START)
    np.testing.assert_allclose(flown.states[:, -1], np.concatenate(state[:3], axis=-1), atol=1e-12)


@pytest.mark.parametrize("kind", SIMULATORS)
def test_a_scenario_acts_at_its_time_in_vehicles_on_their_own_clock(kind):
    """A vehicle that is delayed meets the fault later, and flies until then as without it."""
    config = {"effects": {"thruster_gain": {"gain_1": -1.0, "start_s": 1.0}}}
    sent = commands()
    healthy = replay(started(kind), sent).states
    simulator = started(kind, scenario=read_scenario("fault", config, PAPER))
    simulator.delay_scenario(torch.tensor([0.0, 1.0, 10.0], dtype=torch.float64))
    states = replay(simulator, sent).states
    same = [int(np.argmax(np.abs(one - other).max(-1) > 1e-9)) for one, other in zip(states, healthy, strict=True)]
    assert same == [21, 41, 0]
    assert simulator.vehicles.gain[:, 0].tolist() == [-1.0, -1.0, 1.0]


@pytest.mark.parametrize("kind", SIMULATORS)
def test_vehicles_are_replaced_in_mid_flight(kind):
    """The other rows fly on as they were, and nothing jumps."""
    simulator, sent = started(kind), commands()
    replay(simulator, sent)
    before = simulator.state
    simulator.replace(torch.tensor([1]), with_effect("command_delay", delay=0.3).expand(1))
    assert simulator.state.commands.shape[1] == 7
    np.testing.assert_array_equal(simulator.state.position, before.position)
    states = replay(simulator, sent).states
    unchanged = started(kind)
    replay(unchanged, sent)
    expected = replay(unchanged, sent).states
    np.testing.assert_allclose(states[[0, 2]], expected[[0, 2]], atol=1e-12)
    assert np.abs(states[1] - expected[1]).max() > 0.01


@pytest.mark.parametrize("kind", SIMULATORS)
def test_what_acts_for_one_step_is_gone_in_the_next(kind):
    """Coefficients given to a step push the vehicle in that step alone."""
    simulator = started(kind)
    acting = simulator.coefficients._replace(current=np.tile([1.0, 0.0, 0.0], (3, 1)))
    simulator.step(np.zeros((3, 6)), acting=acting)
    pushed = simulator.state.velocity[:, 0].copy()
    simulator.step(np.zeros((3, 6)))
    assert (pushed > 0).all() and (simulator.state.velocity[:, 0] < pushed).all()


@pytest.mark.parametrize("kind", SIMULATORS)
def test_placing_some_rows_leaves_the_others(kind):
    """A placed vehicle is at rest where it was put; its neighbours do not notice."""
    simulator, sent = started(kind, with_effect("pose_delay", delay=0.2)), commands()
    replay(simulator, sent)
    before, seen = simulator.state, simulator.report()
    simulator.place(torch.tensor([2]), np.ones((1, 3)), np.array([[1.0, 0, 0, 0]]), np.zeros((1, 6)))
    after = simulator.report()
    np.testing.assert_array_equal(simulator.state.velocity[:2], before.velocity[:2])
    np.testing.assert_array_equal(after.position[:2], seen.position[:2])
    np.testing.assert_array_equal(after.position[2], np.ones(3))
    assert simulator.state.time[2] == 0 and not simulator.state.commands[2].any()


@pytest.mark.parametrize("kind", SIMULATORS)
def test_sensors_report_late_and_noisy_what_the_state_is(kind):
    """A late pose is the pose of then; noise has the size that the vehicle says, and the generator repeats it."""
    late = replay(started(kind, with_effect("pose_delay", delay=0.2)), commands())
    np.testing.assert_allclose(late.reported.position[:, 10], late.states[:, 6, :3], atol=1e-12)
    noisy = with_effect("sensor_noise", position=0.1, attitude=0.0)
    reports = [started(kind, noisy, generator=torch.Generator().manual_seed(1)).report() for _ in range(2)]
    np.testing.assert_array_equal(reports[0].position, reports[1].position)
    assert 0.01 < np.abs(reports[0].position - START.position).mean() < 0.3
    np.testing.assert_array_equal(started(kind, noisy).report().position, START.position)


def test_torch_and_numpy_agree():
    """One simulator, two array libraries."""
    arrays = TorchArrays(torch.device("cpu"), torch.float64)
    simulator = PlainSimulator(PAPER.expand(3), DT, arrays=arrays)
    place = torch.arange(3)
    simulator.place(place, START.position, START.quaternion, START.velocity)
    sent = commands()
    for command in sent.swapaxes(0, 1):
        simulator.step(arrays.native(command))
    expected = simulate(PAPER, sent, DT * np.arange(61), START).states[:, -1]
    np.testing.assert_allclose(torch.cat(simulator.state[:3], dim=-1).numpy(), expected, atol=1e-10)


def test_uneven_times_give_the_same_flight_between_the_steps():
    """The same held commands, sampled unevenly, lead to the same states within what a step can shift them."""
    sent = commands()
    times = DT * np.arange(61)
    kept = np.sort(np.random.default_rng(0).choice(np.arange(1, 60), 40, replace=False))
    kept = np.concatenate(([0], np.union1d(kept, np.arange(10, 60, 10)), [60]))
    even = simulate(PAPER, sent, times, START)
    uneven = simulate(PAPER, sent[:, kept[:-1]], 7.0 + times[kept], START)
    np.testing.assert_allclose(uneven.states, even.states[:, kept], atol=1e-9)
    np.testing.assert_allclose(uneven.reported.position, even.states[:, kept, :3], atol=1e-9)


def test_a_diverged_vehicle_is_no_number_from_there_on_and_alone():
    """A vehicle whose drag pushes is lost, those beside it are not."""
    wild = changed(PAPER, linear_drag=-300.0 * PAPER.linear_drag)
    sent = commands()
    states = simulate(stacked([PAPER, wild, PAPER]), sent, DT * np.arange(61), START).states
    lost = np.asarray(np.isnan(states).any(-1))
    assert not lost[[0, 2]].any() and lost[1, -1] and (np.diff(lost[1].astype(int)) >= 0).all()
    np.testing.assert_array_equal(states[[0, 2]], simulate(PAPER, sent, DT * np.arange(61), START).states[[0, 2]])


def test_a_pilot_sees_what_is_recorded():
    """What the pilot was shown is the measured pose, noise included, and what he sent is kept."""
    shown = []

    def pilot(time, measured):
        shown.append(measured)
        return np.full((3, 6), 0.1 * np.cos(time))

    noise = np.random.default_rng(0).normal(size=(20, 3, 6))
    simulator = started(PlainSimulator)
    flown = record(simulator, pilot, 20, DT, noise)
    np.testing.assert_array_equal(flown.measured, np.stack(shown, axis=1))
    np.testing.assert_allclose(flown.measured - flown.pose, noise.swapaxes(0, 1), atol=1e-12)
    np.testing.assert_allclose(flown.commands[0, :, 0], 0.1 * np.cos(DT * np.arange(20)))
    again = simulate(PAPER, flown.commands, DT * np.arange(21), at_rest(START.position, np.zeros(3), 6))
    np.testing.assert_allclose(flown.pose[:, 1:, 5], euler_angles(again.states[:, 1:-1, 3:7])[2], atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "arrays"),
    [*((kind, None) for kind in SIMULATORS), (PlainSimulator, TorchArrays(torch.device("cpu"), torch.float64))],
    ids=["plain", "mujoco", "torch"],
)
def test_an_accelerometer_feels_the_weight_and_what_the_velocity_changes_by(kind, arrays):
    """At rest (0, 0, -9.81) and its bias; then the change of velocity over a step, and of a row placed anew none."""
    simulator = kind(with_effect("accelerometer_bias", bias_ax=0.25).expand(3).clone(), DT, arrays=arrays)
    native, rest = simulator.arrays.native, torch.tensor([0.25, 0.0, -9.81], dtype=torch.float64)
    upright, still = torch.tensor([[1.0, 0.0, 0.0, 0.0]]).expand(3, 4), torch.zeros(3, 6)
    simulator.place(torch.arange(3), native(torch.zeros(3, 3)), native(upright), native(still))
    torch.testing.assert_close(torch.as_tensor(simulator.felt()), rest.expand(3, 3), atol=1e-6, rtol=0.0)
    simulator.step(native(0.2 * torch.from_numpy(commands()[:, 0])))
    velocity, felt = (torch.as_tensor(array) for array in (simulator.state.velocity, simulator.felt()))
    torch.testing.assert_close((felt - rest)[:, :2], velocity[:, :2] / DT, atol=0.05, rtol=0.0)  # it hardly tilts
    assert (felt - rest)[:, :2].abs().max() > 0.02
    simulator.place(torch.tensor([1]), native(torch.zeros(1, 3)), native(upright[:1]), native(still[:1]))
    torch.testing.assert_close(torch.as_tensor(simulator.felt())[1], rest, atol=1e-6, rtol=0.0)


@pytest.mark.parametrize(
    ("sent", "times"), [(commands(), np.arange(60)), (commands()[0], np.arange(61)), (commands(), np.zeros(61))]
)
def test_commands_and_times_that_do_not_fit_are_refused(sent, times):
    """One line says what was given and what to give."""
    with pytest.raises(ValueError, match=r"give commands \(N, T, n\) and T \+ 1 rising times"):
        simulate(PAPER, sent, times)


def test_one_vehicle_is_no_batch():
    """A simulator wants to know how many there are."""
    with pytest.raises(ValueError, match=r"give a batch \[N\]"):
        PlainSimulator(PAPER, DT)


@pytest.mark.thorough
def test_a_fleet_that_is_too_large_for_mujoco_is_refused_with_the_way_out():
    """The sentence says how many vehicles were asked for, and what takes any number."""
    model = fleet_model(PAPER, 4096, DT)
    with pytest.raises(ValueError, match="4,096 vehicles are more than one MuJoCo model holds: .*backend=torch"):
        compiled(model)
