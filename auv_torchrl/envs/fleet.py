"""A simulator and a task as a TorchRL environment: specs, starts, reward, partial resets."""

import logging
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from auv_torchrl.envs.start import ALONG, BODY, VEHICLE, read_start, read_vehicles, reset_spec
from auv_torchrl.physics import State
from auv_torchrl.simulator import Simulator
from auv_torchrl.simulator.arrays import with_rows
from auv_torchrl.simulator.base import FARTHEST, FASTEST
from auv_torchrl.simulator.scene import SIZE, Scene
from auv_torchrl.tasks import Task
from auv_torchrl.tasks.judge import Judge
from auv_torchrl.vehicle import Vehicle, index_of
from auv_torchrl.vehicle.tensors import tensors

Array = Any
LARGEST = 1e6  # of an action, which is meant to be in [-1, 1]: what is squared in a reward stays finite
log = logging.getLogger(__name__)


class FleetEnv(EnvBase):
    """N independent vehicles flying one task, each reset on its own when its episode ends.

    Beside the observation every step reports the true state: ``position`` (N, 3) in m, NED; ``quaternion``
    (N, 4), w x y z, body to earth; ``velocity`` (N, 6), body FRD, over ground; ``thrust`` (N, n) in N, gains
    included; ``command`` (N, n), what was sent to the thrusters; ``time`` (N, 1) in s since the episode began, and
    ``along`` (N, 1), how far along the task the vehicle is, which is the same unless the task says otherwise.
    What the sensors say of the state, late, biased and noisy, is under ``("measured", "position")``, ``("measured",
    "quaternion")`` and ``("measured", "velocity")``; the observation is made from that.

    ``reset(td, set_state=True)`` starts from ``td["start"]`` with ``position``, ``quaternion`` and ``velocity``, and
    ``along`` where episodes do not begin at the beginning of the task;
    every reset returns the starts of the running episodes under the same key. A ``vehicle`` entry of what ``reset`` is
    given replaces the vehicles; :attr:`reset_spec` declares it. Both act only in the rows that are reset.

    An action that is no finite number ends the episode of its vehicle as a state that diverges does: the vehicle is
    given 0 in its place, a warning names it, and what is reported and rewarded stays finite.

    Args:
        simulator: of the N vehicles; its arrays say on which device the fleet's tensors are, and its sensors take
            their noise from the fleet's seed. Starts and noise are drawn on the CPU, the same for every device.
        task: what is observed, rewarded and where episodes start.
        seed: of starts and sensor noise; None draws one.
        dtype: of the true state; the observation and the reward are float32.
    """

    _supports_set_state = True
    _limited = staticmethod(torch.nn.functional.hardtanh)  # commands, to [-1, 1]

    def __init__(
        self,
        simulator: Simulator,
        task: Task,
        seed: int | None = None,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        super().__init__(device=simulator.arrays.device, batch_size=torch.Size([simulator.count]))
        self.simulator = simulator
        self.task = task
        self.num_envs = simulator.count
        self.state_dtype = dtype
        self._make_specs(simulator.thrusters)
        mixer = self.vehicle.mixer[0][:, index_of(task.axes)]
        mixer = torch.eye(simulator.thrusters) if task.thruster_commands else mixer
        self._mixer = mixer.T.to(self.device, torch.float32).contiguous()  # from an action to thruster commands
        self.generator = torch.Generator()  # of starts, sensor noise, and whatever draws for this fleet
        simulator.generator = self.generator
        self.set_seed(seed if seed is not None else int(torch.randint(2**31, ())))
        self._ahead = simulator.state.time  # (N,) s, by how much vehicles are further along the task than their time
        self._start: dict[str, Array] = dict(zip(BODY, simulator.state[:3], strict=True))
        self._start[ALONG] = self._ahead[:, None]
        self._scene: tuple[int, Scene] | None = None
        self._begun = False
        self._judge = Judge(task, self.action_spec.shape[-1])

    @property
    def vehicle(self) -> Vehicle:
        """The vehicles as they are now, batch [N] of tensors on the CPU, effects of the scenario included."""
        return tensors(self.simulator.vehicles)

    def render(self, row: int = 0, size: tuple[int, int] = SIZE) -> np.ndarray:
        """The vehicle of a row, with its own thrusters, as an RGB image (height, width, 3), uint8."""
        if self._scene is None or self._scene[0] != row:
            self._scene = row, Scene(self.simulator.vehicles[row])
        parts = (*self._state[:2], self.task.reference(self._along).nearest(self._state.position))
        position, quaternion, target = (self._tensor(part[row], torch.float64).cpu().numpy() for part in parts)
        return self._scene[1].photograph(position, quaternion, size, target)

    def _tensor(self, array: Array, dtype: torch.dtype) -> Tensor:
        return self.simulator.arrays.tensor(array, dtype)

    @property
    def _state(self) -> State:
        return self.simulator.state

    @property
    def _along(self) -> Array:
        return self._state.time + self._ahead

    # TorchRL

    def _make_specs(self, thrusters: int) -> None:
        shape, device = self.batch_size, self.device

        def values(*size: int, dtype: torch.dtype = self.state_dtype) -> Unbounded:
            return Unbounded(torch.Size((*shape, *size)), dtype=dtype, device=device)

        def entries(specs: dict[str, Any]) -> Composite:
            return Composite(specs, shape=shape, device=device)

        body = {key: values(length) for key, length in BODY.items()}
        flag = Binary(1, shape=torch.Size((*shape, 1)), dtype=torch.bool, device=device)
        self.observation_spec = entries(
            {
                "observation": values(len(self.task.observation_names), dtype=torch.float32),
                **body,
                "measured": entries({key: spec.clone() for key, spec in body.items()}),
                "thrust": values(thrusters),
                "command": values(thrusters),
                "time": values(1),
                ALONG: values(1),
            }
        )
        start = {key: spec.clone() for key, spec in {**body, ALONG: values(1)}.items()}
        self.state_spec = entries({"start": entries(start)})
        self.reset_spec = reset_spec(self.vehicle)
        actions = thrusters if self.task.thruster_commands else len(self.task.axes)
        self._action_shape = torch.Size((*shape, actions))
        self.action_spec = Bounded(-1.0, 1.0, self._action_shape, dtype=torch.float32, device=device)
        self.reward_spec = values(1, dtype=torch.float32)
        self.done_spec = entries({key: flag.clone() for key in ("done", "terminated", "truncated")})

    def _set_seed(self, seed: int | None) -> None:
        if seed is None:
            raise ValueError("fleet: the seed is None: give a whole number")
        self.generator.manual_seed(seed)

    def _reset(self, tensordict: TensorDictBase | None = None, set_state: bool = False, **_: Any) -> TensorDict:
        given = {} if tensordict is None else tensordict
        mask = given.get("_reset")
        rows = torch.arange(self.num_envs) if mask is None else mask.reshape(self.num_envs).cpu().nonzero()[:, 0]
        *parts, along = read_start(given.get("start"), rows) if set_state else self._drawn(len(rows))
        self._begun = True
        self.simulator.place(rows, *parts, vehicles=read_vehicles(given.get(VEHICLE), rows, self.reset_spec))
        index = self.simulator.arrays.index(rows.numpy())
        self._ahead = with_rows(self._ahead, index, self.simulator.arrays.native(along[:, 0]))
        for key, placed in zip((*BODY, ALONG), (*self._state[:3], self._ahead[:, None]), strict=True):
            self._start[key] = with_rows(self._start[key], index, placed[index])
        no = torch.zeros(self.num_envs, 1, dtype=torch.bool, device=self.device)
        start = {key: self._tensor(value, self.state_dtype) for key, value in self._start.items()}
        return TensorDict(
            {
                **self._report(self._along),
                **{key: no.clone() for key in ("done", "terminated", "truncated")},
                "start": TensorDict(start, self.batch_size, device=self.device),
            },
            self.batch_size,
            device=self.device,
        )

    def _drawn(self, count: int) -> tuple[Tensor, ...]:
        along = self.task.draw_along(count, self.generator)
        return *self.task.draw_starts(count, self.generator, along), along[:, None]

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        action, unusable = self._usable(tensordict.get("action", None))
        command = self._limited(action @ self._mixer)
        native = self.simulator.arrays.native
        terminated = self._tensor(self.simulator.step(native(command))[:, None], torch.bool)
        if terminated.any():
            log.warning(
                "vehicles %s left the model's validity (speed below %g m/s, position within %g m): their episodes end",
                terminated.nonzero()[:, 0].tolist(), FASTEST, FARTHEST,
            )  # fmt: skip
        state, time = self._state[:3], self._along
        reward = self._judge.reward(*state, native(action), time)
        if unusable is not None:
            terminated = terminated | unusable[:, None]
        terminated = terminated | self._tensor(self.task.terminated(*state, time)[:, None], torch.bool)
        truncated = self._tensor(self._state.time[:, None] > self.task.episode_s - self.task.control_dt / 2, torch.bool)
        return self._together(
            {
                **self._report(time),
                "reward": self._tensor(reward[:, None], torch.float32),
                "done": terminated | truncated,
                "terminated": terminated,
                "truncated": truncated,
            }
        )

    def _usable(self, action: Tensor | None) -> tuple[Tensor, Tensor | None]:
        """The action (N, a) with 0 for vehicles whose action is no number, and which these are (N,); None for none.

        Raises:
            RuntimeError: before the first reset.
            ValueError: for an action of another shape or type, or none.
        """
        if not self._begun:
            raise RuntimeError("fleet: step before the first reset: call reset()")
        if action is None or action.shape != self._action_shape or action.dtype != torch.float32:
            found = "missing" if action is None else f"{action.dtype} of shape {list(action.shape)}"
            raise ValueError(f"fleet: the action is {found}: give torch.float32 of shape {list(self._action_shape)}")
        if action.abs().amax() < LARGEST:  # not so for NaN
            return action, None
        unusable = ~(action.abs() < LARGEST).all(-1)
        log.warning(
            "vehicles %s were given actions that are no finite number: their episodes end",
            unusable.nonzero()[:, 0].tolist(),
        )
        return action.where(~unusable[:, None], 0.0), unusable

    def _together(self, entries: dict[str, Any]) -> TensorDict:
        """Tensors of the fleet's batch and device."""
        return TensorDict(entries, self.batch_size, device=self.device)

    def _report(self, along: Array) -> dict[str, Tensor | TensorDict]:
        state, dtype = self._state, self.state_dtype
        report = self.simulator.report()
        skipped = self.task.skipped(*report, along)
        if skipped is not None:
            self._ahead = self._ahead + skipped
            along = self._along
        observation = self._judge.observe(*report, along)
        measured = {key: self._tensor(part, dtype) for key, part in zip(BODY, report, strict=True)}
        return {
            "observation": self._tensor(observation, torch.float32),
            "measured": self._together(measured),
            **{key: self._tensor(part, dtype) for key, part in zip(BODY, state[:3], strict=True)},
            "thrust": self._tensor(self.simulator.thrust, dtype),
            "command": self._tensor(state.commands[:, 0], dtype),
            "time": self._tensor(state.time[:, None], dtype),
            ALONG: self._tensor(along[:, None], dtype),
        }
