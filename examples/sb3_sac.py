"""stable-baselines3's soft actor-critic on the native fleet: pip install '.[bench]' brings stable-baselines3.

python examples/sb3_sac.py [TRANSITIONS] [VEHICLES]
"""

import sys
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3 import SAC  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.vec_env import VecEnv  # pyright: ignore[reportMissingImports]

from auv_torchrl.envs import ID


class Fleet(VecEnv):
    """A fleet of gymnasium's vector interface as stable-baselines3 wants one: both reset in the step of an end."""

    def __init__(self, vehicles: int, **settings: Any) -> None:
        self.envs = gymnasium.make_vec(ID, num_envs=vehicles, **settings)
        super().__init__(vehicles, self.envs.single_observation_space, self.envs.single_action_space)

    def reset(self) -> np.ndarray:
        """Begin; stable-baselines3 gives a seed per vehicle, a fleet has one."""
        observation, _ = self.envs.reset(seed=self._seeds[0])
        self._reset_seeds()
        return observation

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for :meth:`step_wait`."""
        self.actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict]]:
        """Fly one control step."""
        observation, reward, terminated, truncated, info = self.envs.step(self.actions)
        done, self.position, infos = terminated | truncated, info["position"], [{} for _ in range(self.num_envs)]
        for row in np.flatnonzero(done):
            infos[row] = {"terminal_observation": info["final_obs"][row], "TimeLimit.truncated": truncated[row]}
        return observation, reward, done, infos

    def close(self) -> None:
        """End."""
        self.envs.close()

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No vehicle has a wrapper of its own."""
        return [False] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The fleet's, for every vehicle."""
        return [getattr(self.envs, attr_name)] * self.num_envs

    def _whole(self, *_: Any, **__: Any) -> Any:
        raise NotImplementedError("the vehicles are one fleet: set and call it as a whole, by envs")

    set_attr = env_method = _whole


def main(transitions: int = 51200, vehicles: int = 64) -> float:
    """Train; returns the mean distance in m to the target for t >= 10 s, from 50 starts."""
    torch.set_num_threads(1)  # networks this small gain nothing from more
    model = SAC(
        "MlpPolicy", Fleet(vehicles), learning_rate=lambda left: 3e-3 * left, gamma=0.9, tau=0.03, batch_size=128,
        gradient_steps=4, learning_starts=1000, policy_kwargs={"net_arch": [64, 64]}, seed=0, device="cpu",
    )  # fmt: skip
    model.learn(transitions)
    exam, errors = Fleet(50, task={"box_m": 1.0}), []
    exam.seed(1)
    now = exam.reset()
    for _ in range(399):  # of the 400 control steps of an episode
        now = exam.step(model.predict(now, deterministic=True)[0])[0]
        errors.append(np.linalg.norm(exam.position, axis=-1).mean())
    return float(np.mean(errors[200:]))


if __name__ == "__main__":
    print(f"mean distance to the target: {main(*map(int, sys.argv[1:])):.4f} m")
