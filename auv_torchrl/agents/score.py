"""How well a policy does its task: its mean miss late in the episode, from fixed starts."""

from typing import Any, NamedTuple

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs import EnvBase, step_mdp

from auv_torchrl.envs.fleet import FleetEnv
from auv_torchrl.envs.start import BODY
from auv_torchrl.evaluation import STEADY_FROM_S, task_of

SHOWN_EVERY = 2  # control steps between two pictures of a film


class Score(NamedTuple):
    """Mean over the starts and worst start of what the task calls a miss, on the mean for t >= 10 s, in m."""

    mean_m: float
    worst_m: float


class Examiner:
    """Flies a fleet from the same starts every time."""

    def __init__(self, fleet: EnvBase, starts: TensorDictBase):
        self.fleet, self.task = fleet, task_of(fleet)
        self.bare = isinstance(fleet, FleetEnv)  # transforms may read more of the last step than what it led to
        self.starts = TensorDict({"start": starts}, batch_size=fleet.batch_size)
        self.first = round(min(STEADY_FROM_S / self.task.control_dt, self.task.steps / 2))

    @torch.no_grad()
    def __call__(self, policy: TensorDictModuleBase) -> Score:
        """Fly one episode without exploration."""
        state = self.fleet.reset(self.starts.clone(), set_state=True)
        errors = []
        for step in range(self.task.steps):
            state = self.fleet.step(policy(state))
            if step >= self.first:
                position, quaternion, velocity = (state["next", key] for key in BODY)
                errors.append(self.task.miss(position, quaternion, velocity, state["next", "along"][..., 0]))
            state = state["next"] if self.bare else step_mdp(state)
        error = torch.stack(errors).mean(0)
        return Score(float(error.mean()), float(error.max()))

    @torch.no_grad()
    def film(self, policy: TensorDictModuleBase) -> tuple[Tensor, float]:
        """Pictures (T, 3, height, width), uint8, of one episode of the first start, and how many there are a second."""
        state, pictures = self.fleet.reset(self.starts.clone(), set_state=True), []
        camera: Any = self.fleet  # of a fleet, which transforms hand on
        for step in range(self.task.steps):
            if step % SHOWN_EVERY == 0:
                pictures.append(torch.from_numpy(camera.render().copy()).permute(2, 0, 1))
            state = step_mdp(self.fleet.step(policy(state)))
        return torch.stack(pictures), 1.0 / (SHOWN_EVERY * self.task.control_dt)
