"""One control step of the plain model: pure, batch first, on numpy or torch."""

from collections.abc import Callable
from typing import Any, NamedTuple

from array_api_compat import array_namespace

from auv_torchrl.array_api import like
from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.fins import fin_wrench
from auv_torchrl.physics.hydrodynamics import acceleration
from auv_torchrl.physics.kinematics import matvec, normalise, rotation_and_rate
from auv_torchrl.physics.pace import CONTROL_DT, SUBSTEPS
from auv_torchrl.physics.surface import given_in_water
from auv_torchrl.physics.thrusters import body_wrench, thrust_after, thrust_targets

Array = Any


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
    kind = like(position)
    return State(
        position, quaternion, velocity,
        xp.zeros((*batch, thrusters), **kind), xp.zeros((*batch, memory, thrusters), **kind), xp.zeros(batch, **kind),
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
    advance: Callable[..., tuple[Array, Array]] | None = None,
    aim: Callable[..., list[Array]] = thrust_targets,
) -> State:
    """Hold ``command`` (..., n) in [-1, 1] for ``control_dt`` seconds: ``substeps`` Runge-Kutta steps of order 4.

    ``advance`` is a compiled form of :func:`runge_kutta_steps`, None the plain one; ``aim`` gives the thrust targets.
    """
    advance = advance or runge_kutta_steps
    xp = array_namespace(command)
    commands = push(state.commands, command) if state.commands.shape[-2] > 1 else command[..., None, :]
    h = control_dt / substeps
    body = xp.concat((state.position, state.quaternion, state.velocity), axis=-1)
    targets = aim(c, terms, commands, control_dt, substeps)
    body, thrust = advance(c, terms, body, state.thrust, targets, state.time, h)
    position, quaternion, velocity = body[..., :3], body[..., 3:7], body[..., 7:]
    return State(position, quaternion, velocity, thrust, commands, state.time + control_dt)


def runge_kutta_steps(
    c: Coefficients,
    terms: ActiveTerms,
    body: Array,
    thrust: Array,
    targets: list[Array],
    time: Array,
    h: float,
    step: Callable[..., tuple[Array, Array]] | None = None,
) -> tuple[Array, Array]:
    """``body`` and ``thrust`` after a step of ``h`` seconds towards each of ``targets``; see :func:`runge_kutta_step`.

    ``step`` is a compiled form of that, None the plain one.
    """
    step = step or runge_kutta_step
    for target in targets:
        body, thrust = step(c, terms, body, thrust, target, time, h)
        time = time + h
    return body, thrust


def stage_thrusts(
    c: Coefficients, terms: ActiveTerms, thrust: Array, targets: list[Array], time: Array, h: float
) -> tuple[list[tuple[Array, Array]], Array]:
    """Thrust (..., n) and time (...) at each of the four stages of steps of ``h`` seconds, and the last thrust.

    Where the push of the thrusters is the same at all stages, there is one. Arguments as of :func:`runge_kutta_steps`.
    """
    if not (terms.lag or terms.battery_sag or terms.servos) and all(target is targets[0] for target in targets):
        return [(targets[0], time)], targets[0]
    stages = []
    for target in targets:
        stages += [(thrust_after(c, terms, thrust, target, e), time + e) for e in (0.0, h / 2, h / 2, h)]
        thrust, time = thrust_after(c, terms, thrust, target, h), time + h
    return stages, thrust


def runge_kutta_step(
    c: Coefficients,
    terms: ActiveTerms,
    body: Array,
    thrust: Array,
    target: Array,
    time: Array,
    h: float,
    force: Array | float = 0.0,
) -> tuple[Array, Array]:
    """``body`` (..., 13), position, quaternion and velocity, and ``thrust`` (..., n), ``h`` seconds later.

    ``force`` (..., 6) in N and N m, body frame, acts besides the thrusters.
    """
    xp = array_namespace(body)
    later = thrust_after(c, terms, thrust, target, h)
    stages = [(later, time)]
    if terms.lag or terms.battery_sag or terms.servos:
        first = thrust_after(c, terms, thrust, target, 0.0)  # the new target at once where a thruster has no lag
        midway = thrust_after(c, terms, thrust, target, h / 2)
        stages = [(first, time), (midway, time + h / 2), (later, time + h)]
    # the wrench is the same wherever the body is, but for thrusters that leave the water
    wrenches = [] if terms.surface else [body_wrench(c, terms, given, at) + force for given, at in stages]

    def slope(body: Array, stage: int) -> Array:
        position, velocity = body[..., :3], body[..., 7:]
        rotation, turning = rotation_and_rate(body[..., 3:7], velocity[..., 3:])
        if terms.surface:
            given, at = stages[stage]
            wrench = body_wrench(c, terms, given_in_water(c, terms, given, rotation, position), at) + force
        else:
            wrench = wrenches[stage]
        if terms.fins:
            wrench = wrench + fin_wrench(c, terms, rotation, position, velocity, stages[stage][0])
        rate = acceleration(c, terms, rotation, position, velocity, wrench)
        return xp.concat((matvec(rotation, velocity[..., :3]), turning, rate), axis=-1)

    midst = len(stages) // 2
    k1 = slope(body, 0)
    k2 = slope(body + h / 2 * k1, midst)
    k3 = slope(body + h / 2 * k2, midst)
    k4 = slope(body + h * k3, -1)
    body = body + h / 6 * (k1 + 2 * (k2 + k3) + k4)
    return xp.concat((body[..., :3], normalise(body[..., 3:7]), body[..., 7:]), axis=-1), later
