"""The training loop: stretches of flying and learning, each followed by an evaluation and a checkpoint.

For every stretch the fleet is made anew (20 ms), seeded by the number of the stretch, in broken and unbroken runs
alike. So a checkpoint needs nothing from inside the simulator, and a run that is killed and resumed ends with the
same policy, bit for bit. At the default length, one whole episode, this costs no transition.
"""

import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, cast

import torch
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs import EnvBase

from auv_torchrl.agents.config import AgentConfig
from auv_torchrl.agents.interrupt import Interrupted, interruptible
from auv_torchrl.agents.loggers import LoggerConfig, TrainingLog
from auv_torchrl.agents.progress import CurvePoint, CurveReport
from auv_torchrl.agents.score import Examiner, Score
from auv_torchrl.agents.storage import CheckpointError, load_checkpoint, save_checkpoint

CHECKPOINT = "checkpoint.pt"


class Diverged(FloatingPointError):
    """A loss that is no finite number; the message says what to do."""


class Trainer:
    """An agent on a fleet, on the device that the fleet is on.

    Args:
        make_fleet: the training fleet for a seed, randomization included.
        examine: mean and worst error of a policy from fixed starts.
        config: settings.
        seed: of everything random.
        folder: where the checkpoint and the learning curve go.
        fingerprint: of everything that shapes the policy; a checkpoint of another one is refused.
        logger: where the learning curve is logged beside ``progress.csv``; None for nowhere.
    """

    def __init__(
        self,
        make_fleet: Callable[[int], EnvBase],
        examine: Callable[..., Score],
        config: AgentConfig,
        seed: int,
        folder: Path,
        fingerprint: str,
        logger: LoggerConfig | None = None,
    ):
        # here, not above: a policy that was kept is read without all learners
        from auv_torchrl.agents.learning.learners import make_learner

        self.config, self.seed, self.folder, self.fingerprint = config, seed, folder, fingerprint
        self.logger = logger or LoggerConfig()
        self.examine = examine
        self.make_fleet = make_fleet
        torch.manual_seed(seed)
        fleet = make_fleet(seed)
        assert fleet.device is not None
        self.device = fleet.device
        self._generator = None if self.device.type == "cpu" else torch.get_device_module(self.device)
        observations, actions = fleet.observation_spec["observation"].shape[-1], fleet.action_spec.shape[-1]
        self.learner = make_learner(config, observations, actions, self.device)
        self.curve: list[CurvePoint] = []
        self.stretch = 0
        self.frames = 0
        self.critic_frames = 0
        self.start_m = math.inf

    def start_from(self, policy: TensorDictModuleBase, critic_frames: int) -> None:
        """Begin with the weights of a policy instead of random ones; it stays the best until a better one is found.

        Args:
            policy: of the same network.
            critic_frames: transitions until the actor moves: critics that know nothing would spoil it.
        """
        self.critic_frames = critic_frames
        self.learner.start_from(policy)
        self.start_m = self.examine(self.learner.best).mean_m

    def run(self) -> None:
        """Train to the end, from the beginning or from where :meth:`resume` left off.

        Raises:
            Interrupted: after Ctrl-C or SIGTERM, when the running stretch is over and its checkpoint written.
            Diverged: if a loss is no finite number; the checkpoint is the last one before.
        """
        config = self.config
        threads = torch.get_num_threads()
        torch.set_num_threads(1)  # tensors this small gain nothing from more, and lose much beside other processes
        progress = CurveReport(self.folder, config.stretches * config.stretch_frames, self.curve)
        logged = TrainingLog(self.logger, self.folder, self.fingerprint)
        try:
            with interruptible() as asked_to_stop:
                while not self.finished:
                    self._run_stretch(progress)
                    progress.report(self.curve)
                    self.save()
                    logged.point(self.curve[-1])
                    if signum := asked_to_stop():  # in the last stretch too: the next run finds it finished
                        raise Interrupted(
                            f"training stopped at {self.frames} transitions and saved to {self.folder / CHECKPOINT}: "
                            "run the same command to go on",
                            signum,
                        )
                if logged.video:
                    logged.film(*cast(Examiner, self.examine).film(self.learner.best), step=self.frames)
        finally:
            torch.set_num_threads(threads)
            progress.close()
            logged.close()

    @property
    def finished(self) -> bool:
        """Whether the last stretch is done or the error is below ``stop_below_m``."""
        goal = self.config.stop_below_m
        reached = goal is not None and bool(self.curve) and self.curve[-1]["best_m"] < goal
        return reached or self.stretch >= self.config.stretches

    def _run_stretch(self, progress: CurveReport) -> None:
        config = self.config
        wall, cpu = time.perf_counter(), time.process_time()
        rewards: list[Tensor] = []
        taught = None
        fleet = self.make_fleet(self.seed * 100_003 + self.stretch)
        for learnt in self.learner.learn(fleet, self.frames, self.critic_frames):
            self.frames += learnt.frames
            rewards.append(learnt.reward)
            progress.advance(learnt.frames)
            taught = taught if learnt.losses is None else learnt.losses
        losses = self._checked(taught)
        self.stretch += 1
        score = self.examine(self.learner.averaged)
        best_m = min([score.mean_m, self.start_m, *(point["best_m"] for point in self.curve[-1:])])
        if score.mean_m == best_m:
            self.learner.keep_best()
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        before = self.curve[-1] if self.curve else {"wall_s": 0.0, "cpu_s": 0.0}
        self.curve.append(
            dict(
                frames=self.frames,
                wall_s=before["wall_s"] + wall,
                cpu_s=before["cpu_s"] + cpu,
                episode_return=float(torch.stack(rewards).mean()) * config.stretch_steps,
                error_m=score.mean_m,
                worst_m=score.worst_m,
                best_m=best_m,
                **losses,
                frames_per_s=config.stretch_frames / wall,
            )
        )

    def _checked(self, taught: Mapping[str, Tensor] | None) -> dict[str, float]:
        """What the learner told of its last update, none of it where there was none."""
        if taught is None:
            return dict.fromkeys(self.learner.losses, math.nan)
        losses = {name: float(loss) for name, loss in taught.items()}
        if not all(math.isfinite(loss) for loss in losses.values()):
            found = ", ".join(f"{name} {loss:g}" for name, loss in losses.items())
            smaller = " or ".join(f"agent.{name}" for name in ("learning_rate", "gamma") if hasattr(self.config, name))
            raise Diverged(f"training diverged within {self.frames} transitions ({found}): give a smaller {smaller}")
        return losses

    def save(self) -> None:
        """Write the checkpoint."""
        save_checkpoint(self.folder / CHECKPOINT, self.fingerprint, self.state_dict())

    def resume(self, path: Path) -> None:
        """Go on from a checkpoint of the same training.

        Raises:
            CheckpointError: if it is missing, damaged or of another training.
        """
        state = load_checkpoint(path, self.fingerprint)
        try:
            self.load_state_dict(state)
        except (KeyError, TypeError, ValueError, RuntimeError, AttributeError, IndexError) as error:
            cause = " ".join(str(error).split())[:200]
            raise CheckpointError(
                f"checkpoint {path} does not fit this training ({type(error).__name__}: {cause}): it is left as it is; "
                "move it away to train from the beginning"
            ) from error

    def state_dict(self) -> dict[str, Any]:
        """Everything that the rest of the training depends on."""
        return {
            **self.learner.state_dict(),
            "random": torch.get_rng_state(),
            "random_on_device": None if self._generator is None else self._generator.get_rng_state(self.device),
            "curve": self.curve,
            "stretch": self.stretch,
            "frames": self.frames,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from :meth:`state_dict`."""
        self.learner.load_state_dict(state)
        torch.set_rng_state(state["random"])
        if self._generator is not None:
            self._generator.set_rng_state(state["random_on_device"], self.device)
        self.curve = list(state["curve"])
        self.stretch, self.frames = state["stretch"], state["frames"]
