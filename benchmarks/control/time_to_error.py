"""Time until the mean error from 64 fixed starts is below 0.05 m and 0.02 m: our agents and stable-baselines3's SAC.

    python -m benchmarks.control.time_to_error [--seeds 3] [--backend mujoco]

All learn on 64 vehicles of the same task with the same networks, and are examined in the backend after every 5120
transitions; the examinations do not count. Both SACs have the same learning rate, discount, batch size and number of
updates per transition; stable-baselines3 gets the vehicles through gymnasium's vector environment. CPU time counts,
because the machine may be shared. The policy gradient's kernels are compiled before.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict.nn import TensorDictModule

from auv_torchrl.agents.config import AgentConfig, SACConfig, load_agent_config
from auv_torchrl.agents.score import Score
from auv_torchrl.agents.train_source import make_examiner, make_trainer
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle

GOALS_M = (0.05, 0.02)
METHODS = ("ours, SAC", "ours, gradient", "stable-baselines3, SAC")
SEEDS = 3
TASK = StationKeeping(box_m=1.0)
Curve = Iterable[tuple[float, float, float]]  # CPU seconds, wall seconds, mean error in m


class Apart:
    """An examiner that measures its own time."""

    def __init__(self, examine: Callable[..., Score]):
        self.examine = examine
        self.spent = [(0.0, 0.0)]  # CPU and wall seconds so far, after each examination

    def __call__(self, policy: Any) -> Score:
        """Examine."""
        cpu, wall = time.process_time(), time.perf_counter()
        score = self.examine(policy)
        before = self.spent[-1]
        self.spent.append((before[0] + time.process_time() - cpu, before[1] + time.perf_counter() - wall))
        return score


def ours(config: AgentConfig, seed: int, backend: str) -> Curve:
    """Our trainer."""
    with tempfile.TemporaryDirectory() as folder:
        trainer = make_trainer(load_vehicle("paper"), TASK, config, None, seed, backend, Path(folder), "bench")
        trainer.examine = apart = Apart(trainer.examine)
        trainer.run()
    return [
        (point["cpu_s"] - cpu, point["wall_s"] - wall, point["error_m"])
        for point, (cpu, wall) in zip(trainer.curve, apart.spent[1:], strict=True)
    ]


def stable_baselines(config: SACConfig, seed: int, backend: str) -> Curve:
    """The same with stable-baselines3's SAC, up to the lower goal."""
    from stable_baselines3 import SAC  # pyright: ignore[reportMissingImports]

    vehicles = vehicles_for_stable_baselines(config.num_envs, backend)
    model = SAC(
        "MlpPolicy", vehicles, learning_rate=config.learning_rate, buffer_size=config.buffer_size,
        learning_starts=config.random_frames, batch_size=config.batch_size, tau=config.tau, gamma=config.gamma,
        train_freq=1, gradient_steps=config.updates_per_step, ent_coef=f"auto_{config.alpha_init}",
        target_entropy=config.target_entropy, policy_kwargs={"net_arch": list(config.hidden)}, seed=seed, device="cpu",
    )  # fmt: skip
    examine = Apart(make_examiner(load_vehicle("paper"), TASK, config, backend))
    policy = TensorDictModule(
        lambda observation: model.policy._predict(observation, deterministic=True), ["observation"], ["action"]
    )
    curve = []
    cpu, wall = time.process_time(), time.perf_counter()
    for _ in range(config.stretches):
        model.learn(config.stretch_frames, reset_num_timesteps=False)
        score: Score = examine(policy)
        apart = examine.spent[-1]
        curve.append((time.process_time() - cpu - apart[0], time.perf_counter() - wall - apart[1], score.mean_m))
        if score.mean_m < min(GOALS_M):
            break
    return curve


def vehicles_for_stable_baselines(count: int, backend: str) -> Any:
    """Gymnasium's vector environment as stable-baselines3 wants it."""
    import gymnasium
    from stable_baselines3.common.vec_env import VecEnv  # pyright: ignore[reportMissingImports]

    class Vehicles(VecEnv):
        def __init__(self) -> None:
            self.fleet = gymnasium.make_vec("auv_torchrl/Regulation-v0", count, backend=backend, task=TASK)
            super().__init__(count, self.fleet.single_observation_space, self.fleet.single_action_space)

        def reset(self) -> np.ndarray:
            return self.fleet.reset(seed=self._seeds[0])[0]

        def step_async(self, actions: np.ndarray) -> None:
            self.actions = actions

        def step_wait(self) -> tuple:
            observation, reward, terminated, truncated, info = self.fleet.step(self.actions)
            done, infos = terminated | truncated, [{} for _ in range(count)]
            for i in np.flatnonzero(done):
                infos[i] = {"terminal_observation": info["final_obs"][i], "TimeLimit.truncated": truncated[i]}
            return observation, reward, done, infos

        def close(self) -> None:
            self.fleet.close()

        def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
            return [False] * count

        def get_attr(self, attr_name: str, indices: Any = None) -> list:
            return [getattr(self.fleet, attr_name)] * count

        def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
            raise NotImplementedError("the bench sets nothing")

        def env_method(self, method_name: str, *arguments: Any, indices: Any = None, **options: Any) -> list:
            raise NotImplementedError("the bench calls nothing")

    return Vehicles()


def first_below(curve: Curve, goal: float) -> tuple[float, float]:
    """CPU and wall seconds of the first examination below ``goal``; infinite if there is none."""
    return next(((cpu, wall) for cpu, wall, error in curve if error < goal), (float("inf"), float("inf")))


def configs() -> tuple[AgentConfig, AgentConfig]:
    """Of SAC and of the policy gradient, examined often, and stopped at the last goal."""
    common = {"stop_below_m": min(GOALS_M), "stretch_steps": 80}
    return load_agent_config("sac", common), load_agent_config("gradient", common)


def measure(seeds: int, backend: str) -> dict[str, list[list[tuple[float, float]]]]:
    """Per method and seed, (CPU s, wall s) to each goal."""
    torch.set_num_threads(1)
    sac, gradient = configs()
    short = load_agent_config("gradient", {"stretch_steps": 16, "total_frames": 1, "evaluation_starts": 1})
    list(ours(short, 0, backend))  # compiles
    trained: list[tuple[Callable[..., Curve], AgentConfig]] = [(ours, sac), (ours, gradient), (stable_baselines, sac)]
    methods = dict(zip(METHODS, trained, strict=True))
    times: dict[str, list[list[tuple[float, float]]]] = {}
    for seed in range(seeds):  # in turn, so that a change in the machine's load strikes all methods alike
        for name, (train, config) in methods.items():
            print(f"{name}, seed {seed}", file=sys.stderr, flush=True)
            try:
                curve = list(train(config, seed, backend))
            except ModuleNotFoundError as error:
                print(f"{name} is left out: {error}: pip install 'auv-torchrl[bench]'\n")
                continue
            times.setdefault(name, []).append([first_below(curve, goal) for goal in GOALS_M])
    return times


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--backend", default="mujoco")
    options = parser.parse_args()
    times = measure(options.seeds, options.backend)
    print(f"Seconds until the mean error is below a goal, backend {options.backend}, one thread.\n")
    print("| method | seed | " + " | ".join(f"{goal:g} m, CPU | {goal:g} m, wall" for goal in GOALS_M) + " |")
    print("|---" * (2 + 2 * len(GOALS_M)) + "|")
    for method, by_seed in times.items():
        for seed, reached in enumerate(by_seed):
            print(f"| {method} | {seed} | " + " | ".join(f"{cpu:.1f} | {wall:.1f}" for cpu, wall in reached) + " |")
