"""What the adaptation does in flight: nothing when healthy, the right thing after a fault."""

import numpy as np
import pytest
import torch
from adapted_flights import INTEGRAL, VEHICLE, adapted_fleet, adapted_flight, scenario, task
from torchrl.envs import TransformedEnv
from torchrl.envs.utils import check_env_specs

from auv_torchrl.adaptation import InFlightAdapter, load_adaptation_config
from auv_torchrl.agents.pid import PID
from auv_torchrl.authority import controlled_allocation
from auv_torchrl.envs import TorchFleet
from auv_torchrl.evaluation import draw_starts, fly
from auv_torchrl.scenario import read_scenario
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle

FAULTS = ("swap", "thruster_gain", "reversed", "reversed_and_dead", "cycle", "two_reversed", "triple_fault")


def test_the_environment_keeps_its_contract():
    """The specs of the adapted environment hold."""
    check_env_specs(adapted_fleet(3, 20.0)[0])


def test_a_healthy_vehicle_is_left_alone():
    """Without a fault there is no alarm, no dither, and the thrusters get what the mixer would give them."""
    flight, adapter = adapted_flight(count=4, seconds=8.0)
    assert adapter.learner.alarms.sum() == 0
    mixed = (flight.action @ adapter.actuation.mixer.mT).clamp(-1, 1)
    difference = adapter.actuation.delivered(flight.command.float()) - adapter.actuation.delivered(mixed)
    assert float(difference.abs().mean()) < 0.02


@pytest.mark.parametrize(
    "name", [*FAULTS[:3], *(pytest.param(name, marks=pytest.mark.thorough) for name in FAULTS[3:])]
)
def test_every_fault_in_flight_is_recovered_from(name):
    """A fault 1 s into the flight is noticed, and 7 s later the vehicle holds the target."""
    flight, adapter = adapted_flight(scenario(name, start_s=1.0), count=3, seconds=10.0)
    assert adapter.learner.alarms.max() >= 1
    late = flight.position_error[:, flight.time[0] >= 8.0]
    assert float(late.mean(1).max()) < 0.07  # the source controller leaves 0.04 m inside the dead band


def test_the_map_that_is_found_is_that_of_the_vehicle():
    """After two thrusters were reversed the estimated effectiveness is the true one within its standard error."""
    _, adapter = adapted_flight(scenario("two_reversed"), count=3, seconds=5.0)
    truth = controlled_allocation(scenario("two_reversed").vehicle_at(VEHICLE))
    learner = adapter.learner
    found, _ = learner.estimate.map
    error = np.abs(found - truth) / learner.motion.full_wrench[:, None]
    assert error.max() < 0.1
    assert learner.estimate.uncertainty().max() < learner.config.uncertain_above


@pytest.mark.parametrize(
    ("effect", "parameter", "late_s"),
    [
        ("command_delay", "delay", 0.24),
        *(pytest.param("command_delay", "delay", late_s, marks=pytest.mark.thorough) for late_s in (0.13, 0.18)),
        *(
            pytest.param("thruster_lag", "time_constant", late_s, marks=pytest.mark.thorough)
            for late_s in (0.13, 0.25, 0.32)
        ),
    ],
)
def test_late_thrust_is_told_from_wrong_thrust(effect, parameter, late_s):
    """Delays and lags between those that are tried are found as such, instead of being fitted by a map.

    What is found is as late as the truth within two control steps, about how far apart those are that are tried.
    """
    config = load_adaptation_config()
    assert late_s not in (*config.delays_s, *config.lags_s)
    acting = read_scenario(effect, {"effects": {effect: {parameter: late_s}}}, VEHICLE)
    flight, adapter = adapted_flight(acting, count=2, seconds=12.0)
    found = adapter.learner.estimate.timing.late_s()
    assert found.min() > 0 and found.mean() == pytest.approx(late_s, abs=0.1)
    assert float(flight.position_error[:, flight.time[0] >= 10.0].mean()) < 0.05


def test_the_end_of_a_fault_is_noticed_too():
    """When the weed falls off, the map goes back to that of the healthy vehicle."""
    config = {"effects": {"thruster_gain": {"gain_1": -1.0, "start_s": 1.0, "stop_s": 5.0}}}
    weed = read_scenario("weed", config, VEHICLE)
    _, adapter = adapted_flight(weed, count=3, seconds=9.0, policy=Wandering())
    assert adapter.learner.alarms.min() >= 2
    found, _ = adapter.learner.estimate.map
    assert np.abs(found - adapter.learner.motion.per_share).max() < 0.1 * adapter.learner.motion.full_wrench.max()


class Wandering(PID):
    """A controller that never comes to rest, so that every thruster is used all the time."""

    def __init__(self):
        super().__init__(task(1.0), integral=INTEGRAL, state="expected")

    def forward(self, tensordict):
        """Add slow waves to the action."""
        tensordict = super().forward(tensordict)
        phase = 2 * torch.pi * tensordict["time"].float() * torch.tensor((0.5, 0.4, 0.6, 0.3))
        return tensordict.set("action", (tensordict["action"] + 0.4 * torch.sin(phase)).clamp(-1, 1))


def test_a_hull_that_no_map_explains_does_not_spoil_the_map():
    """A vehicle of a tenth of the drag, seen by pose alone: no thruster is believed to do three times what it can."""
    flown = task(15.0)
    adapter = InFlightAdapter(VEHICLE, flown, load_adaptation_config(overrides={"sensed": "pose"}), 3)
    hull = TorchFleet(load_vehicle("bluerov2"), flown, 3, scenario=scenario("sensor_noise"), seed=0)
    pilot = PID(flown, integral=INTEGRAL, state="expected")
    flight = fly(TransformedEnv(hull, adapter), pilot, draw_starts(flown, 3, 1), 299)
    found, _ = adapter.learner.estimate.map
    assert np.abs(found / adapter.learner.motion.full_wrench[:, None]).max() < 1.0
    assert float(flight.position_error[:, flight.time[0] >= 13.0].mean()) < 0.1


def test_a_flight_goes_on_after_loading_its_state():
    """An adapter that loads another's state dict sends the same commands from then on."""
    _, first = adapted_flight(scenario("swap"), count=3, seconds=2.0)
    second = InFlightAdapter(VEHICLE, task(2.0), first.config, 3)
    second.load_state_dict(first.state_dict())
    action = torch.rand(3, 4) * 2 - 1
    torch.testing.assert_close(second.translate(action), first.translate(action), rtol=0, atol=0)


def test_a_channel_environment_is_refused():
    """An environment that takes channels instead of thruster commands is an error that says what to do."""
    flown = StationKeeping()
    adapter = InFlightAdapter(VEHICLE, flown, load_adaptation_config(), 2)
    with pytest.raises(ValueError, match="thruster_commands=True"):
        _ = TransformedEnv(TorchFleet(VEHICLE, flown, 2, seed=0), adapter).action_spec


def test_motion_capture_noise_raises_no_alarm_and_hides_no_fault():
    """From pose with 2 mm and 0.2 degrees of noise a healthy flight stays quiet, a reversed thruster is overcome."""
    noise = scenario("sensor_noise")
    _, adapter = adapted_flight(noise, count=6, seconds=8.0, sensed="pose")
    assert adapter.learner.alarms.sum() == 0
    both = type(noise)("both", noise.changes + scenario("reversed", start_s=3.0).changes)
    flight, adapter = adapted_flight(both, count=4, seconds=12.0, sensed="pose")
    assert adapter.learner.alarms.min() >= 1
    assert float(flight.position_error[:, flight.time[0] >= 10.0].mean(1).max()) < 0.06


def test_each_vehicle_meets_the_fault_at_its_own_time():
    """With delays of 0, 1 and 2 s the scenario begins that much later for each vehicle of a fleet."""
    acting = scenario("reversed", start_s=1.0)
    fleet = TorchFleet(VEHICLE, task(10.0), 3, scenario=acting, seed=0)
    fleet.simulator.delay_scenario(torch.tensor([0.0, 1.0, 2.0]))
    tensordict = fleet.reset()
    changed = []
    for _ in range(70):
        tensordict["action"] = torch.ones(3, 6)
        tensordict = fleet.step_mdp(fleet.step(tensordict))
        changed.append(tensordict["thrust"][:, 0] < 0)
    first = torch.stack(changed).int().argmax(0) * 0.05
    torch.testing.assert_close(first, torch.tensor([1.0, 2.0, 3.0]), atol=1e-6, rtol=0)
    with pytest.raises(ValueError, match="3 times of 0 s or more"):
        fleet.simulator.delay_scenario(torch.tensor([-1.0, 0.0, 0.0]))


def test_what_remains_of_an_infeasible_vehicle_is_declared_and_held(caplog):
    """With two dead thrusters the lost degree of freedom is named by rank, and the vehicle still holds its place."""
    caplog.set_level("DEBUG")  # of a fleet it is no warning
    flight, adapter = adapted_flight(scenario("two_dead"), count=3, seconds=12.0)
    assert "3 of 4 degrees of freedom can be controlled" in caplog.text
    assert adapter.authority(0).thruster_rank == 3
    assert float(flight.position_error[:, flight.time[0] >= 10.0].mean()) < 0.15
