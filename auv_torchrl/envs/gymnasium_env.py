"""The regulation task for gymnasium: ``gymnasium.make("auv_torchrl/Regulation-v0", vehicle="bluerov2")``."""

from collections.abc import Iterable, Mapping
from reprlib import repr as short
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.error import ClosedEnvironmentError
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from tensordict import TensorDict, TensorDictBase

from auv_torchrl.envs.fleet import FleetEnv
from auv_torchrl.envs.make import make_fleet
from auv_torchrl.envs.start import BODY
from auv_torchrl.paths import config_path
from auv_torchrl.scenario import read_scenario
from auv_torchrl.simulator.base import FARTHEST
from auv_torchrl.tasks import Task, read_task
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.yaml_file import read_yaml

_DEFAULTS = "defaults"  # of Hydra, in a file of conf: which schema checks the file, as read_task does
REPORTED = (*BODY, "thrust", "command")  # entries of the fleet that the info of a step has, the true state


def fleet_by_names(
    num_envs: int,
    vehicle: str | Mapping[str, Any] = "paper",
    backend: str = "mujoco",
    task: str | Task | Mapping[str, Any] | None = None,
    scenario: str | Mapping[str, Any] | None = None,
) -> FleetEnv:
    """A fleet from names or mappings as in ``conf``; errors list what there is."""
    loaded = load_vehicle(vehicle)
    name, config = "given", scenario
    if isinstance(scenario, str):
        name, config = scenario, read_yaml(config_path("scenario", scenario), "scenario")
    if isinstance(task, str):
        content = read_yaml(config_path("task", task), "task")
        task = read_task({key: value for key, value in content.items() if key != _DEFAULTS})
    flown = task if isinstance(task, Task) else read_task(task)
    return make_fleet(backend, loaded, flown, num_envs, scenario=read_scenario(name, config, loaded))  # type: ignore[arg-type]


class RegulationEnv(gymnasium.Env):
    """One vehicle; ``reset(options={"start": {...}})`` starts from a position, quaternion and velocity.

    Args:
        vehicle: name in ``conf/vehicle`` or a mapping like its files.
        backend: "mujoco" or "torch".
        task: name in ``conf/task``, a mapping like its files, of which what is left out has its default, or a
            :class:`Task`; None for station keeping.
        scenario: name in ``conf/scenario`` or a mapping like its files; None for the nominal vehicle.
        render_mode: "rgb_array" or None.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}

    def __init__(self, *, render_mode: str | None = None, **fleet: Any) -> None:
        self.render_mode = checked_mode(render_mode)
        self.fleet = fleet_by_names(1, **fleet)
        self.observation_space, self.action_space = spaces(self.fleet)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        super().reset(seed=seed)
        now = reset_fleet(self.fleet, seed, options)
        return now["observation"][0].numpy(), {key: now[key][0].numpy() for key in BODY}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Hold the action for one control step."""
        actions = checked_actions(action, self.action_space)[None]
        now = self.fleet.step(TensorDict({"action": actions}, [1]))["next"]
        info = {key: now[key][0].numpy() for key in REPORTED}
        return (
            now["observation"][0].numpy(),
            float(now["reward"]),
            bool(now["terminated"]),
            bool(now["truncated"]),
            info,
        )

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """The vehicle as the camera sees it, (height, width, 3) uint8; None without a render mode."""
        return self.fleet.render() if self.render_mode else None


class RegulationVectorEnv(VectorEnv):
    """``num_envs`` vehicles in one native fleet: one step of the physics moves all of them.

    An episode begins anew in the step that ends the one before (``AutoresetMode.SAME_STEP``): the observation is the
    first of the new episode, ``final_obs`` and ``final_info`` of the info are the last of the old one. Each entry
    of an info has a mask of its vehicles beside it (``_final_obs``), as gymnasium's own vector environments write it.

    Args:
        num_envs: number of vehicles.
        render_mode: "rgb_array" or None.
        fleet: vehicle, backend, task and scenario, as :class:`RegulationEnv` takes them.
    """

    metadata = {**RegulationEnv.metadata, "autoreset_mode": AutoresetMode.SAME_STEP}

    def __init__(self, num_envs: int = 1, *, render_mode: str | None = None, **fleet: Any) -> None:
        self.render_mode = checked_mode(render_mode)
        self.fleet = fleet_by_names(num_envs, **fleet)
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = spaces(self.fleet)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._all = np.ones(num_envs, dtype=np.bool_)
        self._now: TensorDictBase | None = None  # what the fleet reported last, for vehicles that are not reset

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:  # type: ignore[override]
        """Begin an episode of every vehicle, or of those that ``options["reset_mask"]`` (num_envs,) marks.

        One ``seed`` is that of the whole fleet. ``options["start"]`` has a row for every vehicle.
        """
        self._refuse_closed()
        super().reset(seed=seed)
        options = dict(options or {})
        mask = options.pop("reset_mask", None)
        given = None if mask is None else self._marked(mask)
        self._now = now = reset_fleet(self.fleet, seed, options, given)
        return now["observation"].numpy(), self._info(now, BODY, self._all)

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict]:  # type: ignore[override]
        """Hold the actions for one control step."""
        self._refuse_closed()
        given = checked_actions(actions, self.action_space)
        done, now = self.fleet.step_and_maybe_reset(TensorDict({"action": given}, [self.num_envs]))
        self._now, last = now, done["next"]
        info = self._info(now, REPORTED, self._all)
        ended = last["done"][:, 0].numpy()
        if ended.any():
            info |= {
                "final_obs": last["observation"].numpy(),
                "_final_obs": ended,
                "final_info": self._info(last, REPORTED, ended),
                "_final_info": ended,
            }
        reward, terminated, truncated = (last[key][:, 0].numpy() for key in ("reward", "terminated", "truncated"))
        return now["observation"].numpy(), reward, terminated, truncated, info

    def render(self) -> tuple[np.ndarray, ...] | None:  # type: ignore[override]
        """Each vehicle as a camera of its own sees it, (height, width, 3) uint8; None without a render mode."""
        if self.render_mode is None:
            return None
        return tuple(self.fleet.render(row) for row in range(self.num_envs))

    def close_extras(self, **_: Any) -> None:
        """Close the fleet."""
        self.fleet.close(raise_if_closed=False)

    def _info(self, now: TensorDictBase, keys: Iterable[str], mask: np.ndarray) -> dict[str, np.ndarray]:
        info = {}
        for key in keys:
            info[key], info[f"_{key}"] = now[key].numpy(), mask
        return info

    def _refuse_closed(self) -> None:
        if self.closed:
            raise ClosedEnvironmentError("the fleet is closed: make another one")

    def _marked(self, mask: Any) -> TensorDictBase:
        """What the fleet reported last, with the vehicles to be reset marked."""
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise ValueError(f"reset: reset_mask is {short(mask)}: give a numpy array of {self.num_envs} bool")
        if self._now is None:
            raise RuntimeError("reset: reset_mask before the first reset: call reset() for all vehicles")
        return self._now.copy().set("_reset", torch.from_numpy(mask.copy())[:, None])


def checked_mode(render_mode: str | None) -> str | None:
    """The render mode.

    Raises:
        ValueError: for one that there is not.
    """
    if render_mode not in (None, "rgb_array"):
        raise ValueError(f"render_mode is {render_mode!r}: give 'rgb_array' or None")
    return render_mode


def checked_actions(actions: Any, space: gymnasium.Space[Any]) -> torch.Tensor:
    """Actions as a tensor of the space's shape, float32; numbers beyond its bounds are the fleet's business.

    Raises:
        ValueError: for what are no numbers, or another shape.
    """
    wanted = f"give {'x'.join(map(str, space.shape or ()))} numbers in [-1, 1]"
    try:
        given = np.asarray(actions, dtype=np.float32)
    except (TypeError, ValueError) as error:
        raise ValueError(f"step: the action is {short(actions)}: {wanted}") from error
    if given.shape != space.shape:
        raise ValueError(f"step: the action has shape {given.shape}: {wanted}")
    return torch.as_tensor(given)


def spaces(fleet: FleetEnv) -> tuple[Box, Box]:
    """Observation and action space of one vehicle."""
    size = len(fleet.task.observation_names)
    bound = 2 * FARTHEST  # nothing observed can be larger, the body-frame error of a vehicle in a far corner included
    return Box(-bound, bound, (size,), np.float32), Box(-1.0, 1.0, fleet.action_spec.shape[1:], np.float32)


def reset_fleet(
    fleet: FleetEnv, seed: int | None, options: Mapping[str, Any] | None, now: TensorDictBase | None = None
) -> TensorDictBase:
    """Reset vehicles, from ``options["start"]`` where it is given; a ``seed`` begins all draws anew.

    Args:
        fleet: of N vehicles.
        seed: of starts and sensor noise; None lets the draws go on.
        options: None, or a ``start`` with a row for each of the N vehicles.
        now: what the fleet reported last, with ``_reset`` (N, 1) for the vehicles to be reset; None for all.

    Raises:
        ValueError: for any other option, or a start that the fleet refuses.
    """
    if seed is not None:
        fleet.set_seed(seed)
    if unknown := set(options or {}) - {"start"}:
        raise ValueError(f"reset: unknown options {sorted(unknown)}: there is start with {', '.join(BODY)}")
    if not options:
        return fleet.reset(now, set_state=False)
    start = {
        key: torch.as_tensor(np.asarray(value)).reshape(fleet.num_envs, -1) for key, value in options["start"].items()
    }
    given = TensorDict({}, fleet.batch_size) if now is None else now
    return fleet.reset(given.set("start", TensorDict(start, fleet.batch_size)), set_state=True)
