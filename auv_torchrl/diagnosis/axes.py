"""Which axes a log measures, which of them can be followed, and what stays unseen without the others."""

import math
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.actuation import usual_speed
from auv_torchrl.diagnosis.thresholds import SMALL_SWING, STEEP
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import POSE, Finding, FlightLog, FlightLogError, Severity
from auv_torchrl.flightlog.log import ACCELERATION, AXES, with_axes
from auv_torchrl.flightlog.readiness import followed_axes
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.pushes import wrench_per_unit
from auv_torchrl.quantities import percent
from auv_torchrl.vehicle import DEGREES_OF_FREEDOM, Vehicle

DARK = 1e-3  # of the largest push, below which a thruster does not act in a degree of freedom
REMEDY = {"surge": "x, y and yaw, or u", "sway": "x, y and yaw, or v", "heave": "z or w", "roll": "roll or p",
          "pitch": "pitch or q", "yaw": "yaw or r"}  # fmt: skip


def followable(log: FlightLog) -> FlightLog:
    """The log with those axes alone that :func:`auv_torchrl.flightlog.readiness.followed_axes` leaves; findings say so.

    Raises:
        FlightLogError: if no axis is left.
    """
    axes, findings = followed_axes(log.name, log.axes)
    return restricted(replace(log, findings=(*log.findings, *findings)), axes) if findings else log


def restricted(log: FlightLog, axes: tuple[str, ...]) -> FlightLog:
    """The log with those of its axes alone.

    Raises:
        FlightLogError: if it has none of them.
    """
    kept = tuple(axis for axis in AXES if axis in axes and axis in log.axes)
    if not kept:
        raise FlightLogError(f"{log.name} measures {', '.join(log.axes)}, the log to explain {', '.join(axes)}: "
                             "give logs with axes in common")  # fmt: skip
    return replace(log, axes=kept, episodes=tuple(with_axes(episode, kept) for episode in log.episodes))


def hidden_freedoms(problem: Problem) -> list[str]:
    """The degrees of freedom in which the vehicle moves and that the log does not measure."""
    moves = np.flatnonzero(problem.vehicle.free > 0)
    return [DEGREES_OF_FREEDOM[d] for d in moves if d not in problem.layout.dof]


def examined(problem: Problem) -> tuple[str, ...]:
    """The degrees of freedom that the log measures, where these are not all in which the vehicle moves; else none."""
    return tuple(DEGREES_OF_FREEDOM[d] for d in problem.layout.dof) if hidden_freedoms(problem) else ()


def unseen(problem: Problem) -> list[str]:
    """Sentences about the degrees of freedom in which the vehicle moves and that the log does not measure."""
    hidden = hidden_freedoms(problem)
    if not hidden:
        return []
    remedies = dict.fromkeys(REMEDY[name] for name in hidden)
    sentence = f"{', '.join(hidden)} {'is' if len(hidden) == 1 else 'are'} not measured: no gap there can be seen"
    c = prepare(problem.vehicle.expand(1)).numpy()
    push = np.abs(wrench_per_unit(c, ActiveTerms.of(c), usual_speed(problem.windows))[0])
    seen = push[problem.layout.dof]
    unlit = seen.max(0) < DARK * push.max()
    turning = (push[problem.layout.dof[problem.layout.dof < 3]].max(0, initial=0.0) < DARK * push.max()) & ~unlit
    if unlit.any():
        sentence += f", nor what {_thrusters(unlit)} {'do' if unlit.sum() > 1 else 'does'}"
    if turning.any():
        sentence += f"; {_thrusters(turning)} {'show' if turning.sum() > 1 else 'shows'} by turning the vehicle alone"
    return [f"{sentence}; log {'; '.join(remedies)}"]


def _thrusters(which: np.ndarray) -> str:
    """Names of thrusters by a mask (n,)."""
    return f"thruster{'s' if which.sum() > 1 else ''} {', '.join(str(i + 1) for i in np.flatnonzero(which))}"


def steep_stretches(log: FlightLog) -> tuple[Finding, ...]:
    """What is said of a log in which the vehicle points straight up or down."""
    steep = [np.abs(episode.pose[:, POSE.index("pitch")]) > STEEP for episode in log.episodes]
    share = float(np.concatenate(steep).mean())
    if not share:
        return ()
    sentence = (
        f"the vehicle points straight up or down in {percent(share)} of the samples, where roll and yaw are not "
        "defined: they do not count there"
    )
    return (Finding(Severity.WARNING, "steep", sentence, "Log stretches in which it stays upright", ("pitch",)),)


TILT = (3, 4)  # degrees of freedom
USUALLY = 95.0  # per cent of samples: single ones are noise
_MOST_ODDS = 700.0  # log odds whose exponential is a number


def hold_attitude(log: FlightLog, vehicle: Vehicle) -> Vehicle:
    """The vehicle with roll and pitch held where the log does not show them move, and feels no weight along them."""
    if set(ACCELERATION) & set(log.axes):
        return vehicle
    swings = []
    for axis, rate, column in (("roll", "p", 3), ("pitch", "q", 4)):
        if axis in log.axes:
            swings += [np.ptp(episode.pose[:, column]) for episode in log.episodes]
        elif rate in log.axes:  # swings of a second or more
            swings += [np.nanpercentile(np.abs(episode.velocity[:, column]), USUALLY) for episode in log.episodes]
    if swings and max(swings) > SMALL_SWING:
        return vehicle
    return held_level(vehicle)


def held_level(vehicle: Vehicle) -> Vehicle:
    """The vehicle with roll and pitch held."""
    return changed(vehicle, free=vehicle.free * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 1.0]))


def is_hidden(log: FlightLog, vehicle: Vehicle) -> bool:
    """Whether the vehicle may roll and pitch and the log measures neither."""
    return bool((vehicle.free[..., TILT] > 0).any()) and not {"roll", "pitch", "p", "q"} & set(log.axes)


def attitude_finding(free: bool, odds: float) -> Finding:
    """What was decided, with the probability that follows from the log odds for it."""
    how = "free to roll and pitch" if free else "held level"
    sure = percent(1.0 / (1.0 + math.exp(-min(odds, _MOST_ODDS))))
    sentence = f"roll and pitch are not measured; the log is explained better by a vehicle {how}, to {sure}"
    return Finding(Severity.INFO, "attitude_free" if free else "attitude_held", sentence)


def level_enough() -> Finding:
    """What is said where a level vehicle leaves nothing to explain."""
    sentence = "roll and pitch are not measured; a vehicle held level explains the log wholly, no tilt was looked for"
    return Finding(Severity.INFO, "attitude_held", sentence)
