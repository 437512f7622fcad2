"""Following a route at speed by line of sight."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from auv_torchrl.envs import TorchFleet
from auv_torchrl.evaluation import draw_starts, fly
from auv_torchrl.physics.kinematics import quaternion_from_euler
from auv_torchrl.tasks import Route
from auv_torchrl.vehicle import load_vehicle
from tests.helmsmen import helmsman_of_vessel

OTTER = load_vehicle("otter")
CIRCLE = Route(north_m=(0.0, 40.0, 40.0, 0.0), east_m=(0.0, 0.0, 40.0, 40.0), corner_m=20.0)
LINE = Route(north_m=(0.0, 40.0), east_m=(0.0, 0.0), down_m=(0.0, 10.0), closed=False)


def steered(task, position, yaw=0.0, velocity=(1.5, 0.0, 0.0, 0.0, 0.0, 0.0)):
    """What is off at one place."""
    quaternion = quaternion_from_euler(*np.array([0.0, 0.0, yaw])[:, None])
    off = task.steering(np.array([position]), quaternion, np.array([velocity]))
    return {name: float(value[0]) for name, value in off._asdict().items()}


def test_a_square_with_turns_of_half_its_side_is_a_circle():
    """Every point is 20 m from the middle, and the curvature is one over it."""
    rows = CIRCLE.track.rows
    np.testing.assert_allclose(np.hypot(rows[:, 0] - 20.0, rows[:, 1] - 20.0), 20.0, atol=0.02)
    np.testing.assert_allclose(rows[:, 4].mean(), 1 / 20.0, rtol=1e-3)
    assert CIRCLE.track.length == pytest.approx(40 * math.pi, rel=1e-3)


def test_the_nearest_point_is_found_beyond_the_ends_of_an_open_route_too():
    """Along the line where it is open; on a closed one the point of the time is its own foot."""
    foot = LINE.track.foot(np.array([[10.0, 3.0, 0.0], [-5.0, -2.0, 0.0], [47.0, 1.0, 0.0]]))
    np.testing.assert_allclose(foot.position[:, :2], [[10.0, 0.0], [-5.0, 0.0], [47.0, 0.0]], atol=1e-9)
    np.testing.assert_allclose(foot.yaw, 0.0, atol=1e-12)
    wanted = CIRCLE.reference(np.linspace(0.0, 200.0, 57))
    np.testing.assert_allclose(wanted.nearest(wanted.position)[:, :2], wanted.position[:, :2], atol=1e-9)


def test_who_is_beside_the_route_steers_back_to_a_point_ahead():
    """As far beside as the point is ahead: by 45 degrees; a vehicle that slips aside steers by where it goes."""
    beside = steered(LINE, [5.0, LINE.lookahead_m, 0.0])
    assert beside["heading"] == pytest.approx(math.pi / 4) and beside["across"] == pytest.approx(LINE.lookahead_m)
    assert steered(LINE, [5.0, 0.0, 0.0])["heading"] == pytest.approx(0.0)
    assert steered(LINE, [5.0, 0.0, 0.0], -0.1, (1.5, 1.5 * math.tan(0.1), 0, 0, 0, 0))["heading"] == pytest.approx(0.0)


def test_a_turn_is_wanted_where_the_route_turns():
    """The speed over the radius, so that who turns along with it is not off."""
    on_it = CIRCLE.reference(np.array([12.0]))
    along = steered(CIRCLE, on_it.position[0], float(on_it.yaw[0]))
    assert along["turning"] == pytest.approx(1.5 / 20.0, rel=0.05)
    seen = CIRCLE.observe(on_it.position, on_it.quaternion, np.array([[1.5, 0, 0, 0, 0, 1.5 / 20.0]]), np.array([12.0]))
    named = dict(zip(CIRCLE.observation_names, seen[0], strict=True))
    assert abs(named["turning_error"]) < 0.004 and abs(named["heading_error_sin"]) < 1e-9


@pytest.mark.parametrize(("task", "within_m"), [(LINE, 0.1), (CIRCLE, 1.0)], ids=["line", "circle"])
def test_a_helmsman_of_courses_follows_a_route(task, within_m):
    """A surface vessel that starts 3 m beside it; in a turn one that knows no more than headings lags."""
    exam = replace(task, episode_s=30.0).fitted(OTTER).for_evaluation(3.0)
    starts = draw_starts(exam, 6, 3)
    flight = fly(TorchFleet(OTTER, exam, 6, seed=0), helmsman_of_vessel(task=exam), starts, exam.steps)
    assert float(flight.position_error[:, 0].max()) > 1.0
    assert float(flight.position_error[:, -100:].max()) < within_m


def test_starts_lie_along_the_route_to_both_sides():
    """In training anywhere, in an evaluation at its beginning, with the heading of the path there."""
    generator = torch.Generator().manual_seed(0)
    task = replace(Route(), box_m=2.0).fitted(OTTER)
    along = task.draw_along(200, generator)
    position, _, _ = task.draw_starts(200, generator, along)
    off = position - task.reference(along).position
    assert along.max() > 100.0 and off.norm(dim=-1).max() <= 2.0 + 1e-9 and off.norm(dim=-1).max() > 1.5
    exam = task.for_evaluation(1.0)
    assert (exam.draw_along(5, generator) == 0).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"north_m": (0.0, 1.0), "east_m": (0.0, 0.0), "down_m": (0.0, 0.0)}, "of 3 or more"),
        ({"north_m": (0.0, 1.0, 2.0)}, "have 3, 4, 4 entries"),
    ],
)
def test_a_route_that_is_none_is_refused(settings, message):
    """With the entries to mend."""
    with pytest.raises(ValueError, match=message):
        Route(**settings)
