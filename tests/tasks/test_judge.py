"""What is compiled of a task is what the task says, and tasks of one's own are left alone."""

from dataclasses import dataclass

import numpy as np
import pytest
import torch

from auv_torchrl.physics.kernel import native
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.tasks.judge import Judge

ACTIONS = 4


def drawn(rows, dtype):
    """Position, quaternion, velocity and action; the last quaternions are upside down and about a vertical bow."""
    generator = torch.Generator().manual_seed(0)
    position, quaternion, velocity, action = (
        torch.randn(rows, size, generator=generator, dtype=torch.float64).to(dtype) for size in (3, 4, 6, ACTIONS)
    )
    quaternion[-2:] = torch.tensor([[0.0, 1.0, 0.0, 0.0], [0.5**0.5, 0.0, 0.5**0.5, 0.0]])
    return position, quaternion, velocity, action


@pytest.mark.parametrize("rows", [3, 64])
@pytest.mark.parametrize(("dtype", "close"), [(torch.float64, 1e-12), (torch.float32, 1e-5)])
@pytest.mark.parametrize("library", [torch.as_tensor, np.asarray], ids=["torch", "numpy"])
@pytest.mark.parametrize("tilt", [True, False])
def test_compiled_observation_and_reward_are_the_written_ones(rows, dtype, close, library, tilt):
    """Of states anywhere, on both array libraries, in both precisions, rows apart in memory too."""
    task = StationKeeping(tilt=tilt, near_scale_m=0.3)
    judge = Judge(task, ACTIONS)
    whole = [library(part) for part in drawn(2 * rows, dtype)]
    for every in (1, 2):
        position, quaternion, velocity, action = (part[::every] for part in whole)
        time = position[:, 0]
        for ours, theirs in (
            (judge.observe(position, quaternion, velocity, time), task.observe(position, quaternion, velocity, time)),
            (
                judge.reward(position, quaternion, velocity, action, time),
                task.reward(position, quaternion, velocity, action, time),
            ),
        ):
            assert type(ours) is type(theirs) and ours.dtype == theirs.dtype and ours.shape == theirs.shape
            np.testing.assert_allclose(ours, theirs, rtol=close, atol=close)


def test_numpy_is_asked_for(monkeypatch):
    """Where the variable says numpy, the task itself is called."""
    monkeypatch.setenv(native.CHOICE, "numpy")
    monkeypatch.setattr(native, "_linked", None)
    task = StationKeeping()
    position, quaternion, velocity, _ = drawn(3, torch.float64)
    seen = Judge(task, ACTIONS).observe(position, quaternion, velocity, position[:, 0])
    assert torch.equal(seen, task.observe(position, quaternion, velocity, position[:, 0]))


def test_gradients_flow_through_the_written_one():
    """Where a gradient is wanted, the task itself is called."""
    position, quaternion, velocity, action = drawn(3, torch.float64)
    position.requires_grad_()
    reward = Judge(StationKeeping(), ACTIONS).reward(position, quaternion, velocity, action, velocity[:, 0])
    (slope,) = torch.autograd.grad(reward.sum(), position)
    assert slope.isfinite().all() and (slope != 0).any()


def test_a_task_of_ones_own_is_not_compiled_unless_it_says_so():
    """A class that inherits from one that is compiled may do what cannot be compiled."""

    @dataclass(frozen=True)
    class Sorted(StationKeeping):
        def observe(self, position, quaternion, velocity, time):
            return super().observe(position, quaternion, velocity, time).sort(dim=-1).values

    position, quaternion, velocity, _ = drawn(3, torch.float64)
    seen = Judge(Sorted(), ACTIONS).observe(position, quaternion, velocity, velocity[:, 0])
    assert (seen.diff(dim=-1) >= 0).all()
