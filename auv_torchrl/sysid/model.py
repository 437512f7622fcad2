"""What the engine asks of a simulator: parameters, channels, and how states follow each other.

Whoever brings a simulator writes a :class:`StepModel`: one method takes a step, one reads the sensors. A simulator that
is compiled, or that hides states from the engine (thrust that builds up, commands on their way), is a :class:`Model`,
which simulates whole windows itself.

Shapes: ``W`` windows of ``S`` steps, ``R`` rows of parameter values, ``P`` parameters, ``n`` numbers of a state, ``f``
of a force, ``C`` channels.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[Any]  # float64 throughout; the stubs of numpy lose the type in half of the calls


@dataclass(frozen=True)
class Parameter:
    """A number of the model that a fit may change.

    A parameter with a tolerance is a nuisance parameter: every fit may move it a little. Where a candidate frees a
    parameter, the standard deviation of its prior is ``width`` in place of the tolerance.
    """

    name: str
    nominal: float
    low: float
    high: float
    unit: str = "1"
    tolerance: float = 0.0  # standard deviation by which the nominal value is uncertain anyway; 0: exact
    width: float = 0.0  # standard deviation of the prior of a changed value; 0: that of an even spread over the bounds

    def __post_init__(self):
        if not self.low <= self.nominal <= self.high:
            raise ValueError(f"{self.name}: nominal {self.nominal} is outside of its bounds {self.low} to {self.high}")
        if not self.low < self.high:
            raise ValueError(f"{self.name}: bounds {self.low} and {self.high} leave nothing to fit")
        if self.tolerance < 0 or self.width < 0:
            raise ValueError(f"{self.name}: a standard deviation is negative")

    @property
    def changed_width(self) -> float:
        """Standard deviation of the prior where a candidate frees the parameter."""
        return self.width or (self.high - self.low) / np.sqrt(12.0)


@dataclass(frozen=True)
class Channel:
    """One measured quantity."""

    name: str
    unit: str = "1"
    angular: bool = False  # differences are wrapped to (-pi, pi]


class Model(ABC):
    """A simulator with parameters.

    Attributes:
        parameters: what fits may change.
        channels: what :meth:`observe` returns.
        dt: s, grid step.
        start_width: (n,) standard deviation of the weak prior of a window's first state about its guess.
        force_width: (f,) standard deviation of the force that may act while a wrong model follows the samples.
        angles: entries of a state that are angles, whose differences are wrapped.
    """

    parameters: tuple[Parameter, ...]
    channels: tuple[Channel, ...]
    dt: float
    start_width: Floats
    force_width: Floats
    angles: tuple[int, ...] = ()

    @abstractmethod
    def simulate(self, values: Floats, start: Floats, inputs: Floats, force: Floats) -> Floats:
        """States (W, R, S + 1, n) from a start (W, R, n) on.

        Args:
            values: (R, P).
            start: (W, R, n).
            inputs: (W, S, ...), held over each step.
            force: (W, R, S, f), which acts besides what the model does.
        """

    @abstractmethod
    def advance(self, values: Floats, states: Floats, inputs: Floats, force: Floats) -> Floats:
        """States (W, R, S, n) one step after each of ``states`` (W, S, n); ``force`` is (W, S, f)."""

    @abstractmethod
    def observe(self, values: Floats, states: Floats) -> Floats:
        """What the sensors report, (W, R, L, C), of ``states`` (W, R, L, n)."""

    @property
    def nominal(self) -> Floats:
        """(P,) nominal values."""
        return np.array([parameter.nominal for parameter in self.parameters])

    def place(self, name: str) -> int:
        """Where a parameter stands in a row of values.

        Raises:
            KeyError: with the names that there are.
        """
        names = [parameter.name for parameter in self.parameters]
        if name not in names:
            raise KeyError(f"no parameter {name!r}: there are {', '.join(names)}")
        return names.index(name)

    def changed(self, values: dict[str, float]) -> Floats:
        """(P,) nominal values with some of them replaced."""
        row = self.nominal
        for name, value in values.items():
            row[self.place(name)] = value
        return row

    def difference(self, after: Floats, before: Floats) -> Floats:
        """``after`` less ``before`` (..., n), angles wrapped."""
        change = after - before
        for entry in self.angles:
            change[..., entry] = wrapped(change[..., entry])
        return change


class StepModel(Model):
    """A simulator that is given by one step of it."""

    @abstractmethod
    def step(self, values: Floats, states: Floats, inputs: Floats, force: Floats) -> Floats:
        """States (N, n) one grid step after ``states`` (N, n).

        Args:
            values: (N, P).
            states: (N, n).
            inputs: (N, ...).
            force: (N, f).
        """

    def simulate(self, values: Floats, start: Floats, inputs: Floats, force: Floats) -> Floats:
        """See :meth:`Model.simulate`."""
        windows, rows, n = start.shape
        each = np.tile(values, (windows, 1))
        states = np.empty((windows, rows, inputs.shape[1] + 1, n))
        states[:, :, 0] = start
        for k in range(inputs.shape[1]):
            held = np.repeat(inputs[:, k], rows, axis=0)
            pushed = force[:, :, k].reshape(windows * rows, -1)
            after = self.step(each, states[:, :, k].reshape(-1, n), held, pushed)
            states[:, :, k + 1] = after.reshape(windows, rows, n)
        return states

    def advance(self, values: Floats, states: Floats, inputs: Floats, force: Floats) -> Floats:
        """See :meth:`Model.advance`."""
        windows, steps, n = states.shape
        rows = len(values)
        each = np.tile(values, (windows * steps, 1))
        before, pushed = (np.repeat(array.reshape(windows * steps, -1), rows, axis=0) for array in (states, force))
        held = np.repeat(inputs.reshape(windows * steps, *inputs.shape[2:]), rows, axis=0)
        after = self.step(each, before, held, pushed)
        return after.reshape(windows, steps, rows, n).swapaxes(1, 2)


def wrapped(angle: Floats) -> Floats:
    """Angles in (-pi, pi], rad."""
    return np.pi - np.remainder(np.pi - angle, 2 * np.pi)
