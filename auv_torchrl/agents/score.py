"""How well a policy regulates: its mean position error late in the episode, from fixed starts."""

from typing import NamedTuple

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torchrl.envs import EnvBase, step_mdp

from auv_torchrl.envs.fleet import FleetEnv
from auv_torchrl.evaluation import STEADY_FROM_S, task_of


class Score(NamedTuple):
    """Mean over the starts and worst start of the mean position error for t >= 10 s, in m."""

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
                wanted = self.task.reference(state["next", "along"][..., 0]).position
                errors.append((state["next", "position"] - wanted).norm(dim=-1))
            state = state["next"] if self.bare else step_mdp(state)
        error = torch.stack(errors).mean(0)
        return Score(float(error.mean()), float(error.max()))
