"""From commands to the wrench on the body: delay, routing, curve, dead band, limit, lag, allocation."""

from collections.abc import Callable
from typing import Any

from array_api_compat import array_namespace, device

from auv_torchrl.physics.azimuths import azimuth_wrench
from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.kinematics import matvec

Array = Any
# What thrust targets depend on: vehicles that are equal in these have the same.
SENSE_FIELDS = ("forward_gain", "reverse_gain", "neutral_offset")  # what differs by the way in which it pushes
# What one command makes of a thruster.
CURVE_FIELDS = ("exponent", "asymmetry", "full_thrust", "limit", "dead_band", *SENSE_FIELDS)
TARGET_FIELDS = ("delay", "routing", *CURVE_FIELDS, "volts")
# Of thrust at one command, by volts: a T200 gives 3.71 kgf at 12 V, 5.25 at 16 V and 6.7 at 20 V (Blue Robotics,
# specification of the T200), which is a power of 1.2 between the first two, as a battery of four cells goes.
VOLTS_EXPONENT = 1.2
_SERVO_PARTS = 5  # of a time over which the turning of a servo is averaged
VOLTS_WITHIN = 0.5, 1.5  # times the volts of the file; others are no battery of these thrusters


def delayed(memory: Array, delay: Array, control_dt: float) -> Array:
    """A signal known once per control step, ``delay`` seconds ago, linear between control steps.

    ``memory`` (..., L, k) holds the newest value first; delays beyond (L - 1) steps give the oldest value.
    Differentiable in the delay.
    """
    xp = array_namespace(memory, delay)
    length = memory.shape[-2]
    age = xp.astype(xp.arange(length, device=device(memory)), memory.dtype)
    steps = xp.clip(delay / control_dt, 0.0, float(length - 1))
    weight = xp.clip(1.0 - xp.abs(age - steps[..., None]), 0.0, 1.0)
    return xp.sum(weight[..., None] * memory, axis=-2)


def thrust_target(c: Coefficients, terms: ActiveTerms, command: Array) -> Array:
    """Thrust in N that commands in [-1, 1] call for, (..., n): routing, curve, limit and dead band; no lag.

    Gains of one way are in it; the gain of both ways is not.
    """
    xp = array_namespace(command)
    command = xp.clip(command, -1.0, 1.0)
    if terms.routing:
        command = matvec(c.routing, command)
    if terms.curve:
        command = xp.clip(command - c.neutral_offset, -1.0, 1.0)
        size = xp.abs(command) ** c.exponent
        reverse = xp.where(command < 0, 1.0 - c.asymmetry, xp.ones_like(c.asymmetry))
        force = _within(c.full_thrust * reverse * xp.sign(command) * size, c.limit, c.dead_band)
        return xp.where(command < 0, c.reverse_gain, c.forward_gain) * force
    return _within(c.full_thrust * command, c.limit, c.dead_band)


def limited_thrust(command: Array, full_thrust: Array, limit: Array, dead_band: Array) -> Array:
    """Thrust in N that commands in [-1, 1] call for, (..., n), of thrusters that follow their own commands linearly."""
    return _within(full_thrust * array_namespace(command).clip(command, -1.0, 1.0), limit, dead_band)


def _within(force: Array, limit: Array, dead_band: Array) -> Array:
    xp = array_namespace(force)
    force = xp.minimum(xp.maximum(force, -limit), limit)
    return xp.where(xp.abs(force) < dead_band, xp.zeros_like(force), force)


def thrust_targets(
    c: Coefficients, terms: ActiveTerms, commands: Array, control_dt: float, stretches: int
) -> list[Array]:
    """Mean thrust target in N, (..., n), over each of ``stretches`` equal parts of a control step.

    ``commands`` (..., L, n) were held for one control step each, the newest first, and arrive ``c.delay`` late: a delay
    that is no whole number of control steps changes the target within one. Thrusts are averaged, not commands, because
    the dead band is not linear. Differentiable in the delay.
    """
    if commands.shape[-2] == 1:
        return [thrust_target(c, terms, commands[..., 0, :])] * stretches
    xp = array_namespace(commands)
    whole = xp.floor(c.delay / control_dt + 1e-6)
    late = xp.clip(c.delay / control_dt - whole, 0.0, 1.0)  # share of the step before the newer command arrives
    newer = thrust_target(c, terms, delayed(commands, whole * control_dt, control_dt))
    older = thrust_target(c, terms, delayed(commands, (whole + 1.0) * control_dt, control_dt))
    shares = [xp.clip(late * stretches - part, 0.0, 1.0)[..., None] for part in range(stretches)]
    return [newer + share * (older - newer) for share in shares]


def straight_through_targets(
    c: Coefficients, terms: ActiveTerms, commands: Array, control_dt: float, stretches: int
) -> list[Array]:
    """:func:`thrust_targets` on torch, with the gradient that there were without limits and dead bands.

    Theirs is zero where a policy must learn to leave them (Bengio et al. 2013, section 2, of thresholds in networks).
    """
    xp = array_namespace(commands)
    free = c._replace(limit=xp.full_like(c.limit, xp.inf), dead_band=xp.zeros_like(c.dead_band))
    truth = thrust_targets(c, terms, commands, control_dt, stretches)
    slopes = thrust_targets(free, terms, commands, control_dt, stretches)
    if all(target is truth[0] for target in truth):
        return [slopes[0] + (truth[0] - slopes[0]).detach()] * stretches
    return [slope + (value - slope).detach() for value, slope in zip(truth, slopes, strict=True)]


def thrust_after(c: Coefficients, terms: ActiveTerms, thrust: Array, target: Array, elapsed: float) -> Array:
    """Thrust in N, ``elapsed`` seconds after it was ``thrust``: exact first-order lag towards ``target``.

    The angle of a servo, in rad, does the same as far as its rate allows.
    """
    return thrust_follower(c, terms, elapsed)(thrust, target)


def thrust_follower(c: Coefficients, terms: ActiveTerms, elapsed: float) -> Callable[[Array, Array], Array]:
    """:func:`thrust_after` of one elapsed time, for many thrusts and their targets."""
    xp = array_namespace(c.lag)
    left = lag_left(c, elapsed) if terms.lag else None
    most = c.servo_rate * elapsed if terms.servos else None

    def after(thrust: Array, target: Array) -> Array:
        later = target if left is None else target + (thrust - target) * left
        if most is None:
            return later
        return xp.where(c.servo_rate > 0, thrust + xp.minimum(xp.maximum(later - thrust, -most), most), later)

    return after


def shares_turned(
    c: Coefficients, terms: ActiveTerms, before: Array, target: Array, elapsed: float
) -> tuple[Array, Array]:
    """Mean shares (..., n) over some seconds of servos that follow their targets from ``before``, and those at the end.

    Thrusters count as if they followed at once.
    """
    if not terms.servos:
        return target, target
    xp, share, total = array_namespace(target), before, 0.0 * target
    after = thrust_follower(c, terms, elapsed / _SERVO_PARTS)
    for _ in range(_SERVO_PARTS):
        later = after(share * c.full_thrust, target * c.full_thrust) / c.full_thrust
        total = total + (share + later) / 2
        share = later
    return xp.where((c.fin_area > 0) | (c.turns > 0), total / _SERVO_PARTS, target), share


def slowest_s(c: Coefficients, terms: ActiveTerms, time_constants: float) -> float:
    """Seconds for which thrusts and deflections remember older commands: of a lag, so many of its time constants."""
    xp = array_namespace(c.lag)
    memory = time_constants * float(xp.max(c.lag)) if terms.lag else 0.0
    if not terms.servos:
        return memory
    turning = c.servo_rate > 0
    rate = xp.where(turning, c.servo_rate, xp.ones_like(c.servo_rate))
    whole = xp.where(turning, 2.0 * xp.minimum(c.full_thrust, c.limit) / rate, xp.zeros_like(rate))
    return memory + float(xp.max(whole))


def lag_left(c: Coefficients, elapsed: float) -> Array:
    """Share (..., n) of the distance from its target that a thrust keeps for ``elapsed`` seconds."""
    xp = array_namespace(c.lag)
    instant = c.lag < 1e-6
    lag = xp.where(instant, xp.ones_like(c.lag), c.lag)
    return xp.where(instant, xp.zeros_like(lag), xp.exp(-elapsed / lag))


def body_wrench(c: Coefficients, terms: ActiveTerms, thrust: Array, time: Array) -> Array:
    """Forces in N and moments in N m on the body, (..., 6), ``time`` seconds into the episode."""
    wrench = matvec(c.allocation, thrust)
    if terms.azimuth:
        wrench = wrench + azimuth_wrench(c, thrust)
    if terms.battery_sag:
        wrench = wrench * (1.0 - c.battery_sag * time / 60.0)[..., None]
    return wrench


def at_volts(c: Coefficients, volts: Array) -> Array:
    """Factor on thrusts at these battery ``volts``, broadcast against ``c.volts``; 1 where thrust does not follow."""
    xp = array_namespace(volts)
    share = volts / xp.where(c.volts > 0, c.volts, xp.ones_like(c.volts))
    follows = (c.volts > 0) & (share > VOLTS_WITHIN[0]) & (share < VOLTS_WITHIN[1])
    return xp.where(follows, share, xp.ones_like(share)) ** VOLTS_EXPONENT


def load(c: Coefficients, thrust: Array) -> Array:
    """Share in [0, 1] of all full thrusts that thrusts (..., n) in N are: about how the current drawn goes."""
    xp = array_namespace(thrust)
    return xp.sum(xp.abs(thrust), axis=-1) / xp.sum(c.full_thrust, axis=-1)


def applied_thrust(c: Coefficients, terms: ActiveTerms, thrust: Array, time: Array) -> Array:
    """Thrust in N that each thruster really gives, (..., n): its gain and the battery included."""
    thrust = c.gain * thrust
    if terms.battery_sag:
        thrust = thrust * (1.0 - c.battery_sag * time / 60.0)[..., None]
    return thrust
