"""The vehicle behind the link is the one that every other part of the package simulates."""

import numpy as np
import pytest
import torch

from auv_torchrl.link.plant import ZEROED_S, Plant, Start, longest_delay, to_earth
from auv_torchrl.physics.kinematics import rotation_matrix
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.sensors import SENSORS
from auv_torchrl.simulator import at_rest, simulate

EFFECTS = {
    "nominal": {},
    "a reversed thruster": {"thruster_gain": {"gain_1": -1.0}},
    "one that reverses in flight": {"thruster_gain": {"gain_1": -1.0, "start_s": 0.1, "stop_s": 0.4}},
    "a delay": {"command_delay": {"delay": 0.033}},
    "a delay in flight": {"command_delay": {"delay": 0.033, "start_s": 0.2}},
    "lag and current": {"thruster_lag": {"time_constant": 0.1}, "current": {"north": 0.2}},
    "sensors": {"depth_bias": {"offset": 0.1}, "pose_delay": {"delay": 0.05}, "gyro_bias": {"bias_p": 0.02}},
}


def pulses(steps, seed=0):
    """PWM (T, 8) that changes ten times a second, and the commands that it is."""
    drawn = np.random.default_rng(seed).integers(1100, 1901, (steps // 40 + 1, 8)).repeat(40, axis=0)[:steps]
    return drawn, (drawn - 1500) / 400


@pytest.mark.parametrize("name", EFFECTS)
def test_the_link_flies_what_simulate_flies(wire, vehicle, name):
    """States and reports to 1e-9, through the bytes of the protocol."""
    scenario = read_scenario("test", {"effects": EFFECTS[name]}, vehicle)
    pwm, commands = pulses(240)
    link = wire(EFFECTS[name], down=1.0, yaw=0.5)
    told = [link.send(frame, (*pwm[frame], *(1500,) * 8)) for frame in range(240)]
    start = at_rest(np.array([[0.0, 0.0, 1.0]]), np.array([0.5]), 8)
    expected = simulate(vehicle, commands[None], np.arange(241) / 400, start, scenario)
    reported = expected.reported
    np.testing.assert_allclose([t.position for t in told], reported.position[0, 1:], rtol=0, atol=1e-9)
    np.testing.assert_allclose([t.quaternion for t in told], reported.quaternion[0, 1:], rtol=0, atol=1e-9)
    np.testing.assert_allclose([t.gyro for t in told], reported.velocity[0, 1:, 3:], rtol=0, atol=1e-9)
    rotation = rotation_matrix(expected.states[0, 1:, 3:7])
    velocity = np.einsum("tij,tj->ti", rotation, reported.velocity[0, 1:, :3])
    np.testing.assert_allclose([t.velocity for t in told], velocity, rtol=0, atol=1e-9)
    truth = np.concatenate(link.lockstep.plant.moment.state, axis=-1)
    np.testing.assert_allclose(truth, expected.states[:, -1], rtol=0, atol=1e-9)


def test_an_effect_acts_from_its_time_on(wire):
    """Ahead with thruster 1 reversed from 0.5 s on: until then the vehicle is the healthy one, then it turns."""
    ahead = (1400, 1400, 1600, 1600, *(1500,) * 12)
    healthy, broken = wire(), wire({"thruster_gain": {"gain_1": -1.0, "start_s": 0.5}})
    rates = [(healthy.send(frame, ahead).gyro[2], broken.send(frame, ahead).gyro[2]) for frame in range(400)]
    first = next(frame for frame, (one, other) in enumerate(rates) if one != other)
    assert first == 200
    assert abs(rates[-1][1]) > 0.1 > abs(rates[-1][0])


def test_a_firmware_that_starts_anew_meets_the_scenario_from_its_start(wire):
    """The times of effects count from where the vehicle was placed."""
    link = wire({"thruster_gain": {"gain_1": -1.0, "start_s": 0.02}})
    first = [link.send(frame, (1400,) * 16) for frame in range(20)]
    assert [link.send(frame, (1400,) * 16) for frame in range(20)] == first


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_a_vehicle_that_hovers_measures_gravity_alone(vehicle, yaw):
    """At rest, level and weightless in the water: 9.81 m/s^2 up, no rates and no speed, as long as it is left alone."""
    weightless = vehicle.replace(buoyancy=vehicle.mass * 9.81)
    plant = Plant(weightless, Scenario("nominal"), Start(down=3.0, yaw=yaw))
    for _ in range(100):
        plant.step([0.0] * 8, 1 / 400)
        reading = plant.reading()
        np.testing.assert_allclose(reading.specific_force, (0, 0, -9.81), atol=1e-9)
        np.testing.assert_allclose((*reading.gyro, *reading.velocity), 0.0, atol=1e-9)
        assert reading.position == pytest.approx((0.0, 0.0, 3.0), abs=1e-9)


def test_the_specific_force_is_that_of_the_motion(vehicle):
    """Summed up along the earth's axes, with gravity, it is the change of the velocity; a step is 2.5 ms."""
    plant = Plant(vehicle, Scenario("nominal"), Start())
    _, commands = pulses(200, seed=1)
    velocity = np.zeros(3)
    before = plant.reading().quaternion
    for command in commands:
        plant.step(command.tolist(), 1 / 400)
        after = plant.reading().quaternion
        halfway = np.add(before, after) / np.linalg.norm(np.add(before, after))
        velocity += (rotation_matrix(halfway) @ plant.reading().specific_force + (0, 0, 9.81)) / 400
        before = after
    np.testing.assert_allclose(velocity, plant.reading().velocity, atol=2e-4)


def test_the_specific_force_is_that_of_the_instrument(vehicle):
    """Of an accelerometer off the origin and with an offset, however the vehicle tumbles."""
    mounted = vehicle.replace(
        accelerometer_position=vehicle.accelerometer_position + np.array([0.1, -0.05, 0.2]),
        accelerometer_bias=vehicle.accelerometer_bias + np.array([0.3, 0.0, -0.1]),
    )
    plant = Plant(mounted, Scenario("nominal"), Start())
    for command in pulses(400, seed=2)[1]:
        plant.step(command.tolist(), 0.02)
        np.testing.assert_allclose(plant.moment.specific_force, plant.simulator.felt()[0], atol=1e-9)
    assert np.abs(plant.moment.state[1][0, 1:]).max() > 0.3


def test_a_delay_stays_one_whatever_the_rate(vehicle):
    """Commands arrive when they should while the rate comes down from 700 to 400 Hz, to a step."""
    scenario = read_scenario(
        "test", {"effects": {"command_delay": {"delay": 0.3}, "pose_delay": {"delay": 0.2}}}, vehicle
    )
    late, nominal = (Plant(vehicle, acting, Start()) for acting in (scenario, Scenario("nominal")))
    assert longest_delay(vehicle, scenario) == pytest.approx(0.3)
    arrived = {}
    for step in range(500):
        rate = max(400, 700 - step)
        time_s = late.moment.time_s
        command = [0.5 if time_s >= 0.3 else 0.0] * 8
        for name, plant in (("late", late), ("nominal", nominal)):
            plant.step(command, 1 / rate)
            if plant.moment.thrust.any():
                arrived.setdefault(name, plant.moment.time_s)
    assert arrived["late"] - arrived["nominal"] == pytest.approx(0.3, abs=0.004)
    told, was = late.reading().position, late._past.poses(200, 0.001)[0, -2, :3]
    assert told == pytest.approx(was.tolist(), abs=2e-3)


def test_noise_of_sensors_reaches_the_firmware_and_not_the_vehicle(wire):
    """One draw for each frame, and the same again after a restart."""
    noisy, quiet = wire({"sensor_noise": {"position": 0.05}}), wire()
    told = [(noisy.send(frame), quiet.send(frame)) for frame in range(50)]
    assert 0.03 < np.std([one.position[0] - other.position[0] for one, other in told]) < 0.08
    for one, other in zip(noisy.lockstep.plant.moment.state, quiet.lockstep.plant.moment.state, strict=True):
        np.testing.assert_array_equal(one, other)
    assert noisy.send(0) == told[0][0]


def test_a_vehicle_that_diverges_stays_finite(vehicle):
    """It stays where it was, and its clock goes on."""
    light = vehicle.replace(full_thrust=vehicle.full_thrust * 1e6, limit=vehicle.limit * 1e6)
    plant = Plant(light, Scenario("nominal"), Start())
    assert any([plant.step([1.0] * 8, 0.05) for _ in range(5)])
    assert plant.moment.time_s == pytest.approx(0.25)
    assert np.isfinite(np.concatenate(plant.reading()[1:])).all()


def test_a_vector_of_the_body_is_turned_as_by_the_matrix():
    """By number instead of by arrays."""
    quaternions = torch.nn.functional.normalize(torch.randn(20, 4, dtype=torch.float64, generator=torch.manual_seed(0)))
    for quaternion in quaternions.numpy():
        expected = rotation_matrix(quaternion) @ (1.0, -2.0, 3.0)
        np.testing.assert_allclose(to_earth(quaternion.tolist(), (1.0, -2.0, 3.0)), expected, atol=1e-12)


def test_sensors_from_outside_the_package_are_asked(plant, monkeypatch):
    """One of them may be the accelerometer."""
    own = plant()
    monkeypatch.setattr(type(SENSORS), "extended", property(lambda registry: True))
    monkeypatch.setattr(own.simulator, "felt", lambda: np.array([[1.0, 2.0, 3.0]]))
    own.step([0.0] * 8, 0.01)
    assert own.reading().specific_force == (1.0, 2.0, 3.0)


def test_an_effect_sets_in_at_its_time_at_any_rate(plant):
    """Also where the step becomes longer just before."""
    own = plant({"thruster_gain": {"gain": 0.0, "start_s": 0.5, "stop_s": 1.0}})
    acts = []
    for step_s in (*[0.0025] * 190, *[0.05] * 20):
        own.step([0.5] * 8, step_s)
        acts.append((own.moment.time_s - step_s / 2, bool((own.moment.thrust == 0).all())))
    assert all(dead is (0.5 <= middle < 1.0) for middle, dead in acts)


def test_a_vehicle_that_is_held_is_let_down_and_waits_for_a_command(plant):
    """At the surface first, then down without a jolt, and there until a thruster is driven; after a reset again."""
    held = plant(down=4.0, held=True)
    for _ in range(2):
        seen = []
        while held.moment.time_s < held.start.let_down_s + 5.0:
            held.step([0.0] * 8, 0.025)
            seen.append((held.moment.time_s, held.reading().position[2], held.reading().velocity[2]))
        time_s, down, sinking = np.array(seen).T
        assert (down[time_s < ZEROED_S] == 0.0).all() and (down[time_s > held.start.let_down_s] == 4.0).all()
        np.testing.assert_allclose(np.gradient(down, time_s), sinking, atol=0.02)
        assert held.reading().specific_force == pytest.approx((0.0, 0.0, -9.81))
        for _ in range(40):
            held.step([0.0] * 4 + [1.0] * 4, 0.025)
        assert held.moment.state[0][0, 2] > 4.1
        held.reset()
    fallen = plant({"payload": {"weight": 50.0}}, down=4.0)
    for _ in range(40):
        fallen.step([0.0] * 8, 0.025)
    assert fallen.moment.state[0][0, 2] > 4.05


def test_a_compass_that_is_off_turns_no_speed_over_ground(plant):
    """ArduSub makes its GPS of position and speed, its compass of the attitude."""
    turned, sound = plant({"heading_bias": {"angle": 0.5}}), plant()
    for vehicle in (turned, sound):
        for _ in range(200):
            vehicle.step([-0.5, -0.5, 0.5, 0.5, *[0.0] * 4], 1 / 400)
    assert turned.reading().velocity == sound.reading().velocity and sound.reading().velocity[0] > 0.1
    assert turned.reading().position == sound.reading().position
    assert turned.reading().quaternion != sound.reading().quaternion
