"""Many vehicles over many windows in one batched rollout of the project's physics.

Thrust depends on commands alone, so it is worked out before the body moves: each window starts with the thrust that
its commands have left behind. A force that no term explains enters through six virtual thrusters, one per degree of
freedom, so that the equations of motion stay those of :mod:`auv_torchrl.physics`.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from auv_torchrl.diagnosis.motion.windows import CHANNELS, Floats, Windows
from auv_torchrl.physics import ActiveTerms, Coefficients, State, control_step, prepare
from auv_torchrl.physics.kinematics import euler_angles, quaternion_from_euler
from auv_torchrl.physics.sensors import measured_pose
from auv_torchrl.physics.thrusters import thrust_after, thrust_targets
from auv_torchrl.vehicle import Vehicle

VIRTUAL_FULL = 1e5  # N and N m at a virtual command of 1, far above any force on these vehicles
ROWS_AT_ONCE = 3000  # rows of a chunk: what stays in the cache of a laptop
LAG_MEMORY = 6.0  # time constants after which 0.25 % of an old thrust is left


DIVERGING = np.errstate(over="ignore", invalid="ignore", divide="ignore")  # such a candidate predicts NaN and loses


@dataclass(frozen=True)
class Actuation:
    """What ``R`` vehicles do with the logged commands, before any motion."""

    c: Coefficients  # (R, ...); their delay is what is left of it behind whole grid steps
    terms: ActiveTerms
    late: bool  # whether any delay is left
    reaching: Floats  # (U, E, T, n) commands behind whole grid steps of delay, for each different number of them
    which: np.ndarray  # (R,) row of reaching
    thrust: Floats  # (W, R, n) N, at the start of each window
    substeps: int  # Runge-Kutta steps per grid step

    @cached_property
    def pushed(self) -> Coefficients:
        """The coefficients with virtual thrusters."""
        return with_virtual_thrusters(self.c)

    def memory(self, episode: np.ndarray, grid: np.ndarray) -> Floats:
        """Commands (w, R, L, n) for grid steps (w,) of episodes (w,), the newest first, as the physics takes them."""
        grid = np.clip(grid, 0, self.reaching.shape[2] - 1)
        ages = (0, 1) if self.late else (0,)
        held = np.stack([self.reaching[:, episode, np.maximum(grid - age, 0)] for age in ages], axis=-2)
        return held[self.which].swapaxes(0, 1)


def actuate(windows: Windows, vehicle: Vehicle) -> Actuation:
    """Delay the commands and let the lag run up to the start of each window; ``vehicle`` is a batch (R,)."""
    c = prepare(vehicle).numpy()
    terms = ActiveTerms.of(c)
    total = np.maximum(c.delay + c.pose_delay, 0.0)  # a late pose sees the motion that older commands made
    whole = np.floor(total / windows.dt + 1e-6)
    c = c._replace(delay=np.maximum(total - whole * windows.dt, 0.0))
    different, which = np.unique(whole.astype(int), return_inverse=True)
    steps = np.arange(windows.commands.shape[1])
    reaching = np.stack([windows.commands[:, np.maximum(steps - shift, 0)] for shift in different])
    late = bool((c.delay > 1e-6 * windows.dt).any())
    silent = np.zeros((len(windows), len(total), c.full_thrust.shape[-1]))
    number = max(_substeps(windows, c), 2 if late else 1)  # some commands arrive within a grid step
    actuation = Actuation(c, terms, late, reaching, which, silent, number)
    if terms.lag:
        thrust = actuation.thrust
        back = int(np.ceil(LAG_MEMORY * c.lag.max() / windows.dt))
        for ago in range(back, 0, -1):
            target = grid_thrust(windows, actuation, windows.start - ago)
            thrust = target if ago == back else thrust_after(c, terms, thrust, target, windows.dt)
        actuation = replace(actuation, thrust=thrust)
    return actuation


def grid_thrust(windows: Windows, actuation: Actuation, grid: np.ndarray) -> Floats:
    """Mean thrust target (W, R, n) in N of every window during a grid step (W,) of its episode."""
    memory = actuation.memory(windows.episode, grid)
    return thrust_targets(actuation.c, actuation.terms, memory, windows.dt, 1)[0]


@DIVERGING
def simulate(windows: Windows, vehicle: Vehicle, start: Floats, force: Floats | None = None) -> Floats:
    """Predicted samples (W, R, m, C) of ``R`` vehicles over all windows.

    Args:
        windows: what was commanded and when samples were taken.
        vehicle: batch (R,).
        start: (W, R, 12) true position, roll, pitch, measured yaw, and body velocity at the start.
        force: (W, R, S, 6) in N and N m, body frame, that acts besides what the vehicle does; None for none.

    Any of the three may have one row for all the others'.
    """
    actuation = actuate(windows, vehicle)
    steps = windows.steps + late_steps(windows, actuation.c)
    rows = max(len(actuation.which), start.shape[1], 1 if force is None else force.shape[1])
    pieces = [
        sample(windows, chunk, actuation.c, path(windows, chunk, actuation, start, force, steps, rows))
        for chunk in _chunks(len(windows), rows)
    ]
    return np.concatenate(pieces)


def _substeps(windows: Windows, c: Coefficients) -> int:
    """Runge-Kutta steps per grid step that keep order 4 accurate at the speeds that were flown."""
    speed = np.quantile(np.abs(windows.guess[:, 6:]), 0.99, axis=0)
    linear = np.diagonal(c.linear_drag, axis1=-2, axis2=-1)
    rate = (linear + 2 * c.quadratic_drag * speed) * np.diagonal(c.mass_inverse, axis1=-2, axis2=-1)
    return max(1, int(np.ceil(windows.dt * rate.max() / 1.6)))


def _chunks(windows: int, rows: int) -> Iterator[slice]:
    width = max(1, ROWS_AT_ONCE // rows)
    for first in range(0, windows, width):
        yield slice(first, min(windows, first + width))


@DIVERGING
def path(
    windows: Windows, chunk: slice, actuation: Actuation, start: Floats, force: Floats | None, steps: int, rows: int
) -> Floats:
    """True states (w, R, steps + 1, 13) on the grid: position, quaternion, body velocity."""
    state = begin(windows, chunk, actuation, start, rows, force is not None)
    states = np.empty((*state.position.shape[:2], steps + 1, 13))
    states[:, :, 0] = np.concatenate([state.position, state.quaternion, state.velocity], axis=-1)
    for k in range(steps):
        pushed = None if force is None else force[chunk, :, min(k, force.shape[2] - 1)]
        state = step(windows, chunk, actuation, state, k, pushed)
        states[:, :, k + 1] = np.concatenate([state.position, state.quaternion, state.velocity], axis=-1)
    return states


def late_steps(windows: Windows, c: Coefficients) -> int:
    """Grid steps behind the end of a window in which its last velocities are measured, where poses are late."""
    late = c.pose_delay.max() if any(channel in CHANNELS[6:] for channel in windows.channels) else 0.0
    return int(np.ceil(late / windows.dt - 1e-9))


def begin(windows: Windows, chunk: slice, actuation: Actuation, start: Floats, rows: int, forced: bool) -> State:
    """State (w, R, ...) at the start of some windows, with virtual thrusters where a force will act."""
    c = actuation.c
    first = np.broadcast_to(start[chunk], (chunk.stop - chunk.start, rows, 12))
    quaternion = quaternion_from_euler(first[..., 3], first[..., 4], first[..., 5] - c.heading_bias)
    thrust = np.broadcast_to(actuation.thrust[chunk], (*first.shape[:2], actuation.thrust.shape[-1]))
    if forced:
        thrust = np.concatenate([thrust, np.zeros((*thrust.shape[:-1], 6))], axis=-1)
    commands = np.zeros((*first.shape[:2], 1, thrust.shape[-1]))
    time = windows.time[chunk, None] - c.pose_delay
    return State(first[..., :3], quaternion, first[..., 6:], thrust, commands, time)


def step(
    windows: Windows, chunk: slice, actuation: Actuation, state: State, k: int, force: Floats | None = None
) -> State:
    """The state one grid step later than step ``k`` of some windows, pushed by a force (w, R, 6) if one is given."""
    shape = state.position.shape[:2]
    memory = actuation.memory(windows.episode[chunk], windows.start[chunk] + k)
    memory = np.broadcast_to(memory, (*shape, *memory.shape[-2:]))
    c = actuation.c
    if force is not None:
        c = actuation.pushed
        pushed = np.broadcast_to(force[:, :, None] / VIRTUAL_FULL, (*shape, memory.shape[-2], 6))
        memory = np.concatenate([memory, pushed], axis=-1)
    if actuation.late:
        state = state._replace(commands=memory[..., [1, 1], :])  # the physics puts the newest before them
    return control_step(c, actuation.terms, state, memory[..., 0, :], windows.dt, actuation.substeps)


def with_virtual_thrusters(c: Coefficients) -> Coefficients:
    """The coefficients (R, ...) with six more thrusters, linear and instant, one per degree of freedom."""
    rows, n = c.full_thrust.shape

    def more(values: Floats, fill: float) -> Floats:
        return np.concatenate([values, np.full((rows, 6), fill)], axis=-1)

    routing = np.tile(np.eye(n + 6), (rows, 1, 1))
    routing[:, :n, :n] = c.routing
    axes = np.broadcast_to(np.eye(6), (rows, 6, 6))
    return c._replace(
        allocation=np.concatenate([c.allocation, axes], axis=-1),
        routing=routing,
        full_thrust=more(c.full_thrust, VIRTUAL_FULL),
        asymmetry=more(c.asymmetry, 0.0),
        exponent=more(c.exponent, 1.0),
        dead_band=more(c.dead_band, 0.0),
        limit=more(c.limit, VIRTUAL_FULL),
        lag=more(c.lag, 0.0),
    )


def sample(windows: Windows, chunk: slice, c: Coefficients, states: Floats) -> Floats:
    """What the sensors report of ``states`` (w, R, steps + 1, 13) at the times of the samples: (w, R, m, C)."""
    pose = states[..., None, :7]
    turned = c._replace(heading_bias=c.heading_bias[:, None])
    position, quaternion = measured_pose(turned, pose, windows.dt)
    angles = np.stack(euler_angles(quaternion), axis=-1)
    if windows.fraction.any():
        angles = np.unwrap(angles, axis=2)  # interpolation must not cross the cut at pi
    values = np.concatenate([position, angles, states[..., 7:]], axis=-1)
    at = (windows.index + windows.fraction)[chunk, None]
    late = (c.pose_delay / windows.dt)[:, None]
    return np.stack(
        [
            _read(values[..., CHANNELS.index(name)], at + late if name in CHANNELS[6:] else at)
            for name in windows.channels
        ],
        axis=-1,
    )


def _read(series: Floats, at: Floats) -> Floats:
    """Linear interpolation of ``series`` (w, R, L) at grid positions ``at`` (w, R or 1, m)."""
    at = np.broadcast_to(at, (*series.shape[:2], at.shape[-1]))
    whole = np.minimum(np.floor(at + 1e-9).astype(int), series.shape[-1] - 1)
    here = np.take_along_axis(series, whole, axis=-1)
    part = at - whole
    if not (part > 1e-6).any():
        return here
    ahead = np.take_along_axis(series, np.minimum(whole + 1, series.shape[-1] - 1), axis=-1)
    return here + part * (ahead - here)
