"""Vehicles behind the link, and a firmware that needs no socket."""

import pytest

from auv_torchrl.link.lockstep import Lockstep
from auv_torchrl.link.plant import Plant, Start
from auv_torchrl.link.protocol import Servos, servo_packet
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.vehicle import load_vehicle
from tests.link.firmware import NEUTRAL, read_answer


@pytest.fixture(scope="session")
def vehicle():
    """Eight thrusters; 1 N heavier than the water."""
    return load_vehicle("bluerov2_heavy")


@pytest.fixture
def plant(vehicle):
    """Makes a plant of the vehicle with some effects."""

    def make(effects=None, **start):
        scenario = read_scenario("test", {"effects": effects}, vehicle) if effects else Scenario("nominal")
        return Plant(vehicle, scenario, Start(**start))

    return make


class Wire:
    """Hands packets to a lock-step, on a clock of its own."""

    def __init__(self, plant, observers=()):
        self.now = 0.0
        self.lockstep = Lockstep(plant, range(1, 9), observers=observers, clock=lambda: self.now)

    def send(self, frame, pwm=NEUTRAL, rate=400, sender="a"):
        """What is answered to a frame, None for nothing."""
        line = self.lockstep.answer(servo_packet(Servos(rate, frame, tuple(pwm))), sender)
        return None if line is None else read_answer(line)


@pytest.fixture
def wire(plant):
    """A firmware in front of the vehicle with some effects."""
    return lambda effects=None, observers=(), **start: Wire(plant(effects, **start), observers)
