"""What the source vehicle's thrusters make of a command, and the spaces in which commands are mapped.

Controls are kept in units of the command channels, one for each of the axes that a task controls (surge, sway, heave
and yaw of a vehicle that hovers): 1 is what a full command in that channel gives on the source vehicle, so that tau_s
of a healthy vehicle equals its command.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

from auv_torchrl.ddr.allocation import Allocation, shrunk
from auv_torchrl.physics import ActiveTerms, Coefficients, prepare
from auv_torchrl.physics.pushes import thrust_turned, wrench_per_share
from auv_torchrl.physics.thrusters import shares_turned, thrust_target
from auv_torchrl.vehicle import CONTROLLED, Vehicle, index_of
from auv_torchrl.vehicle.tensors import tensors

IDLE = 0.05  # of the thrust at the speed: less is turned to no effect
EDGE = 1e-4  # share of full thrust kept clear of the dead band's edge, so that rounding does not fall into it


class Actuation(nn.Module):
    """Actuation of one vehicle: mixer, curve, limit, dead band and the turning of servos; no lag, delay or battery.

    What an azimuth thruster pushes aside grows with its thrust and with its angle. Of its servo not the share of the
    largest angle counts, but the push: that share, times the thrust over the one that keeps up the speed. In pushes the
    wrench is linear. Of all other actuators the push is the share of the full thrust.

    Args:
        vehicle: one vehicle (empty batch), the source.
        axes: degrees of freedom that a channel commands each.
        speed: ahead in m/s, at which fins push.

    Raises:
        ValueError: if its allocation is singular, so that channels have no unique wrench.
    """

    mixer: Tensor  # (n, a)
    channels_per_share: Tensor  # (a, n) channels per push of each thruster
    turned: Tensor | None  # (n, n) thrust that each servo turns, over that at the speed, per share of full thrusts

    def __init__(self, vehicle: Vehicle, axes: Sequence[str] = CONTROLLED, speed: float = 0.0):
        super().__init__()
        c = prepare(tensors(vehicle))
        self.terms = ActiveTerms.of(c)
        controlled = index_of(axes)
        mixer = tensors(vehicle).mixer[:, controlled]
        per_share = wrench_per_share(c, self.terms, speed)[controlled]
        full = per_share @ mixer
        if torch.linalg.matrix_rank(full) < len(axes):
            raise ValueError(
                f"actuation: the allocation of the source vehicle is singular (rank "
                f"{int(torch.linalg.matrix_rank(full))} of {len(axes)}): check thruster positions and the mixer"
            )
        self.coefficients = Coefficients(*(field.float() for field in c))
        self.register_buffer("mixer", mixer.float(), persistent=False)
        turned = thrust_turned(c, self.terms, torch.as_tensor(speed).to(c.turns)) if self.terms.azimuth else None
        self.register_buffer("turned", None if turned is None else turned.float(), persistent=False)
        self.register_buffer("channels_per_share", torch.linalg.solve(full, per_share).float(), persistent=False)

    def _apply(self, fn: Any, recurse: bool = True) -> Any:
        self.coefficients = Coefficients(*(fn(field) for field in self.coefficients))
        return super()._apply(fn, recurse)

    @property
    def thrusters(self) -> int:
        """Number of thrusters n."""
        return self.mixer.shape[0]

    @property
    def channels(self) -> int:
        """Number of channels a."""
        return self.mixer.shape[1]

    @property
    def share_limits(self) -> tuple[Tensor, Tensor]:
        """Least and largest thrust of each thruster (n,), as shares of its full thrust."""
        c = self.coefficients
        limit = c.limit / c.full_thrust
        forward, reverse = (gain.clamp(min=0.0) for gain in (c.forward_gain, c.reverse_gain))
        return -torch.minimum(limit, 1 - c.asymmetry) * reverse, limit.clamp(max=1.0) * forward

    @property
    def strongest(self) -> Tensor:
        """Push of each actuator (n,) at all of its share, while thrusters give all of theirs."""
        return self.pushes(torch.ones_like(self.mixer[:, 0]))

    @property
    def push_limits(self) -> tuple[Tensor, Tensor]:
        """Least and largest push of each actuator (n,), where thrusters give all; with less thrust angles end it."""
        low, high = self.share_limits
        return low * self.strongest, high * self.strongest

    def delivered(self, command: Tensor) -> Tensor:
        """Thrust for thruster commands (..., n), cut to [-1, 1], as shares of full thrust."""
        return thrust_target(self.coefficients, self.terms, command) / self.coefficients.full_thrust

    def pushes(self, share: Tensor) -> Tensor:
        """What thrusts and angles (..., n), shares of the full ones, push."""
        return share if self.turned is None else share * self._thrust_turned(share)

    def shares(self, push: Tensor) -> Tensor:
        """Thrusts and angles (..., n) that push so; an angle is that of :data:`IDLE` thrust where there is less."""
        if self.turned is None:
            return push
        thrust = self._thrust_turned(push)
        return push / torch.where(thrust.abs() < IDLE, torch.where(thrust < 0, -IDLE, IDLE), thrust)

    def _thrust_turned(self, share: Tensor) -> Tensor:
        """The thrust that each servo turns, over that at the speed, (..., n); 1 of what is no servo."""
        assert self.turned is not None
        return torch.where(self.turned.any(-1), share @ self.turned.mT, 1.0)

    def turning(self, before: Tensor, share: Tensor, elapsed: float) -> tuple[Tensor, Tensor]:
        """Mean shares (..., n) over some seconds of what follows as servos do, and those at the end."""
        return shares_turned(self.coefficients, self.terms, before, share, elapsed)

    def intended(self, action: Tensor) -> Tensor:
        """What channels (..., a) would give without dead band and limits, in channels; the same on a linear curve."""
        command = action @ self.mixer.mT
        beyond = command.abs().amax(-1, keepdim=True).clamp_min(1.0)
        smooth = self.coefficients._replace(dead_band=torch.zeros_like(self.coefficients.dead_band))
        share = thrust_target(smooth, self.terms, command / beyond) / smooth.full_thrust
        return beyond * self.pushes(share) @ self.channels_per_share.mT

    def command_for(self, share: Tensor, skip_dead_band: bool = True) -> Tensor:
        """Commands (..., n) that give thrusts (..., n), shares of full thrust.

        Inside the dead band the nearer of no thrust and its edge, or with ``skip_dead_band=False`` what the curve
        says without it.
        """
        c = self.coefficients
        low, high = self.share_limits
        share = torch.maximum(torch.minimum(share, high), low)
        gain = torch.where(share < 0, c.reverse_gain, c.forward_gain)
        size = share.abs() / torch.where(gain > 0, gain, 1.0)  # where the gain is none, so is the share
        if skip_dead_band:
            edge = c.dead_band / c.full_thrust
            size = torch.where(size < edge / 2, 0.0, torch.maximum(size, torch.where(edge > 0, edge + EDGE, 0.0)))
        reach = torch.where(share < 0, 1 - c.asymmetry, 1.0)
        command = share.sign() * (size / reach).clamp(max=1.0) ** (1 / c.exponent)
        return (command + c.neutral_offset).clamp(-1.0, 1.0)

    def realised(self, action: Tensor) -> Tensor:
        """What channels (..., a) really give after mixer, limits and dead band, in channels (..., a)."""
        return self.pushes(self.delivered(action @ self.mixer.mT)) @ self.channels_per_share.mT


class ControlSpace(nn.Module, ABC):
    """Commands that a map reads and writes, in coordinates in which the wrench is linear.

    ``rows`` (r, k), ``low`` and ``high`` (r,) are the limits: low <= rows @ control <= high.
    """

    rows: Tensor
    low: Tensor
    high: Tensor
    nominal: Tensor  # (a, k) channels per control on the source vehicle

    def __init__(self, rows: Tensor, low: Tensor, high: Tensor, nominal: Tensor):
        super().__init__()
        for name, value in (("rows", rows), ("low", low), ("high", high), ("nominal", nominal)):
            self.register_buffer(name, value.clone(), persistent=False)

    @property
    def size(self) -> int:
        """Number of controls k."""
        return self.nominal.shape[1]

    def nearest(self, effect: Tensor, wanted: Tensor) -> Tensor:
        """Controls (N, k) within limits whose effect (1 or N, a, k) comes nearest to what is wanted (N, a)."""
        low, high, rows = (field.double() for field in (self.low, self.high, self.rows))
        return Allocation(1.0, low, high, rows)(wanted.double(), effect.double()).float()

    def shrink(self, control: Tensor) -> Tensor:
        """The longest multiples, at most 1, of controls (N, k) within the limits."""
        return shrunk(control, self.rows, self.low, self.high)

    @abstractmethod
    def delivered(self, command: Tensor) -> Tensor:
        """Shares of full thrust (..., n) that commands (..., k) call for on the source vehicle."""

    @abstractmethod
    def of_shares(self, share: Tensor) -> Tensor:
        """Controls (..., k) of shares of full thrust (..., n)."""

    def encode(self, command: Tensor) -> Tensor:
        """Controls (..., k) of commands (..., k) that have been held for long."""
        return self.of_shares(self.delivered(command))

    @abstractmethod
    def decode(self, control: Tensor) -> Tensor:
        """Commands (..., k) in [-1, 1] of controls (..., k)."""

    @abstractmethod
    def informative(self, command: Tensor) -> Tensor:
        """Whether commands (..., k) say something about the map, (...), bool."""


class Channels(ControlSpace):
    """The command channels, as in the paper; limited so that no thruster saturates either."""

    unmixer: Tensor  # (a, n)

    def __init__(self, actuation: Actuation):
        low, high = actuation.push_limits
        one = torch.where(actuation.mixer != 0, actuation.strongest[:, None], 1.0).amax(0)  # of each channel
        rows = torch.cat((actuation.mixer, torch.eye(actuation.channels)))
        nominal = actuation.channels_per_share @ actuation.mixer
        super().__init__(rows, torch.cat((low, -one)), torch.cat((high, one)), nominal)
        self.actuation = actuation
        self.register_buffer("unmixer", torch.linalg.pinv(actuation.mixer), persistent=False)

    def delivered(self, command: Tensor) -> Tensor:
        """As the thrusters' curve and dead band let channels (..., a) through."""
        return self.actuation.delivered(command @ self.actuation.mixer.mT)

    def of_shares(self, share: Tensor) -> Tensor:
        """Channels (..., a)."""
        return self.actuation.pushes(share) @ self.unmixer.mT

    def decode(self, control: Tensor) -> Tensor:
        """Channels (..., a) in [-1, 1] that have this effect through the thrusters' curve."""
        share = self.actuation.shares(control @ self.actuation.mixer.mT)
        thrusters = self.actuation.command_for(share, skip_dead_band=False)
        return (thrusters @ self.unmixer.mT).clamp(-1.0, 1.0)

    def informative(self, command: Tensor) -> Tensor:
        """Where some thruster turns, and what the thrusters hear is still a combination of channels.

        A heave command inside the dead band is no heave command. But where one of the thrusters that share a
        channel is silent and another is not, the wrench is no function of channels, and would bias G.
        """
        thrusters = (command @ self.actuation.mixer.mT).clamp(-1.0, 1.0)
        heard = torch.where(self.actuation.delivered(thrusters) != 0, thrusters, 0.0)  # the dead band hears nothing
        combined = heard @ self.unmixer.mT @ self.actuation.mixer.mT
        return (heard != 0).any(-1) & ((heard - combined).abs() < EDGE).all(-1)


class Thrusters(ControlSpace):
    """The n thrusters one by one, in shares of full thrust, with the source's curve and dead band taken out."""

    def __init__(self, actuation: Actuation):
        low, high = actuation.push_limits
        super().__init__(torch.eye(actuation.thrusters), low, high, actuation.channels_per_share)
        self.actuation = actuation

    def delivered(self, command: Tensor) -> Tensor:
        """As curve and dead band let commands (..., n) through."""
        return self.actuation.delivered(command)

    def of_shares(self, share: Tensor) -> Tensor:
        """Pushes (..., n)."""
        return self.actuation.pushes(share)

    def decode(self, control: Tensor) -> Tensor:
        """Commands (..., n) that push so."""
        return self.actuation.command_for(self.actuation.shares(control))

    def informative(self, command: Tensor) -> Tensor:
        """Where any thruster turns: the dead band is in the coordinates, but silence says nothing about them."""
        return (self.actuation.delivered(command) != 0).any(-1)
