"""What can simulate the same vehicles: our simulators and environments, the physics on other libraries, MuJoCo alone.

Every engine begins where the others begin, flies constant commands in Runge-Kutta steps of the same length, and says
where the vehicles are.
"""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np
import torch
from mujoco import rollout
from tensordict import TensorDict

from auv_torchrl.array_api import host
from auv_torchrl.envs import ID, MujocoFleet, TorchFleet
from auv_torchrl.envs.fleet import FleetEnv
from auv_torchrl.envs.start import BODY
from auv_torchrl.extras import library
from auv_torchrl.physics import CONTROL_DT, SUBSTEPS, ActiveTerms, State, control_step, prepare, rest_state
from auv_torchrl.physics.kinematics import matvec, rotation_matrix
from auv_torchrl.simulator import NumpyArrays, PlainSimulator, Simulator, TorchArrays
from auv_torchrl.simulator.mujoco import MujocoSimulator
from auv_torchrl.simulator.mujoco_model import compiled, fleet_model
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import Vehicle, index_of, load_vehicle

CHUNK = 20  # control steps, 1 s, that engines fly in one call where they can fly more than one
EPISODE = 400  # control steps of 20 s, whose end resets all vehicles
TASK = StationKeeping(box_m=1.0)
SINGLE, DOUBLE = "single", "double"
Array = Any


@dataclass(frozen=True)
class World:
    """N vehicles at rest, the commands that they all hold, and their motion by the plain equations on numpy."""

    vehicles: Vehicle  # batch [N]
    actions: np.ndarray  # (N, a) float32, along the axes of the task
    commands: np.ndarray  # (N, n) to the thrusters that these are
    motion: list[State]  # CHUNK * SUBSTEPS + 1 states, one Runge-Kutta step apart

    @staticmethod
    def drawn(count: int, vehicle: Vehicle | None = None) -> "World":
        """Starts in a box of ±1 m at any heading, and actions of up to half the range; the same for the same count."""
        one = load_vehicle("paper") if vehicle is None else vehicle
        rng = np.random.default_rng(0)
        actions = rng.uniform(-0.5, 0.5, (count, len(TASK.axes))).astype(np.float32)
        commands = np.clip(actions.astype(float) @ host(one.mixer)[:, index_of(TASK.axes)].T, -1.0, 1.0)
        half = rng.uniform(-np.pi, np.pi, count) / 2
        level = np.zeros(count)
        quaternion = np.stack([np.cos(half), level, level, np.sin(half)], axis=-1)
        state = rest_state(rng.uniform(-1.0, 1.0, (count, 3)), quaternion, np.zeros((count, 6)), one.thrusters)
        vehicles = one.expand(count)
        c = prepare(vehicles)
        terms, motion = ActiveTerms.of(c), [state]
        for _ in range(CHUNK * SUBSTEPS):
            motion.append(control_step(c, terms, motion[-1], commands, CONTROL_DT / SUBSTEPS, substeps=1))
        return World(vehicles, actions, commands, motion)

    @property
    def start(self) -> State:
        """Where everybody begins."""
        return self.motion[0]

    @property
    def count(self) -> int:
        """N."""
        return len(self.actions)


class Engine(ABC):
    """N vehicles that fly the commands of a world."""

    @abstractmethod
    def begin(self) -> None:
        """Place all vehicles at their starts."""

    @abstractmethod
    def fly(self, steps: int) -> None:
        """Hold the commands for so many control steps, a multiple of CHUNK."""

    @abstractmethod
    def positions(self) -> np.ndarray:
        """Where the vehicles are, (N, 3) in m."""


class BySimulator(Engine):
    """One of our simulators: sensors, scenario and divergence are looked after; no task."""

    def __init__(self, simulator: Simulator, world: World) -> None:
        self._simulator, self._start = simulator, world.start
        self._commands = simulator.arrays.native(world.commands)

    def begin(self) -> None:
        """Place them."""
        self._simulator.place(np.arange(self._simulator.count), *self._start[:3])

    def fly(self, steps: int) -> None:
        """Step by step."""
        for _ in range(steps):
            self._simulator.step(self._commands)

    def positions(self) -> np.ndarray:
        """Of the state."""
        return host(self._simulator.state.position)


class ByEnvironment(Engine):
    """One of our environments of TorchRL: reward, observation, and a new start at the end of an episode."""

    def __init__(self, env: FleetEnv, world: World) -> None:
        self._env, self._actions = env, torch.from_numpy(world.actions)
        start = {key: torch.from_numpy(part) for key, part in zip(BODY, world.start[:3], strict=True)}
        self._start = TensorDict({"start": TensorDict(start, env.batch_size)}, env.batch_size)
        self._now = self._start

    def begin(self) -> None:
        """Reset all to the starts."""
        self._now = self._env.reset(self._start.clone(), set_state=True)

    def fly(self, steps: int) -> None:
        """Step by step."""
        for _ in range(steps):
            _, self._now = self._env.step_and_maybe_reset(self._now.set("action", self._actions))

    def positions(self) -> np.ndarray:
        """As they are reported."""
        return host(self._now["position"])


class ByLines(Engine):
    """The lines of ``auv_torchrl/physics`` as numpy runs them, without a compiler."""

    def __init__(self, world: World) -> None:
        self._world, self._c = world, prepare(world.vehicles)
        self._terms, self._state = ActiveTerms.of(self._c), world.start

    def begin(self) -> None:
        """Take the first state."""
        self._state = self._world.start

    def fly(self, steps: int) -> None:
        """Step by step."""
        for _ in range(steps):
            self._state = control_step(self._c, self._terms, self._state, self._world.commands)

    def positions(self) -> np.ndarray:
        """Of the state."""
        return self._state.position


class ByJax(Engine):
    """The same lines, compiled by JAX as one loop over CHUNK control steps."""

    def __init__(self, precision: str, world: World) -> None:
        # one core; XLA reads this as it is imported
        os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
        self._jax = jax = library("jax", "JAX as an engine needs", "bench")
        self._double = precision == DOUBLE
        c = prepare(world.vehicles)
        terms = ActiveTerms.of(c)

        def chunk(c: Any, state: Any, commands: Any) -> Any:
            step = partial(control_step, c, terms)
            return jax.lax.scan(lambda now, _: (step(now, commands), None), state, None, length=CHUNK)[0]

        with self._precision():
            self._given = jax.tree.map(jax.numpy.asarray, (c, world.start, world.commands))
            self._chunk = jax.jit(chunk).lower(*self._given).compile()
        self._state = self._given[1]

    def _precision(self) -> AbstractContextManager[Any]:
        return self._jax.enable_x64(True) if self._double else nullcontext()

    def begin(self) -> None:
        """Take the first state."""
        self._state = self._given[1]

    def fly(self, steps: int) -> None:
        """Loop by loop, and wait for the last: JAX returns before it has computed."""
        c, _, commands = self._given
        with self._precision():
            for _ in range(steps // CHUNK):
                self._state = self._chunk(c, self._state, commands)
        self._jax.block_until_ready(self._state)

    def positions(self) -> np.ndarray:
        """Of the state."""
        return np.asarray(self._state.position)


class ByRollout(Engine):
    """``mujoco.rollout`` of the free bodies of our fleet under forces that are known beforehand.

    MuJoCo is given the mean generalized force of each of its steps, worked out from the motion before anything is
    timed. So it computes nothing of water or thrusters; each call begins at the start, where the forces begin.

    Args:
        together: bodies of a model; as many models are flown as it takes.
        integrator: as MJCF names it; the forces are the same in all stages of a step.
        world: what is flown.
    """

    def __init__(self, together: int, integrator: str, world: World) -> None:
        model = fleet_model(world.vehicles, together, CONTROL_DT)
        model.option.integrator = integrator
        self._model = compiled(model).model.ptr
        self._data = mujoco.MjData(self._model)  # pyright: ignore[reportAttributeAccessIssue]
        kinds = mujoco.mjtState  # pyright: ignore[reportAttributeAccessIssue]
        self._applied = kinds.mjSTATE_QFRC_APPLIED.value
        rates = np.stack([_body_rates(state) for state in world.motion])  # (S + 1, N, 6)
        inertia = np.repeat((self._model.body_mass[1], self._model.body_inertia[1, 0]), 3)
        self._forces = self._by_model(np.diff(rates, axis=0) / self._model.opt.timestep * inertia, together)
        pose = np.concatenate(world.start[:2], axis=-1)
        parts = [self._by_model(part[None], together)[:, 0] for part in (pose, rates[0])]
        self._start = np.concatenate([np.zeros((len(parts[0]), 1)), *parts], axis=-1)  # time, qpos, qvel
        self._states = np.empty((*self._forces.shape[:2], self._start.shape[1]))
        self._pose_size = 7 * together

    @staticmethod
    def _by_model(array: np.ndarray, together: int) -> np.ndarray:
        """(S, N, k) as (models, S, together * k)."""
        steps, count, size = array.shape
        split = array.reshape(steps, count // together, together * size)
        return np.ascontiguousarray(split.swapaxes(0, 1))

    def begin(self) -> None:
        """Every call begins at the start."""

    def fly(self, steps: int) -> None:
        """CHUNK by CHUNK, each from the start."""
        for _ in range(steps // CHUNK):
            rollout.rollout(
                self._model, self._data, self._start, self._forces, control_spec=self._applied, state=self._states
            )

    def positions(self) -> np.ndarray:
        """Of the last states."""
        return self._states[:, -1, 1 : 1 + self._pose_size].reshape(-1, 7)[:, :3]


def _body_rates(state: State) -> np.ndarray:
    """Velocity along the axes of the earth and angular velocity in the body frame, (N, 6), as MuJoCo has them."""
    linear = matvec(rotation_matrix(state.quaternion), state.velocity[:, :3])
    return np.concatenate((linear, state.velocity[:, 3:]), axis=-1)


class ByStableBaselines(Engine):
    """stable-baselines3's ``DummyVecEnv`` of our gymnasium environment: one vehicle after the other."""

    def __init__(self, world: World) -> None:
        needs = "stable-baselines3 as an engine needs"
        dummy = library("stable_baselines3.common.vec_env", needs, "bench").DummyVecEnv
        gymnasium = library("gymnasium", needs, "train")
        one = partial(gymnasium.make, ID, task=TASK, backend="torch")  # which is the faster one alone
        self._envs, self._world = dummy([one] * world.count), world
        self._infos: list[dict[str, Any]] = []

    def begin(self) -> None:
        """Reset all to the starts."""
        rows = zip(*self._world.start[:3], strict=True)
        self._envs.set_options([{"start": dict(zip(BODY, row, strict=True))} for row in rows])
        self._envs.reset()

    def fly(self, steps: int) -> None:
        """Step by step."""
        for _ in range(steps):
            *_, self._infos = self._envs.step(self._world.actions)

    def positions(self) -> np.ndarray:
        """As the last step reports them."""
        return np.stack([info["position"] for info in self._infos])


@dataclass(frozen=True)
class Entry:
    """An engine in the table."""

    build: Callable[[World], Engine]
    precision: str
    what: str  # it computes, or leaves out
    ours: bool = False
    least_steps: int = CHUNK  # that are timed


def _array_physics(precision: str, world: World) -> Engine:
    arrays = NumpyArrays() if precision == DOUBLE else TorchArrays(torch.device("cpu"), torch.float32)
    return BySimulator(PlainSimulator(world.vehicles, CONTROL_DT, arrays=arrays), world)


_MOTION = "motion, sensors, divergence"
_WHOLE = f"{_MOTION}, observation, reward, resets"
_GIVEN = "free bodies under given forces: no water, no thrusters"
ENGINES = {
    "array physics, torch": Entry(partial(_array_physics, SINGLE), SINGLE, _MOTION, True),
    "array physics, numpy": Entry(partial(_array_physics, DOUBLE), DOUBLE, _MOTION, True),
    "MuJoCo fleet": Entry(
        lambda world: BySimulator(MujocoSimulator(world.vehicles, CONTROL_DT), world), DOUBLE, _MOTION, True
    ),
    "TorchFleet": Entry(
        lambda world: ByEnvironment(TorchFleet(world.vehicles, TASK, world.count, seed=0), world),
        SINGLE, _WHOLE, True, EPISODE,
    ),
    "MujocoFleet": Entry(
        lambda world: ByEnvironment(MujocoFleet(world.vehicles, TASK, world.count, seed=0), world),
        DOUBLE, _WHOLE, True, EPISODE,
    ),
    "the physics' lines on numpy": Entry(ByLines, DOUBLE, "motion"),
    "the physics' lines on JAX": Entry(partial(ByJax, SINGLE), SINGLE, "motion"),
    "the physics' lines on JAX, double": Entry(partial(ByJax, DOUBLE), DOUBLE, "motion"),
    "mujoco.rollout, a model per body": Entry(partial(ByRollout, 1, "RK4"), DOUBLE, _GIVEN),
    "mujoco.rollout, one model": Entry(lambda world: ByRollout(world.count, "RK4", world), DOUBLE, _GIVEN),
    "mujoco.rollout, one model, Euler": Entry(lambda world: ByRollout(world.count, "Euler", world), DOUBLE, _GIVEN),
    "stable-baselines3, DummyVecEnv": Entry(ByStableBaselines, SINGLE, _WHOLE),
}  # fmt: skip
