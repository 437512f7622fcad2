"""Train the source policy u_s, or take it from the store if the same training was done before."""

import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch
from torchrl.envs import EnvBase, TransformedEnv

from auv_torchrl.agents.config import AgentConfig
from auv_torchrl.agents.loggers import LoggerConfig
from auv_torchrl.agents.policy import SourcePolicy, fingerprint, load_policy, save_policy
from auv_torchrl.agents.score import Examiner
from auv_torchrl.agents.storage import storing
from auv_torchrl.agents.trainer import CHECKPOINT, Trainer
from auv_torchrl.envs import RandomizeVehicle, make_fleet
from auv_torchrl.evaluation import draw_starts
from auv_torchrl.files import locked
from auv_torchrl.tasks import Task
from auv_torchrl.vehicle import Vehicle
from auv_torchrl.vehicle.changed_file import described

log = logging.getLogger(__name__)

EVALUATION_SEED = 314_159  # the starts that choose the best policy; reported results use others

_CAME_LATER = ("reaction", "compass_per_load")  # of a vehicle; left out where 0, so that policies kept before are found
_UNSEEN = {"volts", "accelerometer_bias", "accelerometer_position"}  # of a vehicle; no policy is told of them


def train_source(
    vehicle: Vehicle,
    task: Task,
    agent_config: AgentConfig,
    randomization: Mapping[str, Any] | None,
    seed: int,
    backend: str,
    folder: Path,
    device: torch.device | str = "cpu",
    logger: LoggerConfig | None = None,
) -> SourcePolicy:
    """The best policy of a training with these ingredients, on ``device``.

    A finished policy lies in ``folder/<hash>``, and is loaded from there instead of trained again. While it is
    trained, its checkpoint and learning curve lie in ``folder/<hash>.training``; if a run was killed, the next
    one goes on from there. The curve stays with the policy. Of several processes that want the same policy, one
    trains and the others wait.

    Args:
        vehicle: nominal vehicle, empty batch.
        task: task to train on.
        agent_config: settings of the training.
        randomization: ranges per effect, as in ``conf/randomization``; None or empty for none.
        seed: of everything random.
        backend: "mujoco" or "torch".
        folder: the store, for example ``outputs/policies``.
        device: of networks, transitions and fleets.
        logger: where the training is logged, if it is not taken from the store; None for ``progress.csv`` alone.

    Raises:
        CheckpointError: if the checkpoint is damaged or of another training.
        PolicyError: if the policy in the store is damaged, changed or of another training.
        StorageError: if the store is full or may not be written.
        Interrupted: after Ctrl-C, with the checkpoint written.
        Diverged: if a loss is no finite number.
    """
    ingredients = describe(vehicle, task, agent_config, randomization, seed, backend, device)

    def trainer(training: Path, key: str) -> Trainer:
        return make_trainer(vehicle, task, agent_config, randomization, seed, backend, training, key, device, logger)

    return kept_or_trained(ingredients, trainer, folder, device)


def kept_or_trained(
    ingredients: Mapping[str, Any], make: Callable[[Path, str], Trainer], folder: Path, device: torch.device | str
) -> SourcePolicy:
    """The policy of these ingredients from the store ``folder``, or trained now and put there.

    Args:
        ingredients: everything that shapes the policy, as plain values.
        make: the trainer, from the folder of its checkpoint and the hash of the ingredients.
        folder: the store.
        device: where the policy is to be, and is trained.

    Raises:
        CheckpointError, PolicyError, StorageError, Interrupted, Diverged: as :func:`train_source`.
    """
    key = fingerprint(ingredients)
    finished, training = folder / key, folder / f"{key}.training"
    left = f"the training so far is in {training}, if it had begun: the same command goes on from there"
    device = torch.device(device)
    others = [] if device.type == "cpu" else [device]
    with storing(folder, left), torch.random.fork_rng(others, device_type=device.type):
        if finished.exists():
            return _taken(finished, key, device)  # without a lock: a store that is read alone may be read-only
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder / f"{key}.lock", "trains the same source policy"):
            if finished.exists():  # by the process that was waited for
                return _taken(finished, key, device)
            return _trained(ingredients, make, finished, training, key)


def _taken(finished: Path, key: str, device: torch.device) -> SourcePolicy:
    policy = load_policy(finished, key)
    policy.module.to(device)
    log.info("policy %s: taken from %s, trained before", key, finished)
    return policy


def _trained(
    ingredients: Mapping[str, Any], make: Callable[[Path, str], Trainer], finished: Path, training: Path, key: str
) -> SourcePolicy:
    training.mkdir(exist_ok=True)
    trainer = make(training, key)
    checkpoint = training / CHECKPOINT
    if checkpoint.exists():
        trainer.resume(checkpoint)
        log.info("policy %s: going on from %s at %d transitions", key, checkpoint, trainer.frames)
    else:
        log.info("policy %s: training", key)
    trainer.run()
    policy = SourcePolicy(
        trainer.learner.best.eval(),
        {
            "hash": key,
            "ingredients": dict(ingredients),
            "network": trainer.learner.network,
            "result": {"best_m": trainer.curve[-1]["best_m"], "train_s": trainer.curve[-1]["wall_s"]},
            "curve": trainer.curve,
        },
    )
    save_policy(policy, finished, training)
    (finished / CHECKPOINT).unlink()
    log.info("policy %s: kept in %s", key, finished)
    return policy


def describe(
    vehicle: Vehicle,
    task: Task,
    agent_config: AgentConfig,
    randomization: Mapping[str, Any] | None,
    seed: int,
    backend: str,
    device: torch.device | str = "cpu",
) -> dict[str, Any]:
    """Everything that shapes a policy, as plain values."""
    kind = torch.device(device).type  # draws and rounds as others do not
    nothing = {name for name in _CAME_LATER if not bool((getattr(vehicle, name) != 0).any())} | _UNSEEN
    return {
        "vehicle": {name: value for name, value in described(vehicle).items() if name not in nothing},
        "task": task.described(),
        "agent": agent_config.shaping(),
        "randomization": dict(randomization or {}),
        "seed": seed,
        "backend": backend,
        **({} if kind == "cpu" else {"device": kind}),  # none for the CPU: so policies kept before are found
    }


def make_trainer(
    vehicle: Vehicle,
    task: Task,
    agent_config: AgentConfig,
    randomization: Mapping[str, Any] | None,
    seed: int,
    backend: str,
    folder: Path,
    key: str,
    device: torch.device | str = "cpu",
    logger: LoggerConfig | None = None,
) -> Trainer:
    """The trainer with its randomized training fleet and its examiner."""

    def training_fleet(fleet_seed: int) -> EnvBase:
        fleet = agent_config.make_fleet(backend, vehicle, task, fleet_seed, device)
        if not randomization:
            return fleet
        return TransformedEnv(fleet, RandomizeVehicle(vehicle, agent_config.ranges(randomization), seed=fleet_seed))

    examiner = make_examiner(vehicle, task, agent_config, backend, device=device)
    return Trainer(training_fleet, examiner, agent_config, seed, folder, key, logger)


def make_examiner(
    vehicle: Vehicle,
    task: Task,
    agent_config: AgentConfig,
    backend: str,
    around: Callable[[EnvBase], EnvBase] = lambda fleet: fleet,
    device: torch.device | str = "cpu",
) -> Examiner:
    """The vehicle, with ``around`` put around its fleet, from the starts by which the best policy is chosen."""
    exam = task.for_evaluation(agent_config.evaluation_box_m)
    count = agent_config.evaluation_starts
    starts = draw_starts(exam, count, EVALUATION_SEED).float()
    fleet = around(make_fleet(backend, vehicle, exam, count, seed=0, device=device))
    return Examiner(fleet, starts)
