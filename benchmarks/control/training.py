"""A whole training by ``agent=sac``: its gradients written out, TorchRL's own parts, and those compiled.

    python -m benchmarks.control.training [--seeds 3]

The kinds take turns, because the machine may be shared: what counts is how they compare. The compiled kind pays for its
compilation each time, as a run of ``train.py`` would.
"""

import argparse
import statistics
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.objectives import SACLoss

from auv_torchrl.agents.config import SACConfig, load_agent_config
from auv_torchrl.agents.learning.updater import SACUpdater, Updater
from auv_torchrl.agents.train_source import make_trainer
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle
from benchmarks.control.source import BACKEND, ranges


class Compiled(SACUpdater):
    """TorchRL's losses and target update through ``torch.compile``."""

    def __init__(self, loss: SACLoss, learning_rate: float, alpha_learning_rate: float, tau: float):
        super().__init__(loss, learning_rate, alpha_learning_rate, tau)
        torch.compiler.reset()
        self._losses, self._move = torch.compile(self._total), torch.compile(self.target_update.step)

    def _total(self, batch: TensorDictBase) -> tuple[Tensor, TensorDictBase]:
        losses = self.loss(batch)
        return losses["loss_actor"] + losses["loss_qvalue"] + losses["loss_alpha"], losses

    def step(self, batch: TensorDictBase, actor: bool = True) -> TensorDictBase:
        """As of every updater."""
        total, losses = self._losses(batch)
        self._descend(total if actor else losses["loss_qvalue"])
        self._move()
        return losses.detach()


@dataclass(frozen=True)
class CompiledSAC(SACConfig):
    """As ``loss: stock``, compiled."""

    def make_updater(self, observations: int, actions: int, device: torch.device) -> Updater:
        """Of actor, twin critics and temperature."""
        loss = self.make_loss(observations, actions, device)
        return Compiled(loss, self.learning_rate, self.alpha_learning_rate, self.tau)


KINDS = {"fused": (SACConfig, "fused"), "TorchRL": (SACConfig, "stock"), "TorchRL, compiled": (CompiledSAC, "stock")}


class Taken(NamedTuple):
    """What a training took, and how well its policy holds the examination's starts."""

    wall_s: float
    cpu_s: float
    error_m: float


def train(kind: str, seed: int, **changes: Any) -> Taken:
    """Train once; ``changes`` are settings of the agent."""
    settings, loss = KINDS[kind]
    agent = settings(**{**asdict(load_agent_config("sac")), "loss": loss, **changes})
    wall, cpu = time.perf_counter(), time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        trainer = make_trainer(
            load_vehicle("paper"), StationKeeping(), agent, ranges("paper"), seed, BACKEND, Path(folder), "benchmark"
        )
        trainer.run()
        return Taken(time.perf_counter() - wall, time.process_time() - cpu, trainer.curve[-1]["best_m"])


def table(flown: dict[str, list[Taken]]) -> str:
    """Medians over the seeds, and how many times the first kind's CPU time."""
    lines = ["| `agent=sac` with | wall s | CPU s | times | error [m] |", "|---|---|---|---|---|"]
    medians = {kind: Taken(*map(statistics.median, zip(*taken, strict=True))) for kind, taken in flown.items()}
    least = next(iter(medians.values())).cpu_s
    for kind, m in medians.items():
        lines.append(f"| {kind} | {m.wall_s:.1f} | {m.cpu_s:.1f} | {m.cpu_s / least:.2f} | {m.error_m:.4f} |")
    return "\n".join(lines)


def measure(seeds: int, **changes: Any) -> dict[str, list[Taken]]:
    """All kinds in turn, for each seed."""
    flown: dict[str, list[Taken]] = {kind: [] for kind in KINDS}
    for seed in range(seeds):
        for kind, taken in flown.items():
            taken.append(train(kind, seed, **changes))
            print(f"{kind}, seed {seed}: {taken[-1]}", file=sys.stderr, flush=True)
    return flown


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    torch.set_num_threads(1)
    print(f"Whole trainings, one thread, medians of {options.seeds} seeds that took turns.\n")
    print(table(measure(options.seeds)))
