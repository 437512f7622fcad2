"""SAC updates per CPU second on one thread: ours, TorchRL's stock loss and stable-baselines3, same networks and batch.

python -m benchmarks.control.sac_updates [--hidden 64] [--batch 256] [--updates 400]
"""

import argparse
import time
from collections.abc import Callable

import torch
from tensordict import TensorDict
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer

from auv_torchrl.agents.learning.losses import make_loss
from auv_torchrl.agents.learning.updater import SACUpdater

OURS = {"ours, fused": "fused", "ours, stock": "stock"}  # by their names in the table, the kinds of their loss
THEIRS = "stable-baselines3"
OBSERVATIONS, ACTIONS, STORED = 15, 4, 100_000


def ours(kind: str, hidden: int, batch: int) -> Callable[[int], None]:
    """Sample from a TorchRL replay buffer and update, ``kind`` "fused" or "stock"."""
    loss = make_loss(kind, OBSERVATIONS, ACTIONS, (hidden, hidden), 0.97, -4.0, 0.1)
    updater = SACUpdater(loss, 1e-3, 1e-3, 0.01)
    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(STORED), batch_size=4 * batch)
    buffer.extend(
        TensorDict(
            {
                "observation": torch.randn(STORED, OBSERVATIONS),
                "action": torch.rand(STORED, ACTIONS) * 2 - 1,
                "next": {
                    "observation": torch.randn(STORED, OBSERVATIONS),
                    "reward": torch.randn(STORED, 1),
                    "done": torch.zeros(STORED, 1, dtype=torch.bool),
                    "terminated": torch.zeros(STORED, 1, dtype=torch.bool),
                },
            },
            [STORED],
        )
    )

    def update(count: int) -> None:
        for _ in range(count // 4):
            for part in buffer.sample().split(batch):
                updater.step(part)

    return update


def stable_baselines(hidden: int, batch: int) -> Callable[[int], None]:
    """The same with stable-baselines3's SAC, its replay buffer included."""
    import gymnasium
    import numpy as np
    from stable_baselines3 import SAC  # pyright: ignore[reportMissingImports]
    from stable_baselines3.common.logger import configure  # pyright: ignore[reportMissingImports]

    class Spaces(gymnasium.Env):
        observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (OBSERVATIONS,), np.float32)
        action_space = gymnasium.spaces.Box(-1, 1, (ACTIONS,), np.float32)

    policy = {"net_arch": [hidden, hidden]}
    model = SAC("MlpPolicy", Spaces(), learning_rate=1e-3, batch_size=batch, policy_kwargs=policy, device="cpu")
    model.set_logger(configure(None, []))
    rng = np.random.default_rng(0)
    assert model.replay_buffer is not None
    for _ in range(10_000):
        observation, following = rng.normal(size=(2, 1, OBSERVATIONS)).astype(np.float32)
        action = rng.uniform(-1, 1, (1, ACTIONS)).astype(np.float32)
        model.replay_buffer.add(observation, following, action, rng.normal(size=1), np.zeros(1), [{}])
    return lambda count: model.train(gradient_steps=count, batch_size=batch)


def seconds(update: Callable[[int], None], updates: int) -> float:
    """CPU seconds of so many updates."""
    start = time.process_time()
    update(updates)
    return time.process_time() - start


def measure(hidden: int = 64, batch: int = 256, updates: int = 400, rounds: int = 5) -> dict[str, float]:
    """Updates per CPU second of each, the best of rounds in which all take turns: the machine may be shared.

    Without stable-baselines3 where it is not installed.
    """
    torch.set_num_threads(1)
    torch.manual_seed(0)
    methods = {name: ours(kind, hidden, batch) for name, kind in OURS.items()}
    try:
        methods[THEIRS] = stable_baselines(hidden, batch)
    except ModuleNotFoundError:
        print("stable-baselines3 is not installed: pip install 'auv-torchrl[bench]'\n")
    for update in methods.values():
        update(updates // 4)
    taken = [{name: seconds(update, updates) for name, update in methods.items()} for _ in range(rounds)]
    return {name: updates / min(each[name] for each in taken) for name in methods}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--hidden", type=int, default=64)
    parser.add_argument("--batch", type=int, default=256)
    parser.add_argument("--updates", type=int, default=400)
    options = parser.parse_args()
    rates = measure(options.hidden, options.batch, options.updates)
    reference = rates.get(THEIRS, float("nan"))
    print(f"Updates per CPU second on one thread, networks 2 x {options.hidden}, batch {options.batch}.\n")
    print("| method | updates/s | times stable-baselines3 |\n|---|---|---|")
    for name, value in rates.items():
        print(f"| {name} | {value:.0f} | {value / reference:.2f} |")
