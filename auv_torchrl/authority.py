"""What a vehicle can still do: the rank of the way from its commands to the degrees of freedom that a task controls.

A map of commands can only rearrange what the thrusters give. Where the a x a matrix from the command channels to
the controlled wrench is singular, no map of the channels can bring back the nominal behaviour; where the
a x n matrix from free thruster commands is singular too, no map of commands can. A hovering vehicle has four axes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from array_api_compat import array_namespace

from auv_torchrl.array_api import host, joined, like
from auv_torchrl.effects.effect import changed
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.pushes import wrench_per_share, wrench_per_unit
from auv_torchrl.physics.thrusters import thrust_target
from auv_torchrl.vehicle import CONTROLLED, Vehicle, index_of

Array = Any
RANK_TOLERANCE = 1e-3  # on singular values relative to the largest: a thruster below 0.1 % of its thrust is dead
EXACT = 1e-6  # of a push by itself, that may come with it in the other degrees of freedom: rounding


class Recovery(StrEnum):
    """What a map of commands can do; the value completes the sentence of the report."""

    CHANNELS = "a map of the command channels can recover it"
    THRUSTERS = "no map of the command channels can recover it, a map to the thrusters can"
    NONE = "no map of commands can recover it"


@dataclass(frozen=True)
class Authority:
    """Ranks of a vehicle's control, and what it comes to."""

    name: str
    channel_rank: int  # of the a x a map from the command channels
    thruster_rank: int  # of the a x n map from free thruster commands
    independent: tuple[str, ...]  # degrees of freedom that some command moves alone
    coupled: tuple[str, ...]  # those that only move together with others
    lost: tuple[str, ...]  # those that nothing moves
    axes: tuple[str, ...] = CONTROLLED  # that are controlled

    @property
    def recovery(self) -> Recovery:
        """Which kind of map, if any, can give back the controlled degrees of freedom."""
        if self.channel_rank == len(self.axes):
            return Recovery.CHANNELS
        return Recovery.THRUSTERS if self.thruster_rank == len(self.axes) else Recovery.NONE

    def __str__(self) -> str:
        total = len(self.axes)
        ranks = f"rank {self.thruster_rank}"
        if self.channel_rank != self.thruster_rank:
            ranks = f"rank {self.channel_rank} through the command channels, {self.thruster_rank} at the thrusters"
        text = f"{self.name}: {self.thruster_rank} of {total} degrees of freedom can be controlled ({ranks}): "
        text += self.recovery.value
        if self.recovery is Recovery.NONE:
            text += f"; what remains: {_listed(self.independent) or 'nothing by itself'}"
            if self.coupled:
                text += f"; {_listed(self.coupled)} only together"
            if self.lost:
                text += f"; lost: {_listed(self.lost)}"
        return text


def pushed(vehicle: Vehicle, axes: Sequence[str], by_channels: bool, speed: float = 0.0) -> tuple[str, ...]:
    """Those of some degrees of freedom that a sound vehicle pushes both ways without pushing the others of them.

    Its weight in water counts as a push that needs no thruster. Faults of thrusters and plugs are left out.

    Args:
        vehicle: one vehicle (empty batch).
        axes: degrees of freedom that are to be controlled together; what happens in others does not matter.
        by_channels: whether commands are the channels of the mixer for these, or those of the thrusters one by one.
        speed: ahead in m/s; fins push with the flow alone.
    """
    xp = array_namespace(vehicle.gain)
    eye = xp.eye(vehicle.thrusters, **like(vehicle.gain))
    whole, none = xp.ones_like(vehicle.gain), xp.zeros_like(vehicle.gain)
    sound = changed(vehicle, gain=whole, forward_gain=whole, reverse_gain=whole, neutral_offset=none, routing=eye)
    c = prepare(sound)
    index = index_of(axes)
    commands = vehicle.mixer[:, index].mT if by_channels else eye

    terms = ActiveTerms.of(c)
    per_thrust = wrench_per_unit(c, terms, speed)

    def wrenches(alone: Array) -> np.ndarray:
        thrust = thrust_target(c, terms, xp.concat((alone, -alone)))
        return host(per_thrust @ thrust.mT)[index]  # (a, pushes)

    unit = np.abs(wrenches(eye)).sum(-1, keepdims=True)
    unit = np.where(unit > EXACT * unit.max(), unit, np.inf)  # where nothing pushes but rounding
    weight = np.append(host(c.restoring)[:3, 2], np.zeros(3))[index]  # level: along heave alone
    pushes = (joined(wrenches(commands), weight[:, None]) / unit).astype(np.float64)
    ways = zip(axes, np.eye(len(axes)), strict=True)
    return tuple(axis for axis, way in ways if _within(pushes, way) and _within(pushes, -way))


def _within(pushes: np.ndarray, wanted: np.ndarray) -> bool:
    """Whether pushes (a, k), each of 0 or more times, add up to a wrench (a,) without any of them being large."""
    from scipy.optimize import nnls  # here: it takes long to import

    times, left = nnls(pushes, wanted)
    return bool(left < EXACT and times.max() < 1 / RANK_TOLERANCE)


def check_control(
    vehicle: Vehicle, task: str, axes: Sequence[str], by_channels: bool, name: str = "", speed: float = 0.0
) -> None:
    """Refuse a vehicle that cannot control what a task needs.

    Args:
        vehicle: one vehicle (empty batch).
        task: its name.
        axes: degrees of freedom that it needs.
        by_channels: as of :func:`pushed`.
        name: of the vehicle, where it is known.
        speed: as of :func:`pushed`.

    Raises:
        ValueError: naming the degrees of freedom that are missing, and what can be done.
    """
    can = pushed(vehicle, axes, by_channels, speed)
    if len(can) == len(axes):
        return
    who = f"vehicle {name}" if name else "the vehicle"
    free = pushed(vehicle, axes, False, speed)
    if len(free) == len(axes):
        raise ValueError(
            f"{who}: its mixer has no command that pushes {_without(axes, can)} both ways and nothing else, which task "
            f"{task} needs, though its thrusters could: mend its mixer, or give task.thruster_commands=true"
        )
    raise ValueError(
        f"{who}: its thrusters push {_listed(free) or 'nothing'} both ways, and task {task} also needs "
        f"{_without(axes, free)}: mend its thrusters and mixer if it has more; without, its logs can still be diagnosed"
    )


def _without(axes: Sequence[str], some: Sequence[str]) -> str:
    return _listed([axis for axis in axes if axis not in some])


def authority(
    vehicle: Vehicle,
    nominal: Vehicle,
    name: str = "vehicle",
    axes: tuple[str, ...] = CONTROLLED,
    speed: float = 0.0,
) -> Authority:
    """Ranks of what ``vehicle`` can do, with forces and moments scaled by what ``nominal`` can do.

    Args:
        vehicle: one vehicle (empty batch), e.g. ``scenario.vehicle_at(nominal)``.
        nominal: the vehicle without faults, whose largest wrench per degree of freedom is the unit.
        name: what the text calls it, e.g. the scenario.
        axes: degrees of freedom that are controlled.
        speed: ahead in m/s; fins push with the flow alone.

    Raises:
        ValueError: for a batch of vehicles, or a nominal vehicle that cannot control all of these axes.
    """
    if vehicle.batch_size or nominal.batch_size:
        raise ValueError(f"authority: got a batch of shape {tuple(vehicle.batch_size)}: give one vehicle at a time")
    unit = np.abs(host(controlled_allocation(nominal, axes, speed))).sum(-1, keepdims=True)
    if not (unit > 0).all():
        dead = [dof for dof, u in zip(axes, unit, strict=True) if not u > 0]
        raise ValueError(f"authority: the nominal vehicle has no thruster for {_listed(dead)}: check its allocation")
    return authority_of(
        host(controlled_allocation(vehicle, axes, speed)) / unit,
        host(vehicle.mixer)[:, index_of(axes)],
        name,
        axes=axes,
    )


def authority_of(
    thrusters: Array,
    mixer: Array,
    name: str = "vehicle",
    tolerance: float = RANK_TOLERANCE,
    axes: tuple[str, ...] = CONTROLLED,
) -> Authority:
    """Ranks of a wrench per thruster command, known or estimated.

    Args:
        thrusters: (a, n) in units of what the nominal vehicle can give in each degree of freedom.
        mixer: (n, a) thruster commands per unit of each channel.
        name: what the text calls it.
        tolerance: singular values below this share of the largest count as none; an estimate needs its own error.
        axes: degrees of freedom that are controlled.
    """
    thrusters, mixer = host(thrusters), host(mixer)
    channels = thrusters @ mixer
    reach = _range(thrusters, tolerance)
    share = (reach @ reach.mT).diagonal()  # of each degree of freedom's unit wrench that can be produced: 1 is all
    named = list(zip(axes, share.tolist(), strict=True))
    return Authority(
        name=name,
        channel_rank=_range(channels, tolerance).shape[1],
        thruster_rank=reach.shape[1],
        independent=tuple(dof for dof, s in named if s > 1 - tolerance),
        coupled=tuple(dof for dof, s in named if tolerance < s <= 1 - tolerance),
        lost=tuple(dof for dof, s in named if s <= tolerance),
        axes=axes,
    )


def controlled_allocation(vehicle: Vehicle, axes: Sequence[str] = CONTROLLED, speed: float = 0.0) -> Array:
    """Controlled wrench (a, n) in N and N m per unit thruster command at a speed, with routing and gains."""
    c = prepare(vehicle)
    return (wrench_per_share(c, ActiveTerms.of(c), speed) @ c.routing)[index_of(axes)]


def _range(matrix: np.ndarray, tolerance: float) -> np.ndarray:
    """Orthonormal basis (a, rank) of what the columns span."""
    basis, size, _ = np.linalg.svd(matrix, full_matrices=False)
    return basis[:, size > tolerance * max(size.max(), np.finfo(size.dtype).tiny)]


def _listed(names: tuple[str, ...] | list[str]) -> str:
    return " and ".join((", ".join(names[:-1]), names[-1])) if len(names) > 1 else "".join(names)
