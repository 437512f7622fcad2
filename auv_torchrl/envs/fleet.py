"""What every fleet does: specs, starts, scenario, sensors, reward, partial resets. A backend only moves the bodies."""

import logging
from abc import abstractmethod
from typing import Any

import numpy as np
import torch
from array_api_compat import array_namespace
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from auv_torchrl.envs.regulation import RegulationTask
from auv_torchrl.envs.rows import lengthened, with_rows
from auv_torchrl.envs.scene import SIZE, Scene
from auv_torchrl.physics import ActiveTerms, Coefficients, State, prepare, rest_state
from auv_torchrl.physics.step import memory_length, push
from auv_torchrl.physics.thrusters import applied_thrust
from auv_torchrl.scenario import Scenario
from auv_torchrl.sensors import measured_pose, measured_velocity
from auv_torchrl.vehicle import CONTROLLED_INDEX, Vehicle

Array = Any
log = logging.getLogger(__name__)

FARTHEST = 1e3  # m from the origin; a vehicle beyond it has diverged
FASTEST = 1e2  # m/s and rad/s; likewise
BODY = {"position": 3, "quaternion": 4, "velocity": 6}  # entries of a start, with their lengths


class FleetEnv(EnvBase):
    """N independent vehicles flying one task, each reset on its own when its episode ends.

    Beside the observation every step reports the true state: ``position`` (N, 3) in m, NED; ``quaternion``
    (N, 4), w x y z, body to earth; ``velocity`` (N, 6), body FRD, over ground; ``thrust`` (N, n) in N, gains
    included; ``command`` (N, n), what was sent to the thrusters; ``time`` (N, 1) in s since the episode began.
    The sensor model (delay, bias, noise) acts on the observation alone.

    ``reset(td, set_state=True)`` starts from ``td["start"]`` with ``position``, ``quaternion`` and ``velocity``;
    every reset returns the starts of the running episodes under the same key. A ``vehicle`` entry (a batch of
    :class:`Vehicle`, put there by a transform) replaces the vehicles. Both act only in the rows that are reset.

    Args:
        vehicle: one nominal vehicle or a batch of ``num_envs``.
        task: what is observed, rewarded and where episodes start.
        num_envs: number of vehicles N.
        scenario: effects on top of each vehicle, by episode time; None for none.
        seed: of starts and sensor noise; None draws one.
        device: of the tensors.
        dtype: of the true state; the observation and the reward are float32.

    Raises:
        ValueError: for no vehicles, or a batch of vehicles that is not one per environment.
    """

    _supports_set_state = True

    def __init__(
        self,
        vehicle: Vehicle,
        task: RegulationTask,
        num_envs: int,
        scenario: Scenario | None = None,
        seed: int | None = None,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float32,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"fleet: num_envs is {num_envs}: give 1 or more")
        if vehicle.batch_size not in (torch.Size([]), torch.Size([num_envs])):
            raise ValueError(f"fleet: the vehicle has batch {list(vehicle.batch_size)}: give one vehicle or {num_envs}")
        super().__init__(device=torch.device(device), batch_size=torch.Size([num_envs]))
        self.task = task
        self.num_envs = num_envs
        self.scenario = scenario or Scenario("nominal")
        self.state_dtype = dtype
        self._make_specs(vehicle.thrusters)
        mixer = vehicle.mixer.reshape(-1, *vehicle.mixer.shape[-2:])[0][:, list(CONTROLLED_INDEX)]
        mixer = torch.eye(vehicle.thrusters) if task.thruster_commands else mixer
        self._mixer = mixer.T.to(self.device, torch.float32).contiguous()  # from an action to thruster commands
        self._phase_starts = (0.0, *self.scenario.switching_times())
        self._phase = torch.zeros(num_envs, dtype=torch.long)
        self._scenario_delay = torch.zeros(num_envs, dtype=torch.float64)  # s
        self._flown = (
            vehicle.to(torch.device("cpu"), torch.float64).expand(num_envs).clone()
        )  # before the scenario acts
        self.generator = torch.Generator()  # of starts, sensor noise, and whatever draws for this fleet
        self.set_seed(seed if seed is not None else int(torch.randint(2**31, ())))
        first = prepare(self.scenario.vehicle_at(self._flown))
        self._coefficients = self._native_coefficients(first)
        self._terms = ActiveTerms.of(first)
        zeros = self._native(torch.zeros(num_envs, 7))
        self._state = rest_state(zeros[:, :3], zeros[:, 3:], zeros[:, :6], vehicle.thrusters)
        self._poses = zeros[:, None]  # (N, L, 7) true poses, newest first
        self._start: dict[str, Array] = dict(zip(BODY, self._state[:3], strict=True))
        self._scene: tuple[int, Scene] | None = None
        self._remember(first)

    # what a backend provides

    @abstractmethod
    def _native(self, tensor: Tensor) -> Array:
        """A copy of a tensor as an array of the backend's library, device and precision."""

    @abstractmethod
    def _tensor(self, array: Array, dtype: torch.dtype) -> Tensor:
        """An array of the backend as a tensor of this environment."""

    @abstractmethod
    def _index(self, rows: Tensor) -> Array:
        """Row numbers as an index of the backend's arrays."""

    @abstractmethod
    def _advance(self, command: Array) -> State:
        """The state of all vehicles after one control step from ``self._state``."""

    # vehicles

    @property
    def vehicle(self) -> Vehicle:
        """The vehicles as they are now, batch [N], effects of the scenario included."""
        phases = [self.scenario.vehicle_at(self._flown, time) for time in self._phase_starts]
        return torch.stack(phases)[self._phase, torch.arange(self.num_envs)]  # type: ignore[return-value]

    def render(self, row: int = 0, size: tuple[int, int] = SIZE) -> np.ndarray:
        """The vehicle of a row, with its own thrusters, as an RGB image (height, width, 3), uint8."""
        if self._scene is None or self._scene[0] != row:
            self._scene = row, Scene(self.vehicle[row])  # type: ignore[arg-type]
        position, quaternion = (self._tensor(part[row], torch.float64).cpu().numpy() for part in self._state[:2])
        return self._scene[1].photograph(position, quaternion, size)

    def _native_coefficients(self, coefficients: Coefficients) -> Coefficients:
        return Coefficients(*(self._native(field) for field in coefficients))

    def _begin_phase(self, rows: Tensor, phase: int) -> None:
        """Work out the coefficients of vehicles that reach a phase of the scenario."""
        flown: Vehicle = self._flown[rows]  # type: ignore[assignment]
        new = prepare(self.scenario.vehicle_at(flown, self._phase_starts[phase]))
        self._phase[rows] = phase
        self._coefficients.write_rows(self._index(rows), self._native_coefficients(new))
        self._terms = self._terms | ActiveTerms.of(new)
        self._remember(new)

    def _remember(self, new: Coefficients) -> None:
        """Lengthen the memories of commands and poses if these vehicles are later than any before."""
        dt = self.task.control_dt
        commands = lengthened(self._state.commands, memory_length(float(new.delay.max()), dt))
        self._state = self._state._replace(commands=commands)
        self._poses = lengthened(self._poses, memory_length(float(new.pose_delay.max()), dt))

    def delay_scenario(self, seconds: Tensor) -> None:
        """Let each vehicle meet the switching times of the scenario later by ``seconds`` (N,), 0 or more.

        Raises:
            ValueError: for a wrong shape, or a time below 0 or not finite.
        """
        if seconds.shape != (self.num_envs,) or not (seconds.isfinite() & (seconds >= 0)).all():
            raise ValueError(f"fleet: delays of the scenario are {seconds}: give {self.num_envs} times of 0 s or more")
        self._scenario_delay = seconds.to(torch.device("cpu"), torch.float64)

    def _follow_scenario(self) -> None:
        """Change the vehicles whose episode time has reached a switching time."""
        elapsed = self._tensor(self._state.time, torch.float64).cpu() + self.task.control_dt / 2 - self._scenario_delay
        phase = torch.bucketize(elapsed, torch.tensor(self._phase_starts[1:], dtype=torch.float64), right=True)
        changed = phase != self._phase
        for reached in phase[changed].unique().tolist():
            self._begin_phase((changed & (phase == reached)).nonzero()[:, 0], reached)

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
                "thrust": values(thrusters),
                "command": values(thrusters),
                "time": values(1),
            }
        )
        self.state_spec = entries({"start": entries({key: spec.clone() for key, spec in body.items()})})
        actions = thrusters if self.task.thruster_commands else len(CONTROLLED_INDEX)
        self.action_spec = Bounded(-1.0, 1.0, torch.Size((*shape, actions)), dtype=torch.float32, device=device)
        self.reward_spec = values(1, dtype=torch.float32)
        self.done_spec = entries({key: flag.clone() for key in ("done", "terminated", "truncated")})

    def _set_seed(self, seed: int | None) -> None:
        if seed is None:
            raise ValueError("fleet: the seed is None: give a whole number")
        self.generator.manual_seed(seed)

    def _reset(self, tensordict: TensorDictBase | None = None, set_state: bool = False, **_: Any) -> TensorDict:
        given = {} if tensordict is None else tensordict
        mask, vehicle = given.get("_reset"), given.get("vehicle")
        rows = torch.arange(self.num_envs) if mask is None else mask.reshape(self.num_envs).cpu().nonzero()[:, 0]
        if vehicle is not None:
            self._flown[rows] = vehicle[rows].to(torch.device("cpu"), torch.float64)
        if vehicle is not None or self._phase[rows].any():
            self._begin_phase(rows, 0)
        parts = read_start(given.get("start"), rows) if set_state else self.task.draw_starts(len(rows), self.generator)
        self._place(self._index(rows), *(self._native(part) for part in parts))
        no = torch.zeros(self.num_envs, 1, dtype=torch.bool, device=self.device)
        start = {key: self._tensor(value, self.state_dtype) for key, value in self._start.items()}
        return TensorDict(
            {
                **self._report(),
                "done": no,
                "terminated": no.clone(),
                "truncated": no.clone(),
                "start": TensorDict(start, self.batch_size, device=self.device),
            },
            self.batch_size,
            device=self.device,
        )

    def _place(self, rows: Array, position: Array, quaternion: Array, velocity: Array) -> None:
        """Begin an episode of some vehicles: silent thrusters, no commands on their way."""
        memory = self._state.commands.shape[-2]
        fresh = rest_state(position, quaternion, velocity, self._state.thrust.shape[-1], memory)
        self._state = State(*(with_rows(old, rows, new) for old, new in zip(self._state, fresh, strict=True)))
        xp = array_namespace(position)
        pose = xp.concat((position, quaternion), axis=-1)
        self._poses = with_rows(self._poses, rows, pose[:, None])
        for key, value in zip(BODY, (position, quaternion, velocity), strict=True):
            self._start[key] = with_rows(self._start[key], rows, value)

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        action = tensordict.get("action")
        command = (action @ self._mixer).clamp(-1.0, 1.0)
        if len(self._phase_starts) > 1:
            self._follow_scenario()
        before = self._state
        self._state = self._advance(self._native(command))
        position, quaternion, velocity = self._state[:3]
        xp = array_namespace(position)
        sane = xp.all(xp.abs(velocity) < FASTEST, axis=-1) & xp.all(xp.abs(position) < FARTHEST, axis=-1)
        if not xp.all(sane):
            self._hold_diverged(before, sane)
        if self._poses.shape[1] > 1:
            self._poses = push(self._poses, xp.concat(self._state[:2], axis=-1))
        else:
            self._poses = xp.concat(self._state[:2], axis=-1)[:, None]
        reward = self.task.reward(*self._state[:3], self._native(action))
        terminated = self._tensor(~sane[:, None], torch.bool)
        truncated = self._tensor(self._state.time[:, None] > self.task.episode_s - self.task.control_dt / 2, torch.bool)
        return TensorDict(
            {
                **self._report(),
                "reward": self._tensor(reward[:, None], torch.float32),
                "done": terminated | truncated,
                "terminated": terminated,
                "truncated": truncated,
            },
            self.batch_size,
            device=self.device,
        )

    def _hold_diverged(self, before: State, sane: Array) -> None:
        """Leave diverged vehicles where they were, so that everything reported stays finite, and say so."""
        bad = self._tensor(~sane, torch.bool).nonzero()[:, 0].tolist()
        log.warning(
            "vehicles %s left the model's validity (speed below %g m/s, position within %g m): their episodes end",
            bad, FASTEST, FARTHEST,
        )  # fmt: skip
        rows = self._index(torch.tensor(bad))
        held = zip(self._state[:4], before[:4], strict=True)
        self._state = self._state._replace(
            **dict(zip(State._fields, (with_rows(new, rows, old[rows]) for new, old in held), strict=False))
        )

    def _report(self) -> dict[str, Tensor]:
        c, state = self._coefficients, self._state
        position, quaternion, velocity = state.position, state.quaternion, state.velocity
        if self._terms.sensing:
            noise = None
            if self._terms.sensor_noise:
                noise = self._native(torch.randn(self.num_envs, 6, generator=self.generator, dtype=torch.float64))
            position, quaternion = measured_pose(c, self._poses, self.task.control_dt, noise)
            velocity = measured_velocity(c, velocity)
        observation = self.task.observe(position, quaternion, velocity)
        dtype = self.state_dtype
        return {
            "observation": self._tensor(observation, torch.float32),
            "position": self._tensor(state.position, dtype),
            "quaternion": self._tensor(state.quaternion, dtype),
            "velocity": self._tensor(state.velocity, dtype),
            "thrust": self._tensor(applied_thrust(c, self._terms, state.thrust, state.time), dtype),
            "command": self._tensor(state.commands[:, 0], dtype),
            "time": self._tensor(state.time[:, None], dtype),
        }


def read_start(start: TensorDictBase | None, rows: Tensor) -> tuple[Tensor, ...]:
    """Checked position, quaternion and velocity of the rows that are reset, float64.

    Raises:
        ValueError: for a missing entry, a wrong shape, values that are not finite or no unit quaternion.
    """
    if start is None:
        raise ValueError(f"fleet: set_state=True needs a 'start' entry with {', '.join(BODY)}")
    parts = []
    for key, length in BODY.items():
        value = start.get(key, None)
        if value is None or value.shape[-1:] != (length,):
            found = "missing" if value is None else f"of shape {list(value.shape)}"
            raise ValueError(f"fleet: start.{key} is {found}: give [num_envs, {length}]")
        value = value.cpu()[rows].double()
        if not value.isfinite().all():
            raise ValueError(f"fleet: start.{key} has values that are not finite")
        parts.append(value)
    if not torch.allclose(parts[1].norm(dim=-1), torch.ones(()).double(), atol=1e-3):
        raise ValueError("fleet: start.quaternion is not of unit length: give w, x, y, z of a rotation")
    parts[1] = torch.nn.functional.normalize(parts[1], dim=-1)
    return tuple(parts)
