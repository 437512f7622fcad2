"""What a vehicle can still do: the rank of the way from its commands to the four controlled degrees of freedom.

A map of commands can only rearrange what the thrusters give. Where the 4 x 4 matrix from the command channels to
the controlled wrench is singular, no map of the four channels can bring back the nominal behaviour; where the
4 x n matrix from free thruster commands is singular too, no map of commands can.
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
from auv_torchrl.physics.thrusters import thrust_target
from auv_torchrl.vehicle import CONTROLLED, CONTROLLED_INDEX, DEGREES_OF_FREEDOM, Vehicle

Array = Any
RANK_TOLERANCE = 1e-3  # on singular values relative to the largest: a thruster below 0.1 % of its thrust is dead
EXACT = 1e-6  # of a push by itself, that may come with it in the other degrees of freedom: rounding


class Recovery(StrEnum):
    """What a map of commands can do; the value completes the sentence of the report."""

    CHANNELS = "a map of the four command channels can recover it"
    THRUSTERS = "no map of the four command channels can recover it, a map to the thrusters can"
    NONE = "no map of commands can recover it"


@dataclass(frozen=True)
class Authority:
    """Ranks of a vehicle's control, and what it comes to."""

    name: str
    channel_rank: int  # of the 4 x 4 map from the command channels
    thruster_rank: int  # of the 4 x n map from free thruster commands
    independent: tuple[str, ...]  # degrees of freedom that some command moves alone
    coupled: tuple[str, ...]  # those that only move together with others
    lost: tuple[str, ...]  # those that nothing moves

    @property
    def recovery(self) -> Recovery:
        """Which kind of map, if any, can give back the four controlled degrees of freedom."""
        if self.channel_rank == len(CONTROLLED):
            return Recovery.CHANNELS
        return Recovery.THRUSTERS if self.thruster_rank == len(CONTROLLED) else Recovery.NONE

    def __str__(self) -> str:
        total = len(CONTROLLED)
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


def pushed(vehicle: Vehicle, axes: Sequence[str], by_channels: bool) -> tuple[str, ...]:
    """Those of some degrees of freedom that a sound vehicle pushes both ways without pushing the others of them.

    Its weight in water counts as a push that needs no thruster. Faults of thrusters and plugs are left out.

    Args:
        vehicle: one vehicle (empty batch).
        axes: degrees of freedom that are to be controlled together; what happens in others does not matter.
        by_channels: whether commands are the four channels of the mixer, or those of the thrusters one by one.
    """
    xp = array_namespace(vehicle.gain)
    eye = xp.eye(vehicle.thrusters, **like(vehicle.gain))
    whole, none = xp.ones_like(vehicle.gain), xp.zeros_like(vehicle.gain)
    sound = changed(vehicle, gain=whole, forward_gain=whole, reverse_gain=whole, neutral_offset=none, routing=eye)
    c = prepare(sound)
    commands = vehicle.mixer[:, list(CONTROLLED_INDEX)].mT if by_channels else eye
    index = [DEGREES_OF_FREEDOM.index(axis) for axis in axes]

    def wrenches(alone: Array) -> np.ndarray:
        thrust = thrust_target(c, ActiveTerms.of(c), xp.concat((alone, -alone)))
        return host(c.allocation @ thrust.mT)[index]  # (a, pushes)

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


def check_control(vehicle: Vehicle, task: str, axes: Sequence[str], by_channels: bool, name: str = "") -> None:
    """Refuse a vehicle that cannot control what a task needs.

    Args:
        vehicle: one vehicle (empty batch).
        task: its name.
        axes: degrees of freedom that it needs.
        by_channels: as of :func:`pushed`.
        name: of the vehicle, where it is known.

    Raises:
        ValueError: naming the degrees of freedom that are missing, and what can be done.
    """
    can = pushed(vehicle, axes, by_channels)
    if len(can) == len(axes):
        return
    who = f"vehicle {name}" if name else "the vehicle"
    free = pushed(vehicle, axes, by_channels=False)
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


def authority(vehicle: Vehicle, nominal: Vehicle, name: str = "vehicle") -> Authority:
    """Ranks of what ``vehicle`` can do, with forces and moments scaled by what ``nominal`` can do.

    Args:
        vehicle: one vehicle (empty batch), e.g. ``scenario.vehicle_at(nominal)``.
        nominal: the vehicle without faults, whose largest wrench per degree of freedom is the unit.
        name: what the text calls it, e.g. the scenario.

    Raises:
        ValueError: for a batch of vehicles, or a nominal vehicle that cannot control all four degrees of freedom.
    """
    if vehicle.batch_size or nominal.batch_size:
        raise ValueError(f"authority: got a batch of shape {tuple(vehicle.batch_size)}: give one vehicle at a time")
    unit = np.abs(host(controlled_allocation(nominal))).sum(-1, keepdims=True)
    if not (unit > 0).all():
        dead = [dof for dof, u in zip(CONTROLLED, unit, strict=True) if not u > 0]
        raise ValueError(f"authority: the nominal vehicle has no thruster for {_listed(dead)}: check its allocation")
    return authority_of(
        host(controlled_allocation(vehicle)) / unit, host(vehicle.mixer)[:, list(CONTROLLED_INDEX)], name
    )


def authority_of(thrusters: Array, mixer: Array, name: str = "vehicle", tolerance: float = RANK_TOLERANCE) -> Authority:
    """Ranks of a wrench per thruster command, known or estimated.

    Args:
        thrusters: (4, n) in units of what the nominal vehicle can give in each degree of freedom.
        mixer: (n, 4) thruster commands per unit of each channel.
        name: what the text calls it.
        tolerance: singular values below this share of the largest count as none; an estimate needs its own error.
    """
    thrusters, mixer = host(thrusters), host(mixer)
    channels = thrusters @ mixer
    reach = _range(thrusters, tolerance)
    share = (reach @ reach.mT).diagonal()  # of each degree of freedom's unit wrench that can be produced: 1 is all
    named = list(zip(CONTROLLED, share.tolist(), strict=True))
    return Authority(
        name=name,
        channel_rank=_range(channels, tolerance).shape[1],
        thruster_rank=reach.shape[1],
        independent=tuple(dof for dof, s in named if s > 1 - tolerance),
        coupled=tuple(dof for dof, s in named if tolerance < s <= 1 - tolerance),
        lost=tuple(dof for dof, s in named if s <= tolerance),
    )


def controlled_allocation(vehicle: Vehicle) -> Array:
    """Controlled wrench (4, n) in N and N m per unit thruster command, routing and gains included."""
    c = prepare(vehicle)
    return ((c.allocation * c.full_thrust) @ c.routing)[list(CONTROLLED_INDEX)]


def _range(matrix: np.ndarray, tolerance: float) -> np.ndarray:
    """Orthonormal basis (4, rank) of what the columns span."""
    basis, size, _ = np.linalg.svd(matrix, full_matrices=False)
    return basis[:, size > tolerance * max(size.max(), np.finfo(size.dtype).tiny)]


def _listed(names: tuple[str, ...] | list[str]) -> str:
    return " and ".join((", ".join(names[:-1]), names[-1])) if len(names) > 1 else "".join(names)
