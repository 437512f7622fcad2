"""MuJoCo against the plain model: the same accelerations, nearly the same flights, plus walls and pictures."""

from importlib import import_module

import numpy as np
import pytest
import torch
from flights import fly, held_actions, resting
from tensordict import TensorDict

from auv_torchrl.effects import get_effect
from auv_torchrl.envs import MujocoFleet, TorchFleet
from auv_torchrl.envs.start import BODY
from auv_torchrl.physics.hydrodynamics import acceleration
from auv_torchrl.physics.kernel import native
from auv_torchrl.physics.kinematics import matvec, rotation_matrix
from auv_torchrl.physics.thrusters import body_wrench
from auv_torchrl.simulator.mujoco import MujocoSimulator
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle

mujoco = import_module("mujoco")  # its types leave out the callbacks and what is compiled
VEHICLES = ["paper", "bluerov2", "bluerov2_heavy"]


def loaded(name):
    """A vehicle with off-centre mass, a payload and cross-coupled drag: nothing about it is diagonal."""
    vehicle = load_vehicle(name)
    changes = {
        "payload": {"mass": 3.0, "weight": 5.0, "x": 0.1, "y": -0.2, "z": 0.1},
        "mass_offset": {"x": 0.03, "y": -0.02},
        "drag_coupling": {"drag_yaw_from_sway": 5.0},
        "current": {"north": 0.2, "east": -0.1, "down": 0.05},
        "coriolis": {"strength": 1.0},
    }
    for effect, values in changes.items():
        vehicle = get_effect(effect).apply(vehicle, values)
    return vehicle


@pytest.mark.parametrize("name", VEHICLES)
def test_mujoco_accelerates_as_the_model_says(name):
    """Qacc equals the Fossen acceleration in MuJoCo's coordinates, to 1e-13 of its size, compiled and on numpy."""
    fleet = MujocoFleet(loaded(name), StationKeeping(start_tilt=1.0), 16, seed=0)
    fleet.reset()
    simulator = fleet.simulator
    assert isinstance(simulator, MujocoSimulator)
    c, terms, state = simulator.coefficients, simulator.terms, simulator.state
    simulator._write_bodies(state)
    thrust = np.random.default_rng(0).uniform(-30, 30, state.thrust.shape)
    wrench = body_wrench(c, terms, thrust, state.time)
    rotation = rotation_matrix(state.quaternion)
    rate = acceleration(c, terms, rotation, state.position, state.velocity, wrench)
    linear = matvec(rotation, rate[:, :3] + np.cross(state.velocity[:, 3:], state.velocity[:, :3]))
    expected = np.concatenate((linear, rate[:, 3:]), axis=-1)
    on_numpy = lambda *_: np.copyto(simulator._passive, simulator._force(c, terms, thrust, state.time))  # noqa: E731
    for call in (on_numpy, simulator._forces(c).callback(wrench[None])):
        mujoco.set_mjcb_passive(call)
        try:
            mujoco.mj_forward(simulator.physics.model.ptr, simulator.physics.data.ptr)
        finally:
            mujoco.set_mjcb_passive(None)
        found = simulator.physics.data.qacc.reshape(16, 6)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize(("name", "apart_m"), [("paper", 2e-4), ("bluerov2", 3e-2), ("bluerov2_heavy", 1e-2)])
def test_the_backends_stay_together_for_20_s(name, apart_m):
    """From starts at up to 2 m/s per axis, with random commands: how far the two integrators drift apart.

    0.06 mm for the paper's vehicle, which hardly tilts. MuJoCo's RK4 averages angular velocities of tilted
    frames, so that vehicles that tumble drift centimetres, MuJoCo away from a converged solution.
    """
    vehicle, task, count = load_vehicle(name), StationKeeping(), 12
    plain = TorchFleet(vehicle, task, count, seed=1, dtype=torch.float64)
    start, actions = plain.reset()["start"], held_actions(count, task.steps)
    one, other = fly(plain, actions, start), fly(MujocoFleet(vehicle, task, count, seed=1), actions, start)
    apart = (one["position"] - other["position"]).norm(dim=-1)
    assert one["position"].diff(dim=0).norm(dim=-1).sum(0).min() > 2.0, "the vehicles should have flown somewhere"
    assert apart.max() < apart_m


def test_the_callback_is_only_there_during_a_step(monkeypatch):
    """MuJoCo's process-wide callback is removed after a step, after a failed one too, so that models compile."""
    fleet = MujocoFleet(load_vehicle("paper"), StationKeeping(), 2, seed=0)
    action = TensorDict({"action": torch.zeros(2, 4)}, [2])
    fleet.reset()
    fleet.step(action)
    assert mujoco.get_mjcb_passive() is None
    monkeypatch.setenv(native.CHOICE, "numpy")
    fleet = MujocoFleet(load_vehicle("paper"), StationKeeping(), 2, seed=0)
    fleet.reset()
    monkeypatch.setattr(fleet.simulator, "_force", None)  # not callable: the next step fails inside the callback
    with pytest.raises(TypeError):
        fleet.step(action)
    assert mujoco.get_mjcb_passive() is None
    MujocoFleet(load_vehicle("paper"), StationKeeping(), 2, seed=0)


def test_two_fleets_do_not_disturb_each_other():
    """Steps of another fleet in between change nothing."""
    vehicle, task = load_vehicle("bluerov2"), StationKeeping()
    start, actions = resting(2, [0.3, 0.2, 0.1]), held_actions(2, 20)
    alone = fly(MujocoFleet(vehicle, task, 2, seed=0), actions, start)
    one, other = (MujocoFleet(vehicle, task, count, seed=0) for count in (2, 3))
    now = one.reset(TensorDict({"start": start}, [2]), set_state=True)
    other.reset()
    for action in actions:
        other.step(TensorDict({"action": torch.ones(3, 4)}, [3]))
        now = one.step(TensorDict({"action": action}, [2]))["next"]
    for key in BODY:
        assert torch.equal(now[key], alone[-1][key])


def test_walls_hold_a_vehicle_and_vehicles_pass_through_each_other():
    """Full surge towards the wall ends at the hull's half length before it; a second vehicle there is no obstacle."""
    task = StationKeeping(box_m=1.0, near_share=0.0)
    fleet = MujocoFleet(load_vehicle("paper"), task, 2, seed=0, walls=(1.5, 1.5, 1.5))
    actions = torch.tensor([[1.0, 0, 0, 0]] * 2).expand(160, 2, 4)
    path = fly(fleet, actions, resting(2, [0.0, 0.0, 0.0], [0.6, 0.0, 0.0]))
    ends = path["position"][-1, :, 0]
    torch.testing.assert_close(ends, torch.full((2,), 1.5 - 0.23), rtol=0, atol=0.02)
    free = fly(MujocoFleet(load_vehicle("paper"), task, 2, seed=0), actions, resting(2))
    assert free["position"][-1, 0, 0] > 2.0


def test_starts_outside_the_tank_are_refused():
    """A tank smaller than the start box is an error that says so."""
    with pytest.raises(ValueError, match="farther walls or a smaller box"):
        MujocoFleet(load_vehicle("paper"), StationKeeping(box_m=2.0), 1, walls=(2.0, 3.0, 3.0))


@pytest.mark.parametrize("fleet_class", [MujocoFleet, TorchFleet])
def test_the_camera_sees_the_vehicle_and_follows_it(fleet_class):
    """A picture has the asked size and the vehicle's blue floats in its middle, wherever it flies."""
    fleet = fleet_class(load_vehicle("bluerov2_heavy"), StationKeeping(box_m=2.0), 2, seed=0)
    fleet.reset()
    pictures = [fleet.render(row, size=(120, 200)) for row in (0, 1)]
    assert not np.array_equal(*pictures)
    for picture in pictures:
        assert picture.shape == (120, 200, 3) and picture.dtype == np.uint8
        red, _, blue = (picture[30:90, 50:150, channel].astype(int) for channel in range(3))
        assert ((blue > 150) & (red < 60)).mean() > 0.02
