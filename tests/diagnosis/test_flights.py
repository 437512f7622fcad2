"""What flights share, and by how much each of them differs."""

from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl.diagnosis.calibrate import flights as flights_module
from auv_torchrl.diagnosis.calibrate.calibration import draft
from auv_torchrl.diagnosis.calibrate.flights import FlightInformation, fit_flight, fit_random_effects
from auv_torchrl.diagnosis.calibrate.parameters import NuisanceParameters, VehicleEstimate, state_nuisance
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.vehicle.changed_file import described
from tests.diagnosis.flown_logs import fly, hold

SPREAD = 0.5  # N, of the trim from flight to flight, as stated
FILE = 1.0  # N, within which the file is right
KEEN = 1e6  # 1 / N², by which each flight tells its own trim


def shared(*trims):
    """What flights with these trims in N share."""
    entries = (("buoyancy", "force", 0.0, float(np.hypot(SPREAD, FILE))),)
    nuisance = NuisanceParameters(entries, np.array([FILE]), (np.array([[SPREAD**2]]),), np.zeros(1))
    flights = [FlightInformation(np.array([[KEEN]]), np.array([KEEN * trim])) for trim in trims]
    return fit_random_effects(flights, VehicleEstimate.from_file(load_vehicle("paper"), nuisance))


@pytest.mark.parametrize("trim", [0.1, 1.0, 3.0, 8.0])
def test_one_flight_shows_no_spread(trim):
    """However far it is from the file: what the vehicle has lies between both, by how sure each is of it."""
    found = shared(trim)
    assert found.sizes == (1.0,)
    assert found.mean == pytest.approx([trim * FILE**2 / (FILE**2 + SPREAD**2)], rel=1e-3)


def test_flights_show_how_far_they_differ():
    """More than is stated, or less; the mean is theirs."""
    (wide,), (narrow,) = shared(-2.0, 2.0, -1.8, 1.9).sizes, shared(0.0, 0.01, -0.01, 0.0).sizes
    assert narrow < 1 < wide
    assert shared(0.7, 0.71, 0.69, 0.7).mean == pytest.approx([0.7], abs=0.1)


def test_a_vehicle_that_loses_its_flights_is_not_kept(monkeypatch):
    """Where the last pass follows them no more, that of the pass before stands, with the disturbance that it shows."""
    held, settings = hold(load_vehicle("paper")), load_settings()
    drafted = draft([fly(held, {}, seed=seed, episodes=2, seconds=10.0) for seed in (1, 2)], held, settings)
    begin = VehicleEstimate.from_file(held, state_nuisance(held, settings, drafted.flights[0].channels))
    followed = []

    def losing(windows, own, *given):
        followed.append(own)
        problem, fit = fit_flight(windows, own, *given)
        return problem, replace(fit, chi2=1e9) if len(followed) > 2 else fit

    monkeypatch.setattr(flights_module, "fit_flight", losing)
    stood = flights_module.fit_flights(drafted.flights, begin, drafted.prior, settings)
    assert len(followed) == 4 and described(followed[2]) != described(followed[0])
    assert stood.estimate is begin and stood.excess < settings.excess
    assert (stood.prior.floor != np.array(settings.floor_force)).any()
