"""What can be wrong with a log while its vehicle is what it was: damages of the raw columns that a file holds.

A damage changes columns as they are logged (``damage_acts.py``) and says by which names an answer tells of it: codes of
findings, or effects.
"""

from dataclasses import dataclass

import numpy as np

from benchmarks.blind.damage_acts import (
    VELOCITIES,
    Act,
    Columns,
    Damaged,
    Rng,
    coarse,
    constant,
    frozen,
    jump,
    late_velocity,
    nothing,
    one_sided,
    repeats,
    scaled_velocity,
    slow_sensor,
    spikes,
    times,
    turned,
)

POSES = ("x", "y", "z", "yaw")
BOTH = POSES + VELOCITIES
HEAVE, HORIZONTAL = "heave", "horizontal"  # where a fault can show
ALL = frozenset((HEAVE, HORIZONTAL))
FOOT, CENTIMETRE, KNOT = 0.3048, 0.01, 0.514444  # m, m, m/s


@dataclass(frozen=True)
class Damage:
    """One way to damage a log, and how an answer names it."""

    name: str
    act: Act  # gives new columns, those it gets stay
    codes: tuple[str, ...]  # of findings, one of which names it,
    effects: tuple[str, ...] = ()  # as does one of these effects
    partly: tuple[str, ...] = ()  # effects that are no wrong cause beside what names it, such as "thruster_gain 5 6"
    mentions: bool = False  # the findings must mention every damaged column
    hides: frozenset[str] = frozenset()  # where a fault shows no more in what is left of the log
    axes: tuple[str, ...] = POSES  # what is flown with it
    healthy: bool = False  # the fault is in the healthy log too


def shows_fault(damage: Damage, fault: str, values: dict[str, float]) -> bool:
    """Whether the rest of a damaged log still shows a fault of these values."""
    if fault == "thruster_gain":
        vertical = all(values.get(f"gain_{i}", 1.0) == 1.0 for i in range(1, 5))
        shows = {HEAVE} if vertical else {HORIZONTAL}
    else:
        shows = FAULTS[fault]
    return not shows <= damage.hides


def can_show(damage: Damage, fault: str) -> bool:
    """Whether there is a size of the fault that shows beside the damage."""
    return not FAULTS[fault] <= damage.hides


def damaged(columns: Columns, damage: Damage, rng: Rng) -> Damaged:
    """The columns with the damage, and the names of those that it changed.

    Raises:
        ValueError: for a log that lacks a column that the damage needs.
    """
    if missing := set(damage.axes) - set(columns):
        raise ValueError(f"{damage.name} needs {', '.join(sorted(missing))}: the log has {', '.join(columns)}")
    return damage.act(columns, rng)


FAULTS = {  # of the library that stay visible beside a damage, and where
    "thruster_gain": {HEAVE, HORIZONTAL},  # wherever the thruster pushes
    "thruster_swap": {HORIZONTAL},
    "current": {HORIZONTAL},
    "buoyancy": {HEAVE},
    "payload": {HEAVE},
    "command_delay": {HEAVE, HORIZONTAL},
}


_ONLY_HEAVE, _ONLY_HORIZONTAL = frozenset((HEAVE,)), frozenset((HORIZONTAL,))
_DISAGREE = ("pose_velocity_disagree",)
_LATE = ("pose_delay", "command_delay")  # held values are older than their rows

DAMAGES = {
    damage.name: damage
    for damage in (
        Damage("depth_zero", constant("z", value=0.0), ("constant_column",), ("depth_scale",),
               mentions=True, hides=_ONLY_HEAVE),
        Damage("depth_constant", constant("z"), ("constant_column",), ("depth_scale",),
               mentions=True, hides=_ONLY_HEAVE),
        Damage("depth_frozen", frozen("z"), ("frozen",), mentions=True),
        Damage("column_frozen", frozen("x", "y", "yaw"), ("frozen",), mentions=True),
        Damage("all_constant", constant(), ("constant_column", "frozen"), mentions=True, hides=ALL),
        Damage("horizontal_zero", constant("x", "y", value=0.0), ("constant_column",), mentions=True,
               hides=_ONLY_HORIZONTAL),
        Damage("heading_backwards", turned(np.pi), ("heading_offset",), ("heading_bias",)),
        Damage("heading_quarter", turned(-np.pi / 2, np.pi / 2), ("heading_offset",), ("heading_bias",)),
        Damage("feet", times(("x", "y", "z"), 1 / FOOT), ("length_unit",), ("position_scale",), ("depth_scale",),
               hides=ALL),
        Damage("centimetres", times(("x", "y", "z"), 1 / CENTIMETRE), ("length_unit",), ("position_scale",),
               ("depth_scale",), hides=ALL),
        Damage("knots", times(("u", "v", "w"), 1 / KNOT), ("speed_unit",), ("velocity_scale",), hides=ALL,
               axes=VELOCITIES),
        Damage("clock_doubled", times(("t",), 2.0), ("time_unit",), ("clock_scale",), hides=ALL),
        Damage("clock_halved", times(("t",), 0.5), ("time_unit",), ("clock_scale",), hides=ALL),
        # Where z alone is negated, no log of poses can tell it from two reversed vertical thrusters.
        Damage("z_up", times(("z",), -1.0), ("z_up", "z_up_or_reversed", "wrong_frame"), ("depth_scale",),
               ("thruster_gain 5 6",), hides=_ONLY_HEAVE),
        Damage("spikes", spikes, ("outliers", "position_spike"), mentions=True),
        Damage("held_samples", repeats, ("held_samples",), (), _LATE),
        Damage("slow_sensor", slow_sensor, ("held_samples",), (), _LATE),
        Damage("jump", jump, ("jump", "position_jump"), mentions=True),
        Damage("coarse", coarse, ("coarse",), mentions=True),
        Damage("commands_one_sided", one_sided, ("one_sided_commands",), hides=ALL),
        Damage("velocity_negated", times(VELOCITIES, -1.0), (*_DISAGREE, "wrong_frame"), ("velocity_scale",),
               hides=ALL, axes=BOTH),
        Damage("velocity_scaled", scaled_velocity, (*_DISAGREE, "speed_unit"), ("velocity_scale",), hides=ALL,
               axes=BOTH),
        Damage("velocity_late", late_velocity, _DISAGREE, hides=ALL, axes=BOTH),
        Damage("healthy_with_fault", nothing, ("healthy_not_healthy",), hides=ALL, healthy=True),
    )
}  # fmt: skip
