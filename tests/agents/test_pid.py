"""The classical controller regulates, and its integral takes away what a constant force leaves."""

import math

import pytest
import torch
from tensordict import TensorDict

from auv_torchrl.agents.config import load_agent_config
from auv_torchrl.agents.pid import PID
from auv_torchrl.agents.train_source import make_examiner
from auv_torchrl.effects import get_effect
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle

TASK = StationKeeping(box_m=1.0)
FEW = load_agent_config("sac", {"evaluation_starts": 8, "evaluation_box_m": 1.0})


@pytest.mark.parametrize("name", ["paper", "bluerov2"])
def test_pid_regulates(name):
    """From starts in +-1 m it stays within 0.02 m, dead band included."""
    score = make_examiner(load_vehicle(name), TASK, FEW, "mujoco")(PID(TASK))
    assert score.worst_m < 0.02


def test_integral_cancels_a_constant_force():
    """A vehicle that is 40 N too heavy hangs lower with PD than with PID."""
    heavy = get_effect("buoyancy").apply(load_vehicle("paper"), {"force": 40.0})
    examine = make_examiner(heavy, TASK, FEW, "mujoco")
    without, with_integral = examine(PID(TASK)), examine(PID(TASK, integral=(0.0, 0.0, 2.0, 0.0)))
    assert with_integral.mean_m < 0.5 * without.mean_m


def test_integral_starts_anew_with_every_episode():
    """The same starts give the same flight, whatever was flown before."""
    examine = make_examiner(load_vehicle("paper"), TASK, FEW, "mujoco")
    controller = PID(TASK, integral=(1.0, 1.0, 1.0, 0.1))
    assert examine(controller) == examine(controller)


def test_gains_that_cannot_be_are_refused():
    """The error names the gains and the degrees of freedom."""
    for gains in ((1.0, 1.0), (1.0, 1.0, -1.0, 1.0), (1.0, 1.0, float("nan"), 1.0)):
        with pytest.raises(ValueError, match="proportional.*surge, sway, heave, yaw"):
            PID(TASK, proportional=gains)


def test_command_is_full_and_points_home():
    """Far ahead of the vehicle the target asks for full surge, and a target to port for turning that way."""
    quarter = math.sqrt(0.5)
    measured = {
        "position": torch.tensor([[-5.0, 0.0, 0.0], [0.0, 0.0, 0.0]]),
        "quaternion": torch.tensor([[1.0, 0.0, 0.0, 0.0], [quarter, 0.0, 0.0, quarter]]),  # the second looks east
        "velocity": torch.zeros(2, 6),
    }
    state = TensorDict({"measured": measured, "time": torch.zeros(2, 1), "along": torch.zeros(2, 1)}, batch_size=[2])
    action = PID(TASK)(state)["action"]
    assert action[0].tolist() == [1.0, 0.0, 0.0, 0.0]
    assert action[1, 3] < 0 and (action[1, :3] == 0).all()


def test_a_reference_that_moves_is_followed():
    """A vehicle at the origin pushes towards where it should be now, by 10 full commands per metre."""

    class Ahead(StationKeeping):
        def reference(self, time):
            return super().reference(time)._replace(position=torch.stack((time, 0 * time, 0 * time), dim=-1))

    at_origin = {"position": torch.zeros(1, 3), "quaternion": torch.eye(1, 4), "velocity": torch.zeros(1, 6)}
    times = {"time": torch.full((1, 1), 0.01), "along": torch.full((1, 1), 0.02)}
    state = TensorDict({"measured": at_origin, **times}, batch_size=[1])
    torch.testing.assert_close(PID(Ahead())(state)["action"], torch.tensor([[0.2, 0.0, 0.0, 0.0]]))
