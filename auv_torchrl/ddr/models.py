"""F and R: networks trained on transitions of the source vehicle, forward and inverse (Lu et al. 2023, Eq. 10).

The state x of DDR is the motion: body velocities and, where the vehicle's restoring moment does not hold it level,
tilt. Position and heading do not enter the source dynamics. Speeds along the axes of an action come first.
"""

import torch
from torch import Tensor, nn

from auv_torchrl.ddr.actuation import Actuation
from auv_torchrl.physics.kinematics import rotation_matrix
from auv_torchrl.tasks import Task, cruise_speed
from auv_torchrl.vehicle import CONTROLLED, DEGREES_OF_FREEDOM, Vehicle, index_of


class Regressor(nn.Module):
    """A linear map and a two-layer tanh network on top of it, with standardised inputs and outputs.

    Inputs are the state, its products with itself as they occur in Coriolis and drag terms, and the rest.
    """

    input_mean: Tensor
    input_scale: Tensor
    output_mean: Tensor
    output_scale: Tensor
    row: Tensor
    column: Tensor

    def __init__(self, states: int, rest: int, outputs: int, hidden: int):
        super().__init__()
        self.states = states
        inputs = states + rest + states * (states + 1) // 2 + states
        row, column = torch.triu_indices(states, states)
        self.register_buffer("row", row, persistent=False)
        self.register_buffer("column", column, persistent=False)
        self.linear = nn.Linear(inputs, outputs)
        self.network = nn.Sequential(
            nn.Linear(states + rest, hidden),
            nn.Tanh(),
            nn.Linear(hidden, hidden),
            nn.Tanh(),
            nn.Linear(hidden, outputs),
        )
        for name, length in (("input_mean", inputs), ("output_mean", outputs)):
            self.register_buffer(name, torch.zeros(length))
        for name, length in (("input_scale", inputs), ("output_scale", outputs)):
            self.register_buffer(name, torch.ones(length))

    @torch.no_grad()
    def standardise(self, inputs: Tensor, outputs: Tensor) -> None:
        """Take means and scales from data (n, states + rest) and (n, outputs), the linear map by least squares."""
        inputs = self._expanded(inputs)
        for name, data in (("input", inputs), ("output", outputs)):
            getattr(self, f"{name}_mean").copy_(data.mean(0))
            getattr(self, f"{name}_scale").copy_(data.std(0).clamp_min(1e-6))
        x = (inputs - self.input_mean) / self.input_scale
        y = (outputs - self.output_mean) / self.output_scale
        # in double precision: the last digits of LAPACK depend on where its data lie, and training multiplies that
        rounding = torch.finfo(x.dtype).eps * max(x.shape)  # columns that single precision cannot tell apart
        self.linear.weight.copy_(torch.linalg.lstsq(x.double(), y.double(), rcond=rounding).solution.mT)
        self.linear.bias.zero_()

    def forward(self, inputs: Tensor) -> Tensor:
        """(..., states + rest) to (..., outputs)."""
        return self.of_standardised(self.standardised(inputs)) * self.output_scale + self.output_mean

    def standardised(self, inputs: Tensor) -> Tensor:
        """What the linear map reads (..., k), of inputs (..., states + rest)."""
        return (self._expanded(inputs) - self.input_mean) / self.input_scale

    def of_standardised(self, x: Tensor) -> Tensor:
        """Outputs (..., outputs), less their means, over their scales, of :meth:`standardised` inputs (..., k)."""
        return self.linear(x) + self.network(x[..., : self.network[0].in_features])

    def _expanded(self, inputs: Tensor) -> Tensor:
        state = inputs[..., : self.states]
        products = state[..., self.row] * state[..., self.column]
        return torch.cat((inputs, products, state * state.abs()), dim=-1)


class ForwardModel(nn.Module):
    """F: (x_t, channels) to x_{t+1}; the thrusters' dead band and limits are known and need no learning."""

    def __init__(self, states: int, hidden: int, actuation: Actuation):
        super().__init__()
        self.actuation = actuation
        self.change = Regressor(states, actuation.channels, states, hidden)

    def forward(self, state: Tensor, action: Tensor) -> Tensor:
        """(..., s) and (..., a) in [-1, 1] to (..., s)."""
        return state + self.change(torch.cat((state, self.actuation.realised(action)), dim=-1))


class InverseModel(nn.Module):
    """R: (x_t, x_{t+1}) to tau_s, the channels that the source vehicle's thrusters must have realised."""

    def __init__(self, states: int, hidden: int, channels: int):
        super().__init__()
        self.control = Regressor(states, states, channels, hidden)

    def forward(self, state: Tensor, next_state: Tensor) -> Tensor:
        """(..., s) and (..., s) to (..., a)."""
        return self.control(torch.cat((state, next_state - state), dim=-1))


class SourceModels(nn.Module):
    """F, R and the static actuation of one source vehicle."""

    def __init__(self, vehicle: Vehicle, task: Task, hidden: int = 48):
        super().__init__()
        self.tilt, self.hidden, self.control_dt = task.tilt, hidden, task.control_dt
        felt = DEGREES_OF_FREEDOM if task.tilt else CONTROLLED
        self.speeds = (*task.axes, *(axis for axis in felt if axis not in task.axes))
        self._speeds = index_of(self.speeds)
        self.states = len(self._speeds) + 2 * task.tilt
        self.actuation = Actuation(vehicle, task.axes, cruise_speed(task))
        self.F = ForwardModel(self.states, hidden, self.actuation)
        self.R = InverseModel(self.states, hidden, self.actuation.channels)

    def state_of(self, quaternion: Tensor, velocity: Tensor) -> Tensor:
        """The motion x (..., s) of attitudes (..., 4) and body velocities (..., 6): speeds, tilt."""
        speeds = velocity[..., self._speeds]
        return torch.cat((speeds, rotation_matrix(quaternion)[..., 2, :2]), dim=-1) if self.tilt else speeds
