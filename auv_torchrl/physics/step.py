"""One control step of the plain model: pure, batch first, on numpy or torch."""

from typing import Any, NamedTuple

from array_api_compat import array_namespace

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.hydrodynamics import acceleration
from auv_torchrl.physics.kinematics import matvec, normalise, quaternion_rate, rotation_matrix
from auv_torchrl.physics.thrusters import body_wrench, delayed, thrust_after, thrust_target

Array = Any

CONTROL_DT = 0.05  # s; explicit Euler on Table 1 at 2 m/s is stable only below 0.04 s, RK4 at half this step is
SUBSTEPS = 2  # RK4 steps per control step: 0.07 mm off after 20 s


class State(NamedTuple):
    """State of a batch of vehicles; arrays ``(batch, ...)``, all numpy or all torch."""

    position: Array  # (3,) m, earth NED
    quaternion: Array  # (4,) w x y z, body to earth
    velocity: Array  # (6,) m/s, rad/s, body FRD, over ground
    thrust: Array  # (n,) N, before gains
    commands: Array  # (L, n) commands sent, newest first
    time: Array  # () s since the start of the episode


def memory_length(longest_delay: float, control_dt: float = CONTROL_DT) -> int:
    """Number of past commands that a delay of up to ``longest_delay`` seconds needs."""
    return int(-(-longest_delay // control_dt)) + 1


def rest_state(position: Array, quaternion: Array, velocity: Array, thrusters: int, memory: int = 1) -> State:
    """State with silent thrusters: ``position`` (..., 3), ``quaternion`` (..., 4), ``velocity`` (..., 6)."""
    xp = array_namespace(position, quaternion, velocity)
    batch = position.shape[:-1]
    like = {"dtype": position.dtype, "device": position.device}
    return State(
        position, quaternion, velocity,
        xp.zeros((*batch, thrusters), **like), xp.zeros((*batch, memory, thrusters), **like), xp.zeros(batch, **like),
    )  # fmt: skip


def push(memory: Array, newest: Array) -> Array:
    """Put ``newest`` (..., k) at the front of ``memory`` (..., L, k) and drop the oldest."""
    xp = array_namespace(memory, newest)
    return xp.concat((newest[..., None, :], memory[..., :-1, :]), axis=-2)


def control_step(
    c: Coefficients,
    terms: ActiveTerms,
    state: State,
    command: Array,
    control_dt: float = CONTROL_DT,
    substeps: int = SUBSTEPS,
) -> State:
    """Hold ``command`` (..., n) in [-1, 1] for ``control_dt`` seconds: ``substeps`` Runge-Kutta steps of order 4."""
    commands = push(state.commands, command)
    reaching = delayed(commands, c.delay, control_dt) if commands.shape[-2] > 1 else command
    target = thrust_target(c, terms, reaching)
    h = control_dt / substeps
    body = (state.position, state.quaternion, state.velocity)

    def rate(body: tuple[Array, Array, Array], elapsed: float) -> tuple[Array, Array, Array]:
        position, quaternion, velocity = body
        rotation = rotation_matrix(normalise(quaternion))
        thrust = thrust_after(c, terms, state.thrust, target, elapsed)
        wrench = body_wrench(c, terms, thrust, state.time + elapsed)
        return (
            matvec(rotation, velocity[..., :3]),
            quaternion_rate(quaternion, velocity[..., 3:]),
            acceleration(c, terms, rotation, position, velocity, wrench),
        )

    def ahead(body: tuple, slope: tuple, dt: float) -> tuple:
        return tuple(x + dt * k for x, k in zip(body, slope, strict=True))

    for step in range(substeps):
        start = step * h
        k1 = rate(body, start)
        k2 = rate(ahead(body, k1, h / 2), start + h / 2)
        k3 = rate(ahead(body, k2, h / 2), start + h / 2)
        k4 = rate(ahead(body, k3, h), start + h)
        mean = tuple((a + 2 * b + 2 * d + e) / 6 for a, b, d, e in zip(k1, k2, k3, k4, strict=True))
        position, quaternion, velocity = ahead(body, mean, h)
        body = (position, normalise(quaternion), velocity)
    position, quaternion, velocity = body
    thrust = thrust_after(c, terms, state.thrust, target, control_dt)
    return State(position, quaternion, velocity, thrust, commands, state.time + control_dt)
