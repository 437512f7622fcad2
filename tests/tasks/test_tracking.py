"""Tasks whose reference moves: what is seen of it does not depend on where it is, and what cannot be is refused."""

import math
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from tensordict import TensorDict
from torchrl.envs.utils import check_env_specs

from auv_torchrl.agents.pid import PID
from auv_torchrl.envs import make_fleet
from auv_torchrl.evaluation import draw_starts, fly
from auv_torchrl.physics.kinematics import (
    euler_angles,
    matvec,
    quaternion_from_euler,
    quaternion_product,
    rotation_matrix,
    wrap_angle,
)
from auv_torchrl.tasks import (
    TASKS,
    Docking,
    Lemniscate,
    Recorded,
    Reference,
    StationKeeping,
    Tracking,
    Waypoints,
    read_task,
)
from auv_torchrl.tasks.curve import Curve
from auv_torchrl.vehicle import load_vehicle
from tests.agents.tiny_training import train_tiny

PAPER = load_vehicle("paper")
TRACKING = [kind() for kind in TASKS.values() if issubclass(kind, Tracking)]
SIX = {"attitude": True, "thruster_commands": True}
by_name = pytest.mark.parametrize("task", TRACKING, ids=lambda task: task.name)
number = st.floats(-2.0, 2.0)
place = st.tuples(number, number, number)


class Elsewhere(Lemniscate):
    """The lemniscate moved, and turned about the vertical."""

    turn = 0.0
    shift = np.zeros(3)

    def reference(self, time):
        """The reference of the lemniscate, moved and turned."""
        turn = turned(self.turn, len(time))
        there = super().reference(time.reshape(-1))
        ends = [matvec(rotation_matrix(turn[:1]), part) for part in (there.position, *np.split(there.velocity, 2, -1))]
        quaternion = quaternion_product(turned(self.turn, len(there.position)), there.quaternion)
        parts = ends[0] + self.shift, quaternion, np.concatenate(ends[1:], axis=-1)
        return Reference(*(part.reshape(*time.shape, -1) for part in parts))


def turned(angle, count):
    level = np.zeros(count)
    return quaternion_from_euler(level, level, level + angle)


def state_of(position, angles, velocity):
    return np.array([position]), quaternion_from_euler(*np.array(angles)[:, None]), np.array([velocity])


@pytest.mark.parametrize("attitude", [False, True], ids=["4 degrees of freedom", "6 degrees of freedom"])
@settings(max_examples=40, deadline=None)
@given(place, place, st.tuples(*[number] * 6), st.floats(0.0, 60.0), place, st.floats(-3.1, 3.1))
def test_what_is_seen_and_rewarded_does_not_depend_on_where_the_path_lies(
    attitude, position, angles, velocity, time, shift, turn
):
    """A path that is moved and turned, and the vehicle with it, gives the same observation and reward."""
    options = {**SIX, "pitch": 0.2} if attitude else {}
    task, elsewhere = Lemniscate(**options), Elsewhere(**options)
    object.__setattr__(elsewhere, "turn", turn)
    object.__setattr__(elsewhere, "shift", np.array(shift))
    here = state_of(position, angles, velocity)
    rotation = rotation_matrix(turned(turn, 1))
    there = matvec(rotation, here[0]) + np.array(shift), quaternion_product(turned(turn, 1), here[1]), here[2]
    action, times = np.ones((1, 4)), np.array([time])
    np.testing.assert_allclose(elsewhere.observe(*there, times), task.observe(*here, times), atol=1e-9)
    np.testing.assert_allclose(elsewhere.reward(*there, action, times), task.reward(*here, action, times), atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(place, place, st.tuples(*[number] * 6))
def test_a_reference_that_rests_is_seen_as_in_station_keeping(position, angles, velocity):
    """A curve that goes nowhere gives station keeping's observation and reward, and no motion ahead."""

    class Resting(Tracking):
        def drawn(self):
            return Curve(np.zeros((3, 6)), 1.0, closed=False)

    state, time, action = state_of(position, angles, velocity), np.zeros(1), np.ones((1, 4))
    seen, known = Resting().observe(*state, time), StationKeeping().observe(*state, time)
    np.testing.assert_allclose(seen[:, : known.shape[1]], known, atol=1e-12)
    assert (seen[:, known.shape[1] :] == 0).all()
    reward = StationKeeping().reward(*state, action, time)
    np.testing.assert_allclose(Resting().reward(*state, action, time), reward, atol=1e-12)


@by_name
def test_a_reference_moves_as_fast_as_it_says(task):
    """Its velocity is the rate of its position, its turning that of its heading, and it keeps to its speed."""
    times = np.linspace(0.3, task.curve.duration + 3.0, 400)
    before, at, after = (task.reference(times + shift) for shift in (-0.01, 0.0, 0.01))
    rate = (after.position - before.position) / 0.02
    np.testing.assert_allclose(rate, at.velocity[:, :3], atol=0.03)
    turn = wrap_angle(euler_angles(after.quaternion)[2] - euler_angles(before.quaternion)[2]) / 0.02
    assert np.quantile(np.abs(turn - at.velocity[:, 5]), 0.95) < 0.02  # arcs begin and end at once
    if task.name != "recorded":
        assert np.linalg.norm(at.velocity[:, :3], axis=-1).max() < 1.01 * task.speed
    for dtype in (torch.float32, torch.float64):
        there = task.reference(torch.as_tensor(times, dtype=dtype))
        np.testing.assert_allclose(there.position.numpy(), at.position, atol=1e-4)
        assert {part.dtype for part in there[:3]} == {dtype}


def curve_of(name) -> Curve:
    task = read_task({"name": name})
    assert isinstance(task, Tracking)
    return task.curve


def test_the_curves_are_what_their_names_say():
    """The lemniscate is 2 m x 1 m and crosses itself in the middle, a square has its sides, a survey its lanes."""
    size = Lemniscate().curve.rows[:, :3].max(0) - Lemniscate().curve.rows[:, :3].min(0)
    np.testing.assert_allclose(size, (2.0, 1.0, 0.0), atol=1e-3)
    half = Lemniscate().reference(np.array([Lemniscate().curve.duration / 2]))
    np.testing.assert_allclose(half.position, 0.0, atol=1e-3)
    for name, size in {"square": (2, 2, 0), "lawnmower": (3, 3, 0), "circle": (2, 2, 0), "helix": (2, 2, 0.75)}.items():
        rows = curve_of(name).rows[:, :3]
        np.testing.assert_allclose(rows.max(0) - rows.min(0), size, atol=1e-2)
    laps = [curve_of(name).rows[[0, -1], 5] for name in ("circle", "square", "lemniscate")]
    np.testing.assert_allclose([lap[1] - lap[0] for lap in laps], (2 * math.pi, 2 * math.pi, 0.0), atol=1e-9)


def test_a_dock_is_reached_slowly():
    """The last 0.8 m are flown at 0.05 m/s, and the vehicle rests there."""
    task = Docking()
    reference = task.reference(np.linspace(0.0, task.curve.duration + 5.0, 500))
    left = 3.0 - reference.position[:, 0]
    assert np.abs(reference.velocity[left < 0.79, 0]).max() < 0.0501
    assert left[-1] == pytest.approx(0.0, abs=1e-9) and (reference.velocity[-1] == 0).all()


@pytest.mark.parametrize("backend", ["torch", "mujoco"])
@pytest.mark.parametrize("name", TASKS)
def test_every_task_is_an_environment(name, backend):
    """Specs hold on both fleets, episodes begin along the task, and starts that were drawn can be flown again."""
    task = replace(read_task({"name": name}), box_m=1.0, near_share=0.0)
    fleet = make_fleet(backend, PAPER, task, 3, seed=0)
    check_env_specs(fleet)
    drawn = fleet.reset()
    reference = task.reference(drawn["along"][:, 0])
    assert (drawn["position"] - reference.position).abs().max() <= 1.21  # a waypoint may be reached at once
    again = fleet.reset(drawn.select("start"), set_state=True)
    torch.testing.assert_close(again["observation"], drawn["observation"])
    begins = task.for_evaluation(1.0).draw_along(5, torch.Generator().manual_seed(0))
    assert (begins == 0).all()


def late_errors(task, pilot):
    """Mean error of two PIDs from the beginning of a curve, and of standing still, from 4 s on, m."""
    task = replace(task.for_evaluation(0.3), episode_s=8.0)
    starts = draw_starts(task, 2, seed=1)
    flight = fly(make_fleet("torch", PAPER, task, 2, seed=0), pilot(task), starts, task.steps)
    still = (flight.position[:, :1] - flight.reference_position).norm(dim=-1)
    return float(flight.position_error[:, 80:].mean()), float(still[:, 80:].mean())


@by_name
def test_pid_follows_every_curve_better_than_standing_still(task):
    """With feed-forward it stays within 6 cm on average, from starts that are 0.3 m away."""
    error, still = late_errors(task, lambda task: PID(task, vehicle=PAPER))
    assert error < min(0.06, 0.5 * still)


def test_feed_forward_is_worth_something():
    """Without it the drag leaves the PID behind on the lemniscate."""
    without, _ = late_errors(Lemniscate(), PID)
    assert late_errors(Lemniscate(), lambda task: PID(task, vehicle=PAPER))[0] < 0.8 * without


def test_a_waypoint_is_left_when_it_is_reached_or_patience_ends():
    """The PID goes from point to point, each as soon as it is near; one that stands still goes on after 15 s."""
    task = replace(Waypoints().for_evaluation(0.1), episode_s=30.0)
    starts = draw_starts(task, 1, seed=1)
    flight = fly(make_fleet("torch", PAPER, task, 1, seed=0), PID(task), starts, task.steps)
    wanted = flight.reference_position[0]
    changes = (wanted[1:] != wanted[:-1]).any(-1).nonzero()[:, 0]
    assert len(changes) == 3 or (len(changes) == 2 and wanted[0].any())  # it may begin within the first radius
    assert flight.position_error[0, -1] < 0.05
    for change in changes.tolist():
        before = flight.position[0, change + 1] - wanted[change]
        assert before.norm() < task.radius_m + 1e-3
    still = task.reference(np.array([0.0, 14.9, 15.1, 30.1, 100.0])).position
    np.testing.assert_allclose(still, task.points[[0, 0, 1, 2, 3]])


def test_a_start_says_how_far_along_the_task_it_is():
    """A start in the middle of the lemniscate is flown from there."""
    task = Lemniscate().for_evaluation(1.0)
    there = {"along": torch.tensor([[10.0]]), "position": torch.zeros(1, 3), "velocity": torch.zeros(1, 6)}
    start = TensorDict({**there, "quaternion": torch.eye(1, 4)}, [1])
    fleet = make_fleet("torch", PAPER, task, 1, seed=0)
    now = fleet.reset(TensorDict({"start": start}, [1]), set_state=True)
    position, quaternion, velocity = (now["measured", key] for key in ("position", "quaternion", "velocity"))
    expected = task.observe(position, quaternion, velocity, torch.tensor([10.0]))
    torch.testing.assert_close(now["observation"], expected)


def test_a_recorded_path_is_that_of_its_file(tmp_path):
    """With times it is where it was when it was; a flight log will do; without times it is flown at the speed."""
    timed = tmp_path / "timed.csv"
    timed.write_text("t,x,y,z,yaw,cmd_1\n5,0,0,1,0,0.3\n6,1,0,1,1.5,0\n8,1,2,1,3.1,0\n9,1,2,2,-3.1,0\n")
    there = Recorded(file=str(timed)).reference(np.array([0.0, 1.0, 3.0, 4.0]))
    np.testing.assert_allclose(there.position, [[0, 0, 1], [1, 0, 1], [1, 2, 1], [1, 2, 2]], atol=1e-9)
    np.testing.assert_allclose(euler_angles(there.quaternion)[2], [0, 1.5, 3.1, -3.1], atol=1e-9)
    drawn = tmp_path / "drawn.csv"
    drawn.write_text("x,y,z\n0,0,0\n3,0,0\n3,3,0\n")
    task = Recorded(file=str(drawn), speed=0.5)
    assert np.linalg.norm(task.curve.rows[:, 6:9], axis=1).max() == pytest.approx(0.5, rel=0.01)
    np.testing.assert_allclose(task.curve.rows[-1, :3], (3, 3, 0), atol=1e-9)
    same = tmp_path / "copy.csv"
    same.write_text(drawn.read_text())
    assert Recorded(file=str(same), speed=0.5).described() == task.described() != Recorded().described()


@pytest.mark.parametrize("name", TASKS)
def test_every_task_is_trained_on(tmp_path, name):
    """A few updates end in a policy that is kept under a description of the task."""
    task = replace(read_task({"name": name}), episode_s=1.0)
    policy = train_tiny(tmp_path, task=task, total_frames=80, random_frames=20, stretch_steps=10)
    assert policy.metadata["ingredients"]["task"] == task.described()
    assert policy.metadata["network"]["observations"] == len(task.observation_names)


def test_policies_of_different_tasks_are_kept_apart():
    """What a task is described by differs from that of every other, and station keeping's is what it was."""
    described = [TASKS[name]().described() for name in TASKS]
    assert len({repr(sorted(each.items())) for each in described}) == len(TASKS)
    assert StationKeeping().described() == asdict(StationKeeping())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"name": "lemniscate", "speed": 0.0}, "task.speed"),
        ({"name": "lemniscate", "heading": "north"}, "task.heading is 'north': give along or held"),
        ({"name": "lemniscate", "length": 3.0}, "has no length: .*did you mean length_m"),
        ({"name": "lemniscate", "pitch": 0.3}, "followed with task.attitude=true"),
        ({"name": "lemniscate", "attitude": True}, "needs task.tilt=true and task.thruster_commands=true"),
        ({"name": "lemniscate", "preview_s": [-1.0]}, "task.preview_s"),
        ({"name": "lawnmower", "lanes": 0}, "task.lanes"),
        ({"name": "docking", "slow_m": 5.0}, "less than the whole way"),
        ({"name": "waypoints", "north_m": [1.0]}, "give one each for every point"),
        ({"name": "recorded", "file": "nowhere.csv"}, "'nowhere.csv': it cannot be read"),
    ],
)  # fmt: skip
def test_settings_that_cannot_be_are_refused(given, message):
    """Before anything is flown, with what to give instead."""
    with pytest.raises(ValueError, match=message):
        read_task(given)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "it is empty"),
        ("x,y\n0,0\n1,1\n", "it has no column z"),
        ("t,x,y,z\n0,0,0,0\n0,1,0,0\n", "t does not grow in row 3"),
        ("x,y,z\n0,0,0\n", "it has 1 row"),
        ("x,y,z\n0,0,0\n1,nan,0\n", "y in row 3 is no number"),
        ("x,y,z\n0,0,0\n1,0\n", "z in row 3 is no number"),
        ("x,y,z\n1,1,1\n1,1,1\n", "give one that goes somewhere"),
    ],
)
def test_files_that_are_no_path_are_refused(tmp_path, text, message):
    """The error names the file, the row and the remedy."""
    path = tmp_path / "path.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        Recorded(file=str(path))
