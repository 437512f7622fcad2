"""The measures of a recovery."""

import json
import math
from typing import cast

import pytest
import torch
from adapted_flights import VEHICLE

from auv_torchrl.adaptation.flight import AdaptedFlight, gains
from auv_torchrl.adaptation.recovery import recoveries
from auv_torchrl.authority import controlled_allocation
from auv_torchrl.flight import Flight


def made_up(error_m, alarm_s, lost_s, settled_s=math.inf):
    """One flight of 20 s with a fault at 5 s: errors by time, an alarm, a thruster dead from ``lost_s`` on."""
    time = torch.arange(401) * 0.05
    position = torch.stack([torch.tensor(error_m(float(t))) for t in time])[:, None] * torch.tensor([1.0, 0.0, 0.0])
    command = torch.zeros(401, 6)
    command[:, 0] = 0.5
    thrust = 50.0 * command
    thrust[time > lost_s] = 0.0
    zeros = torch.zeros(401, 6)
    flight = Flight(
        time=time, position=position, quaternion=zeros[:, :4], velocity=zeros, thrust=thrust, command=command,
        action=zeros[:, :4], applied_action=command, reference_position=zeros[:, :3],
        reference_quaternion=zeros[:, :4], miss=position.norm(dim=-1), batch_size=[401],
    )  # fmt: skip
    flown = AdaptedFlight(
        flight=flight,
        alarm=(time - alarm_s).abs() < 0.01,
        phase=((time >= alarm_s) & (time < settled_s)).long(),
        statistic=torch.zeros(401),
        effectiveness=torch.zeros(401, 4, 6),
        batch_size=[401],
    )
    return cast(AdaptedFlight, flown[None])


def test_times_and_distances_are_read_off_a_known_flight():
    """Back after 3 s, 0.3 m off at most, felt after 1 s, noticed 0.5 s later, learnt again 0.8 s after that."""
    flight = made_up(lambda t: 0.3 if 6.0 < t <= 8.0 else 0.01, alarm_s=6.5, lost_s=6.0, settled_s=7.3)
    found = recoveries(flight, torch.tensor([5.0]), VEHICLE)
    assert float(found.time_s) == pytest.approx(3.0, abs=0.051)
    assert float(found.largest_m) == pytest.approx(0.3)
    assert float(found.steady_m) == pytest.approx(0.01)
    assert float(found.felt_s) == pytest.approx(1.05, abs=0.051)
    assert float(found.delay_s) == pytest.approx(0.45, abs=0.051)
    assert float(found.refit_s) == pytest.approx(0.8, abs=0.051)
    assert (int(found.alarms), int(found.alarms_before)) == (1, 0)


def test_a_vehicle_that_stays_away_never_recovers():
    """Without an end to the error the time is infinite, without an alarm the delay."""
    found = recoveries(made_up(lambda t: 0.2, alarm_s=99.0, lost_s=6.0), torch.tensor([5.0]), VEHICLE)
    assert float(found.time_s) == float(found.delay_s) == torch.inf


def test_a_flight_that_ends_too_early_is_refused():
    """Less than 10 s after the fault there is no steady error to speak of."""
    with pytest.raises(ValueError, match="within 10 s of its fault"):
        recoveries(made_up(lambda t: 0.0, 99.0, 99.0), torch.tensor([15.0]), VEHICLE)


def test_between_two_changes_only_what_lies_between_counts():
    """A change at 5 s and the next at 8 s: the error and the alarm after 8 s belong to the second."""
    flight = made_up(lambda t: 0.3 if t > 8.0 else 0.01, alarm_s=9.0, lost_s=9.0)
    first = recoveries(flight, torch.tensor([5.0]), VEHICLE, until_s=torch.tensor([8.0]))
    assert float(first.largest_m) == pytest.approx(0.01) and float(first.time_s) == 0.0
    assert int(first.alarms) == 0 and math.isnan(float(first.steady_m))
    second = recoveries(flight, torch.tensor([8.0]), VEHICLE)
    assert float(second.largest_m) == pytest.approx(0.3) and int(second.alarms) == 1


def test_a_change_that_alters_no_thrust_is_timed_from_when_it_came():
    """A current is never felt at the thrusters: the delay counts from its beginning."""
    found = recoveries(made_up(lambda t: 0.01, alarm_s=5.5, lost_s=99.0), torch.tensor([5.0]), VEHICLE)
    assert float(found.felt_s) == torch.inf
    assert float(found.delay_s) == pytest.approx(0.5, abs=0.051)


def test_numbers_that_there_are_not_are_null():
    """Never noticed, never back: no delay and no infinity in JSON."""
    found = recoveries(made_up(lambda t: 0.2, alarm_s=99.0, lost_s=6.0), torch.tensor([5.0]), VEHICLE).as_dict()
    json.dumps(found, allow_nan=False)
    assert found["noticed"] == 0.0 and found["delay_s"] is None and found["recovery_s"]["p90"] is None


def test_gains_are_those_of_the_thrusters():
    """Columns times 1, 0.4, 0, -1 are read as that."""
    nominal = torch.from_numpy(controlled_allocation(VEHICLE))
    given = torch.tensor([1.0, 0.4, 0.0, -1.0, 1.0, 1.0], dtype=nominal.dtype)
    torch.testing.assert_close(gains(nominal * given, nominal), given)
