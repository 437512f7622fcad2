"""The project's simulator with every number of its library free at once, for the optimizer of mujoco.sysid."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from auv_torchrl.effects import EFFECTS, get_effect
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import POSE
from auv_torchrl.physics import CONTROL_DT, ActiveTerms, prepare, rest_state
from auv_torchrl.physics.thrusters import thrust_after, thrust_target
from auv_torchrl.sensors import Inverse, ages
from auv_torchrl.simulator import simulate
from auv_torchrl.vehicle import Vehicle
from benchmarks.blind.flights.sizes import CLEAR
from benchmarks.versus.parameters import Free, as_sysid, of_effect, pointing
from benchmarks.versus.windows import MEMORY, NOISE, SEEN, Windows, wrapped

LEFT_OUT = {  # of the effects of the logs, with the reason
    "thruster_swap": "plugs are exchanged or not: no derivative",
    "payload": "the sum of added_mass, buoyancy and mass_offset, which are free",
    "pose_delay": "the same as command_delay in a log of poses",
    "dead_band": "thrust jumps at its edge: no derivative",
    "thrust_limit": "no command reaches it at a nominal vehicle: no derivative",
    "tether": "at stiffness 0, its nominal one, nothing changes with its other numbers",
}
FREE = tuple(name for name in EFFECTS if name in CLEAR and name not in LEFT_OUT)
LOST = 1e3  # standard deviations, of a vehicle that has diverged
_ROWS = [POSE.index(name) for name in SEEN]
Values = Mapping[str, Any]  # by name of Free, numbers or arrays of one shape


class OwnSimulator:
    """Windows flown by a vehicle that some numbers change."""

    name = "own_simulator"

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.free: list[Free] = [one for name in FREE for one in of_effect(vehicle, name)]
        self.free = [one for one in self.free if pointing(vehicle, one)]

    def parameters(self) -> Any:
        """All of them."""
        return as_sysid(self.free)

    def residual(self, windows: Windows) -> Any:
        """What :func:`mujoco.sysid.optimize` minimises: errors in standard deviations, for columns of numbers."""

        def of(x: np.ndarray, params: Any) -> tuple[list[np.ndarray], list[Any], list[Any]]:
            columns = x.reshape(len(x), -1)
            count = len(windows.start)
            values = {one.name: np.repeat(row, count) for one, row in zip(self.free, columns, strict=True)}
            flown = predict(with_values(self.vehicle, values), tiled(windows, columns.shape[1]))
            error = wrapped(np.tile(windows.measured, (columns.shape[1], 1, 1)) - flown) / NOISE
            error = np.clip(np.nan_to_num(error, nan=LOST), -LOST, LOST).reshape(columns.shape[1], -1)
            return [error[0] if x.ndim == 1 else error.T], [], []

        return of

    def predict(self, params: Any, windows: Windows) -> np.ndarray:
        """What is reported of windows (W, S, 4) with these numbers."""
        values = {one.name: float(params[one.name].value[0]) for one in self.free}
        return predict(with_values(self.vehicle, values), windows)


def with_values(vehicle: Vehicle, values: Values) -> Vehicle:
    """The vehicle with effects of these values, in the order of the library."""
    for effect in EFFECTS:
        mine = {name.partition(".")[2]: value for name, value in values.items() if name.partition(".")[0] == effect}
        if mine:
            vehicle = get_effect(effect).apply(vehicle, mine)
    return vehicle


def tiled(windows: Windows, times: int) -> Windows:
    """The windows several times over, one set behind the other."""
    return Windows(*(np.tile(part, (times, *[1] * (part.ndim - 1))) for part in windows))


def predict(vehicle: Vehicle, windows: Windows) -> np.ndarray:
    """What vehicles, one or one per window, report of windows (W, S, 4) that begin as was reported.

    A pose that is reported late looks, from a reported start on, like commands that arrive late.
    """
    count = len(windows.start)
    vehicles = vehicle if len(vehicle.batch_size) else vehicle.expand(count)
    late = ages(prepare(vehicles).numpy(), POSE).max(axis=-1)
    vehicles = changed(vehicles, delay=vehicles.delay + late)
    c = prepare(vehicles).numpy()
    terms, sensors = ActiveTerms.of(c), Inverse.of(c, POSE)
    true, past = sensors.true_start(windows.start), windows.commands[:, :MEMORY]
    thrust = thrust_target(c, terms, past[:, 0])
    for row in range(1, MEMORY):  # as it has followed the commands so far
        thrust = thrust_after(c, terms, thrust, thrust_target(c, terms, past[:, row]), CONTROL_DT)
    state = rest_state(true[:, :3], true[:, 3:7], true[:, 7:], past.shape[2], MEMORY)
    state = state._replace(commands=past[:, ::-1], thrust=thrust, time=windows.time)
    times = CONTROL_DT * np.arange(windows.steps + 1)
    flown = simulate(vehicles, windows.commands[:, MEMORY:], times, state).states
    reported = sensors.by_step().reported_start(flown)
    return reported[:, 1:, _ROWS]
