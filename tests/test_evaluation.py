"""Metrics against flights whose errors are known."""

import math

import pytest
import torch

from auv_torchrl.envs import TorchFleet
from auv_torchrl.evaluation import Metrics, draw_starts, fly, settling_times, steady_errors
from auv_torchrl.flight import Flight
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle

DT = 0.05


def flight_with(errors: torch.Tensor, yaw: float = 0.0) -> Flight:
    """A flight whose distances to the target are ``errors`` (N, T + 1), split over two axes."""
    count, samples = errors.shape
    position = errors[..., None] * torch.tensor((0.6, 0.0, -0.8), dtype=torch.float64)
    quaternion = torch.tensor((math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)), dtype=torch.float64)
    nothing = torch.zeros(count, samples, 6, dtype=torch.float64)
    return Flight(
        time=(DT * torch.arange(samples, dtype=torch.float64)).expand(count, -1),
        position=position,
        quaternion=quaternion.expand(count, samples, 4),
        velocity=nothing,
        thrust=nothing,
        command=nothing,
        action=nothing[..., :4],
        applied_action=nothing[..., :4],
        reference_position=torch.zeros_like(position),
        reference_quaternion=torch.eye(4, dtype=torch.float64)[0].expand(count, samples, 4),
        miss=errors,
        batch_size=[count, samples],
    )


def test_metrics_average_from_ten_seconds_on_and_then_over_the_starts():
    """Errors before t = 10 s do not count, and mean, spread and worst are over the starts' means."""
    errors = torch.full((4, 401), 5.0, dtype=torch.float64)
    errors[:, 200:] = torch.tensor((0.01, 0.02, 0.03, 0.10), dtype=torch.float64)[:, None]
    metrics = Metrics.of(flight_with(errors, yaw=-0.3))
    assert metrics.mean_m == pytest.approx(0.04) and metrics.miss_m == pytest.approx(0.04)
    assert metrics.std_m == pytest.approx(torch.tensor((0.01, 0.02, 0.03, 0.10)).std(correction=0).item())
    assert metrics.worst_m == metrics.p95_m == pytest.approx(0.10)
    assert metrics.heading_rad == pytest.approx(0.3)


def test_settling_is_the_last_entry_into_five_centimetres():
    """A start that leaves again has not settled before it is back, one that never stays has not at all."""
    errors = torch.full((3, 401), 1.0, dtype=torch.float64)
    errors[0, 80:] = 0.01  # in at 4 s
    errors[1, 80:] = 0.01
    errors[1, 200] = 0.06  # out once at 10 s
    errors[2, 80:400] = 0.01  # out in the last sample
    assert settling_times(flight_with(errors)).tolist() == pytest.approx([4.0, 10.05, math.inf])
    metrics = Metrics.of(flight_with(errors))
    assert metrics.settled == pytest.approx(2 / 3)
    assert metrics.settling_s == pytest.approx(10.05)


def test_a_state_that_is_no_number_counts_as_an_unbounded_error():
    """It makes mean and worst infinite instead of being left out, and JSON says null."""
    errors = torch.full((3, 401), 0.01, dtype=torch.float64)
    errors[1, 300:] = math.nan
    metrics = Metrics.of(flight_with(errors))
    assert math.isinf(metrics.mean_m) and math.isinf(metrics.worst_m) and metrics.settled == pytest.approx(2 / 3)
    assert metrics.as_dict()["mean_m"] is None and metrics.as_dict()["heading_rad"] == pytest.approx(0.0)


def test_a_flight_that_is_too_short_is_refused():
    """Eq. 15 has nothing to average before 10 s."""
    with pytest.raises(ValueError, match="ends at 9 s.*longer"):
        Metrics.of(flight_with(torch.ones(2, 181, dtype=torch.float64)))


@pytest.mark.parametrize("box_m", [1.0, 2.0, 10.0])
def test_starts_depend_on_their_seed_alone_and_fill_the_box(box_m):
    """Other random numbers do not change them, and they reach every side of the box and no farther."""
    task = StationKeeping().for_evaluation(box_m)
    torch.manual_seed(1)
    first = draw_starts(task, 500, seed=7)
    torch.manual_seed(2)
    second = draw_starts(task, 500, seed=7)
    assert (first == second).all()
    assert (draw_starts(task, 500, seed=8)["position"] != first["position"]).all()
    assert 0.95 * box_m < first["position"].abs().amax() <= box_m
    assert (first["position"].mean(dim=0).abs() < 0.1 * box_m).all()


def test_flying_begins_at_the_starts_and_reports_every_control_step(pd_policy):
    """The first sample is the start, the time grid is that of the task, the policy's action is what moved it."""
    task = StationKeeping().for_evaluation(1.0)
    starts = draw_starts(task, 5, seed=3)
    fleet = TorchFleet(load_vehicle("paper"), task, 5, seed=0, dtype=torch.float64)
    flight = fly(fleet, pd_policy, starts, steps=400)
    torch.testing.assert_close(flight.position[:, 0], starts["position"])
    torch.testing.assert_close(flight.time[2], DT * torch.arange(401, dtype=torch.float64))
    mixed = (flight.action[:, 1:] @ torch.from_numpy(load_vehicle("paper").mixer[:, [0, 1, 2, 5]]).float().T).clamp(
        -1, 1
    )
    torch.testing.assert_close(flight.command[:, 1:].float(), mixed)
    assert (steady_errors(flight) < 0.2).all()


def test_a_vehicle_that_diverges_counts_as_an_unbounded_error(pd_policy):
    """Its row is started again by the fleet, which the metrics do not see, and the others fly on."""
    task = StationKeeping().for_evaluation(1.0)
    vehicles = load_vehicle("paper").expand(3).clone()
    vehicles.linear_drag[1] *= -20  # drives instead of braking
    vehicles.quadratic_drag[1] = 0
    flight = fly(TorchFleet(vehicles, task, 3, seed=0), pd_policy, draw_starts(task, 3, seed=3), steps=400)
    errors = steady_errors(flight)
    assert errors.isinf().tolist() == [False, True, False]
    assert errors[0] < 0.2 and errors[2] < 0.2
    assert math.isinf(Metrics.of(flight).mean_m)


def test_a_fleet_of_another_size_is_refused(pd_policy):
    """The message names both sizes."""
    task = StationKeeping()
    fleet = TorchFleet(load_vehicle("paper"), task, 2, seed=0)
    with pytest.raises(ValueError, match=r"\(2,\).*\(3,\)"):
        fly(fleet, pd_policy, draw_starts(task, 3, seed=0), steps=4)
