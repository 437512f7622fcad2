"""An exported policy in flight: onnxruntime and numpy, neither torch nor torchrl.

    pilot = ExportedPolicy(Path("outputs/export/mine"))
    command = pilot.command(position, quaternion, velocity, time_s)

Whoever calls sends the command to the vehicle and holds it for ``control_dt`` seconds.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from auv_torchrl.export.contract import TILT, ContractError, motion_name, read_export
from auv_torchrl.extras import library
from auv_torchrl.physics.kinematics import rotation_matrix
from auv_torchrl.tasks import read_task
from auv_torchrl.vehicle.fields import DEGREES_OF_FREEDOM

Array = Any
_MOTION = (*map(motion_name, DEGREES_OF_FREEDOM), *TILT)


class ExportedPolicy:
    """What a vehicle is to do, by the files of an export. All arrays are batch first: N vehicles, or one as (1, ...).

    Args:
        folder: that ``auv-export`` wrote.
        task: another task that is seen in the same way, as in ``conf/task``; None for the one of the contract.

    Raises:
        ContractError: for a folder that is none, or was changed, or a task that the policy does not see in its way.
        MissingLibrary: where onnxruntime is not installed.
    """

    def __init__(self, folder: Path, task: Mapping[str, Any] | None = None):
        runtime = library("onnxruntime", "flying an export needs", "fly")
        self.contract, files = read_export(Path(folder))
        options = runtime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1  # the networks are small: a second one waits
        options.log_severity_level = 3
        self._sessions = {
            name: runtime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
            for name, data in files.items()
        }
        self.task = read_task(self.contract["task"] if task is None else task)
        seen = [entry["name"] for entry in self.contract["files"]["policy"]["inputs"][0]["entries"]]
        if list(self.task.observation_names) != seen:
            raise ContractError(
                f"{folder}: task {self.task.name} observes {list(self.task.observation_names)} here, and the policy "
                f"was trained on {seen}: export it anew with this version, or give a task that observes these"
            )
        trained = read_task(self.contract["task"])
        if (self.task.control_dt, self.task.thruster_commands) != (trained.control_dt, trained.thruster_commands):
            raise ContractError(
                f"task {self.task.name} has another control_dt or thruster_commands than the policy was trained with: "
                f"give {trained.control_dt:g} and {str(trained.thruster_commands).lower()}"
            )
        self.control_dt = float(self.contract["control_dt_s"])
        adapter = self.contract["adapter"]
        self.adapter: Mapping[str, Any] | None = adapter
        self._moving = [] if adapter is None else self._places("F")
        self.state = {} if adapter is None else {n: np.array(v, np.float32) for n, v in adapter["state"].items()}

    @property
    def outputs(self) -> int:
        """Number of commands: the channels, or the thrusters."""
        return len(self.contract["command"])

    def run(self, file: str, **inputs: Array) -> Array:
        """The output of one of the files."""
        given = {name: np.ascontiguousarray(value, np.float32) for name, value in inputs.items()}
        (output,) = self._sessions[file].run(None, given)
        return output

    def observe(self, position: Array, quaternion: Array, velocity: Array, time_s: Array) -> Array:
        """What the policy sees (N, d) of measured position (N, 3), quaternion (N, 4) and velocity (N, 6), (N,) s on."""
        parts = (np.asarray(part, np.float64) for part in (position, quaternion, velocity, time_s))
        return self.task.observe(*parts).astype(np.float32)

    def action(self, observation: Array) -> Array:
        """The action (N, a) in [-1, 1] for an observation (N, d)."""
        return self.run("policy", observation=observation)

    def translate(self, quaternion: Array, velocity: Array, action: Array) -> Array:
        """The commands (N, k) in [-1, 1] that do on the changed vehicle what actions (N, a) do on the source."""
        assert self.adapter is not None
        state = self.motion(quaternion, velocity)
        action = np.clip(np.nan_to_num(action, nan=0.0), -1.0, 1.0)
        if self.adapter["composition"] == "long":
            tau = self.run("R", state=state, next_state=self.run("F", state=state, action=action))
        else:
            tau = self.run("intended", action=action)
        return self.run("H", state=state, tau=tau, **self.state)

    def command(self, position: Array, quaternion: Array, velocity: Array, time_s: Array) -> Array:
        """The command (N, k) in [-1, 1]; 0 for a vehicle of which a measurement or a result is no finite number."""
        count = len(position)
        given = [np.reshape(part, (count, -1)) for part in (position, quaternion, velocity, time_s)]
        finite = np.isfinite(np.concatenate(given, axis=-1)).all(-1, keepdims=True)
        level = np.array([1.0, 0.0, 0.0, 0.0])
        place, attitude, speed, along = (
            np.where(finite, part, rest) for part, rest in zip(given, (0.0, level, 0.0, 0.0), strict=True)
        )
        command = action = self.action(self.observe(place, attitude, speed, along[:, 0]))
        if self.adapter is not None and self.adapter["fitted"]:  # else it is the source vehicle, and flies as trained
            command = self.translate(attitude, speed, action)
        finite = finite & np.isfinite(action).all(-1, keepdims=True) & np.isfinite(command).all(-1, keepdims=True)
        return np.where(finite, np.clip(command, -1.0, 1.0), 0.0)

    def motion(self, quaternion: Array, velocity: Array) -> Array:
        """The motion x (N, s) that F, R, G and H read: speeds of the channels, and tilt where the task has any."""
        down = rotation_matrix(np.asarray(quaternion, np.float64))[..., 2, :2]
        return np.concatenate((velocity, down), axis=-1)[..., self._moving]

    def _places(self, file: str) -> list[int]:
        """Of what a file reads of the motion, among all velocities and the tilt."""
        (state,) = (given for given in self.contract["files"][file]["inputs"] if given["name"] == "state")
        return [_MOTION.index(entry["name"]) for entry in state["entries"]]

    def thrusters(self, command: Array) -> Array:
        """Commands (N, n) of the thrusters in [-1, 1], of commands (N, k), mixed where those are channels."""
        if not self.contract["vehicle"]["mixed"]:
            return command
        return np.clip(command @ np.array(self.contract["vehicle"]["mixer"]).T, -1.0, 1.0)
