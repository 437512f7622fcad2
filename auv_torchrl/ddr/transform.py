"""What stands between a policy and a fleet: a map of its actions to commands, as a TorchRL transform."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, cast

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Bounded, Composite, TensorSpec
from torchrl.envs.transforms import Compose, Transform

from auv_torchrl.envs.start import BODY, EXPECTED, MEASURED, expected_along
from auv_torchrl.quantities import counted
from auv_torchrl.tasks import Task

ACTION, APPLIED, OBSERVATION = "action", "applied_action", "observation"


class CommandMap(Transform):
    """Turns the actions of a policy (N, a) into commands (N, k), and reports those as ``applied_action``.

    ``out_keys_inv`` are the entries that the map reads before a step: the policy's action, which the rollout keeps, and
    what is measured of the vehicle. Another first entry may be set before the map goes into an environment. The
    environment takes the commands under ``in_keys_inv``. A map leaves ``observation`` as it is.

    Commands are finite and within [-1, 1] whatever the policy or a measurement says: an action that is not a number
    becomes no thrust.

    Around a ``SerialEnv`` or ``ParallelEnv`` of K fleets the batch is (K, N), and a map has K N vehicles as rows. There
    it learns in the process of whoever steps the environment. In a worker of its own (a fleet with a map inside, or a
    collector in another process) it learns there, and comes back by ``state_dict``.

    Args:
        reads: entries of ``("measured", ...)`` that the map needs beside the action.
        reports: entries that it writes beside ``applied_action``.
    """

    def __init__(self, reads: Sequence[str] = (), reports: Sequence[str] = ()) -> None:
        measured = [(MEASURED, key) for key in reads]
        super().__init__(
            in_keys=[], out_keys=[APPLIED, *reports], in_keys_inv=[ACTION], out_keys_inv=[ACTION, *measured]
        )

    @property
    @abstractmethod
    def outputs(self) -> int:
        """Number of commands k."""

    @property
    @abstractmethod
    def channels(self) -> int:
        """Number of channels a that a policy acts in."""

    @abstractmethod
    def command(self, action: Tensor, *measured: Tensor) -> Tensor:
        """Commands (N, k) for actions (N, a) of the policy and what ``out_keys_inv`` names behind them, (N, ...)."""

    def begin(self, rows: Tensor, tensordict: TensorDictBase) -> None:
        """Called when episodes begin in some rows, (r,); may write to ``tensordict``; does nothing."""

    def after_step(self, command: Tensor, before: TensorDictBase, after: TensorDictBase) -> None:
        """Called after every step with the commands (N, k) that were executed; may write to ``after``; does nothing."""

    @torch.no_grad()
    def _inv_apply_transform(self, state: Tensor, *measured: Tensor) -> Tensor:
        return self.command(state, *measured)

    def _inv_call(self, tensordict: TensorDictBase) -> TensorDictBase:
        rows, (executed,) = _rows(tensordict), self.in_keys_inv
        command = self._inv_apply_transform(*(rows.get(key) for key in self.out_keys_inv))
        return tensordict.set(executed, command.reshape(*tensordict.batch_size, -1))

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        before, after = _rows(tensordict), _rows(next_tensordict)
        command = before.get(self.in_keys_inv[0])  # what _inv_call made of it
        with torch.no_grad():
            self.after_step(command, before, after)
        return _as_batch(after.set(APPLIED, command), next_tensordict)

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        reset = _rows(tensordict_reset)
        observation = reset.get(OBSERVATION)
        mask = None if tensordict is None else tensordict.get("_reset", None)
        rows = torch.arange(len(observation)) if mask is None else mask.reshape(-1).cpu().nonzero()[:, 0]
        self.begin(rows, reset)
        return _as_batch(reset.set(APPLIED, observation.new_zeros(len(observation), self.outputs)), tensordict_reset)

    def transform_action_spec(self, action_spec: TensorSpec) -> TensorSpec:
        """The policy acts in the channels, whatever the vehicle takes."""
        spec, (key,), wanted = cast(Composite, action_spec), self.in_keys_inv, self.out_keys_inv[0]
        executed = spec[key]
        if executed.shape[-1] != self.outputs:
            raise ValueError(
                f"{type(self).__name__}: it gives {counted(self.outputs, 'command')}, the environment takes "
                f"{executed.shape[-1]}: a map to the thrusters needs a task with "
                "thruster_commands=True, a map to the channels one without"
            )
        del spec[key]
        spec[wanted] = _commands(executed, self.channels)
        return spec

    def transform_observation_spec(self, observation_spec: TensorSpec) -> TensorSpec:
        """Declare ``applied_action``."""
        spec = cast(Composite, observation_spec)
        spec[APPLIED] = _commands(spec[OBSERVATION], self.outputs)
        return observation_spec

    def forward(self, tensordict: TensorDictBase) -> Any:
        """Refuse to act on a replay buffer, where actions are already those of the policy."""
        raise RuntimeError(
            f"{type(self).__name__} belongs between a policy and an environment: append it to the environment"
        )


class Observe(Transform):
    """What a policy sees behind a map that predicts: the task's observation of the expected state.

    Args:
        task: of the environment.
    """

    def __init__(self, task: Task):
        super().__init__(in_keys=[EXPECTED], out_keys=[OBSERVATION])
        self.task = task

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        position, quaternion, velocity = (next_tensordict.get((EXPECTED, key)) for key in BODY)
        seen = self.task.observe(position, quaternion, velocity, expected_along(next_tensordict)[..., 0])
        return next_tensordict.set(OBSERVATION, seen.float())

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        return self._call(tensordict_reset)


def observing(adapter: CommandMap, task: Task) -> Compose:
    """A map that predicts, and behind it the observation of what it expects, for a policy."""
    parts: list[Transform] = [adapter, Observe(task)]
    return Compose(parts)


def _rows(tensordict: TensorDictBase) -> TensorDictBase:
    """Every vehicle of a batch as a row."""
    return tensordict if tensordict.batch_dims == 1 else tensordict.reshape(-1)


def _as_batch(rows: TensorDictBase, tensordict: TensorDictBase) -> TensorDictBase:
    """The ``tensordict`` of which these are the rows, with what has been written to them."""
    return tensordict if rows is tensordict else tensordict.update(rows.reshape(tensordict.batch_size))


def _commands(like: TensorSpec, size: int) -> Bounded:
    """Spec of ``size`` commands with the batch of another entry."""
    shape = torch.Size((*like.shape[:-1], size))
    return Bounded(-1.0, 1.0, shape, dtype=torch.float32, device=like.device)
