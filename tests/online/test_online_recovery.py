"""The measures of a recovery."""

import pytest
import torch
from online_flights import VEHICLE
from tensordict import TensorDict

from auv_torchrl.online.recovery import recoveries


def made_up(error_m, alarm_s, lost_s):
    """One flight of 20 s with a fault at 5 s: errors by time, an alarm, a thruster dead from ``lost_s`` on."""
    time = torch.arange(1, 401) * 0.05
    position = torch.stack([torch.tensor(error_m(float(t))) for t in time])[:, None] * torch.tensor([1.0, 0.0, 0.0])
    command = torch.zeros(400, 6)
    command[:, 0] = 0.5
    thrust = 50.0 * command
    thrust[time > lost_s] = 0.0
    alarm = (time - alarm_s).abs() < 0.01
    after = {"time": time[:, None], "position": position, "command": command, "thrust": thrust, "alarm": alarm[:, None]}
    return TensorDict({"next": TensorDict(after, [400])}, [400])[None]


def test_times_and_distances_are_read_off_a_known_flight():
    """Back after 3 s, 0.3 m off at most, felt after 1 s, noticed 0.5 s later."""
    flight = made_up(lambda t: 0.3 if 6.0 < t <= 8.0 else 0.01, alarm_s=6.5, lost_s=6.0)
    found = recoveries(flight, torch.tensor([5.0]), VEHICLE)
    assert float(found.time_s) == pytest.approx(3.0, abs=0.051)
    assert float(found.largest_m) == pytest.approx(0.3)
    assert float(found.steady_m) == pytest.approx(0.01)
    assert float(found.felt_s) == pytest.approx(1.05, abs=0.051)
    assert float(found.delay_s) == pytest.approx(0.45, abs=0.051)
    assert (int(found.alarms), int(found.alarms_before)) == (1, 0)


def test_a_vehicle_that_stays_away_never_recovers():
    """Without an end to the error the time is infinite, without an alarm the delay."""
    found = recoveries(made_up(lambda t: 0.2, alarm_s=99.0, lost_s=6.0), torch.tensor([5.0]), VEHICLE)
    assert float(found.time_s) == float(found.delay_s) == torch.inf


def test_a_flight_that_ends_too_early_is_refused():
    """Less than 10 s after the fault there is no steady error to speak of."""
    with pytest.raises(ValueError, match="within 10 s of its fault"):
        recoveries(made_up(lambda t: 0.0, 99.0, 99.0), torch.tensor([15.0]), VEHICLE)
