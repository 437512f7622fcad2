"""The held-out stretches flown again in MuJoCo, without and with the effects in the vehicle.

The diagnosis fits and predicts with the plain model. Here the same stretches, from the same estimated starts and with
the same commands, are flown by the simulator that training uses, all stretches as rows of one model.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.motion.actuation import actuate, left_by_volts, oldest
from auv_torchrl.diagnosis.motion.rollout import DIVERGING, late_steps, sample
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.validate.predict import Predictions, closed_share, errors_along, errors_by_kind
from auv_torchrl.diagnosis.verdict import Confirmation
from auv_torchrl.effects.effect import changed
from auv_torchrl.environment import environment
from auv_torchrl.extras import command, is_installed
from auv_torchrl.flightlog import Finding, Severity
from auv_torchrl.physics import Coefficients, State, prepare
from auv_torchrl.physics.step import memory_length
from auv_torchrl.simulator import replay
from auv_torchrl.vehicle import Vehicle, stacked


def is_possible() -> bool:
    """Whether MuJoCo is installed, which is then imported; nothing is drawn, so it need not look for a display."""
    with environment(MUJOCO_GL="disabled"):
        return is_installed("mujoco", "dm_control")


def not_confirmed() -> Finding:
    """That held-out flight was not flown again, because MuJoCo is not installed."""
    what = "What was found was not flown again in MuJoCo, which is not installed"
    return Finding(Severity.INFO, "not_confirmed", what, command("mujoco"))


@DIVERGING
def confirm(p: Predictions, vehicles: Sequence[Vehicle]) -> Confirmation:
    """Fly the stretches of ``p`` in MuJoCo and compare with what was measured.

    Args:
        p: predictions of the plain model for the same vehicles.
        vehicles: without and with the effects, empty batches.
    """
    states = fly_again(p.windows, vehicles, p.states[:, :, 0])
    c = prepare(stacked(vehicles)).numpy()
    reported = sample(p.windows, slice(0, len(p.windows)), c, states)
    again = replace(p, error=errors_along(p.windows, reported), states=states)
    return Confirmation(**errors_by_kind(again), closed=closed_share(again))


@DIVERGING
def fly_again(windows: Windows, vehicles: Sequence[Vehicle], starts: Floats) -> Floats:
    """States (W, V, S + 1, 13) of ``V`` vehicles over all windows in MuJoCo.

    Where the pose is reported late, the states are those of the time of the reports.

    Args:
        windows: what was commanded.
        vehicles: empty batches.
        starts: (W, V, 13) true states at the start of each window.
    """
    number, width = starts.shape[:2]
    one = stacked(vehicles)
    c = prepare(one).numpy()
    late = oldest(windows, c)
    in_report_time = changed(one, delay=one.delay + late, pose_delay=np.zeros_like(one.pose_delay))
    parts = windows.held.shape[2]
    held = windows.held.reshape(len(windows.held), -1, windows.held.shape[-1])
    control_dt = windows.dt / parts
    steps = windows.steps + late_steps(windows, c)
    share = thrust_shares(windows, c, steps)[..., None]
    each = in_report_time.expand(number, width)
    each = changed(each, gain=each.gain * share).reshape(-1)
    from auv_torchrl.simulator.mujoco import MujocoSimulator  # here, not above: MuJoCo need not be installed

    simulator = MujocoSimulator(each, control_dt)
    memory = memory_length(float(in_report_time.delay.max()), control_dt)
    begin, episode = parts * windows.start[:, None], windows.episode[:, None]
    ago = np.clip(begin - 1 - np.arange(memory), 0, None)
    ahead = np.clip(begin + np.arange(parts * steps), None, held.shape[1] - 1)
    flat = starts.reshape(number * width, 13)
    start = State(
        position=flat[:, :3],
        quaternion=flat[:, 3:7],
        velocity=flat[:, 7:],
        thrust=(actuate(windows, one).thrust / share).reshape(number * width, -1),
        commands=np.repeat(held[episode, ago], width, axis=0),
        time=(windows.time[:, None] - late).reshape(-1),
    )
    simulator.resume(start)
    commands = np.repeat(held[episode, ahead], width, axis=0)
    return replay(simulator, commands).states[:, ::parts].reshape(number, width, steps + 1, 13)


def thrust_shares(windows: Windows, c: Coefficients, steps: int) -> Floats:
    """Mean share (W, V) of their thrust that the logged volts leave vehicles in each window; 1 without volts."""
    grid = np.clip(windows.start[:, None] + np.arange(steps), 0, windows.commands.shape[1] - 1)
    left = left_by_volts(windows, c.rows((slice(None), None)), grid)
    return np.ones((len(windows), len(c.volts))) if left is None else left.mean(-1)
