"""The vehicle as a MuJoCo model with every number free that MuJoCo has for it, for mujoco.sysid.

The model is the one that ``auv-export`` writes. Sensors with errors and commands that come late are no part of a model;
they come in where mujoco.sysid flies it (``custom_rollout``) and compares (``modify_residual``).
"""

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np

from auv_torchrl.effects import get_effect
from auv_torchrl.export.marks import Described, read_described
from auv_torchrl.export.mjcf import SLIGHT, THIN, mjcf
from auv_torchrl.physics import CONTROL_DT, ActiveTerms, prepare
from auv_torchrl.physics.coefficients import allocation_matrix
from auv_torchrl.physics.kinematics import quaternion_from_euler, quaternion_product, rotation_matrix
from auv_torchrl.physics.thrusters import thrust_target
from auv_torchrl.vehicle import CONTROLLED, CONTROLLED_INDEX, Vehicle
from auv_torchrl.vehicle.fields import GRAVITY, WATER_DENSITY
from benchmarks.versus.parameters import Free, Modifier, as_sysid, free, of_effect, pointing
from benchmarks.versus.toolbox import mujoco, rollout, sysid
from benchmarks.versus.windows import MEMORY, NOISE, Windows, wrapped

SUBSTEPS = 4  # Euler steps of 12.5 ms in one of a log: 1 mm from the shortest ones after 2 s, and the fastest
PLATES, TALL = 6, 2.0  # for each axis, and their height over width: few and tall ones are fast and resist yaw little
PADDLE = 2.0  # m, length of what resists yaw
DRAG = (0.05, 3.0)  # of the nominal one: a body of no inertia is none, and large plates make Euler steps diverge
MASS = (0.3, 3.0)  # of the nominal mass and inertia
DOWN = np.array([1.0, -1.0, -1.0])  # from north, east, down to MuJoCo's world, whose z points up
HALF_TURN = np.array([0.0, 1.0, 0.0, 0.0])  # quaternion of that
LAG = 1e-3  # s, of a thruster without one: a filter of none has no state
LOST = 1e3  # standard deviations, of a vehicle that has diverged
HIDDEN = "hidden.mass", "hidden.inertia"  # of the rigid body with its water: one for all directions
EFFECTS_WITH_A_PLACE = (
    "thruster_gain", "thruster_misalignment", "thruster_lag", "command_delay", "buoyancy", "mass_offset", "current",
    "heading_bias", "position_scale",
)  # fmt: skip
DRAGS = ("linear_drag", "quadratic_drag")


class MujocoModel:
    """Windows flown by MuJoCo's own dynamics."""

    name = "mujoco"

    def __init__(self, vehicle_name: str) -> None:
        described = read_described(vehicle_name)
        self.vehicle = described.vehicle
        self.spec = _spec(described)
        self.free: list[Free] = [
            *(one for name in EFFECTS_WITH_A_PLACE for one in of_effect(self.vehicle, name)),
            *(one for name in DRAGS for one in of_effect(self.vehicle, name, DRAG)),
            *(free(name, 1.0, *MASS, causes=("added_mass",)) for name in HIDDEN),
        ]
        self.free = [one for one in self.free if pointing(self.vehicle, one)]

    def parameters(self) -> Any:
        """All of them, each with what it changes in the model."""
        return as_sysid(self.free, _modifiers(self.vehicle, self.spec))

    def residual(self, windows: Windows) -> Callable[..., Any]:
        """What :func:`mujoco.sysid.optimize` minimises: errors in standard deviations, all windows in one batch."""
        flights = Flights(self.vehicle, self.spec, windows)

        def of(x: np.ndarray, params: Any) -> tuple[list[np.ndarray], list[Any], list[Any]]:
            left, flown, measured = sysid.model_residual(
                x, params, lambda own: sysid.apply_param_modifiers(own, self.spec.copy()), flights.measured,
                flights.compare, flights.roll_out, n_threads=1, resample_true=False,
            )  # fmt: skip
            if x.ndim > 1:  # it comes as a column for each window of each set of numbers
                left = left.reshape(len(left), x.shape[1], -1).transpose(2, 0, 1).reshape(-1, x.shape[1])
            return [left], flown, measured

        return of

    def predict(self, params: Any, windows: Windows) -> np.ndarray:
        """What is reported of windows (W, S, 4) with these numbers."""
        _, flown, _ = self.residual(windows)(params.as_vector(), params.copy())
        return np.stack([one.data for one in flown])


class Flights:
    """Windows as trajectories of mujoco.sysid, and what its two hooks do with them."""

    def __init__(self, vehicle: Vehicle, spec: Any, windows: Windows) -> None:
        self.windows, model = windows, spec.copy().compile()
        thrust = _thrust(vehicle, windows.commands)
        self._ctrl = np.zeros((*thrust.shape[:1], thrust.shape[1] * SUBSTEPS, model.nu))
        self._ctrl[..., : thrust.shape[2]] = np.repeat(thrust, SUBSTEPS, axis=1)
        self._times = np.arange(1, windows.steps * SUBSTEPS + 1) * CONTROL_DT / SUBSTEPS
        control = sysid.TimeSeries(self._times, np.zeros((len(self._times), model.nu)))  # they depend on the delay
        self.measured = [
            sysid.SystemTrajectory(model, control, _seen(measured), _state(model, start, before), None)
            for start, before, measured in zip(windows.start, thrust[:, MEMORY - 1], windows.measured, strict=True)
        ]

    def roll_out(self, *, models: Any, datas: Any, initial_states: Any, param_dicts: Any, **_: Any) -> Any:
        """Fly all windows with each set of numbers: commands come late, starts are those of sensors with errors."""
        count, length = len(self.windows.start), len(self._times)
        own, controls, states = np.stack(initial_states[:count]), [], []
        for params in param_dicts:
            controls.append(self._late(params["command_delay.delay"].value[0] * SUBSTEPS / CONTROL_DT, length))
            states.append(_true(own, params["heading_bias.angle"].value[0], params["position_scale.factor"].value[0]))
        begin, control = np.concatenate(states), np.concatenate(controls)
        state, seen = rollout.rollout(models, datas, begin, control)
        seen[np.diff(state[..., 0], prepend=0.0) <= 0] = np.nan  # time stands still where a vehicle has diverged
        state[..., 0] = self._times
        return [
            sysid.SystemTrajectory(model, *(sysid.TimeSeries(self._times, part) for part in (held, own)), first,
                                   sysid.TimeSeries(self._times, moved))
            for model, held, own, first, moved in zip(models, control, seen, begin, state, strict=True)
        ]  # fmt: skip

    def compare(self, params: Any, predicted: Any, measured: Any, model: Any, every: bool, state: Any) -> Any:
        """Errors of what is reported at the rows of the log, in standard deviations."""
        data = predicted.data[SUBSTEPS - 1 :: SUBSTEPS]
        place = data[:, :3] * DOWN * params["position_scale.factor"].value[0]
        ahead = data[:, 3:] * DOWN  # the body's own x axis
        yaw = np.arctan2(ahead[:, 1], ahead[:, 0]) + params["heading_bias.angle"].value[0]
        flown = np.column_stack([place, yaw])
        error = np.nan_to_num(wrapped(measured.data - flown) / NOISE, nan=LOST)
        return np.clip(error, -LOST, LOST), sysid.TimeSeries(measured.times, flown), measured

    def _late(self, steps: float, length: int) -> np.ndarray:
        """Controls (W, length, nu) from the start of the windows, that many steps late."""
        index = MEMORY * SUBSTEPS + np.arange(length) - steps
        index = np.clip(index, 0, self._ctrl.shape[1] - 1.001)
        below = index.astype(int)
        share = (index - below)[:, None]
        return (1 - share) * self._ctrl[:, below] + share * self._ctrl[:, below + 1]


def _spec(described: Described) -> Any:
    """The exported model with lagging thrusters and with sensors of position and of where the bow points."""
    spec = mujoco.MjSpec.from_string(mjcf(described))
    spec.option.timestep = CONTROL_DT / SUBSTEPS
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # what diverges is not to begin anew
    for number in range(described.vehicle.thrusters):
        motor = spec.actuator(f"thruster_{number + 1}")
        motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE
        motor.dyntype, motor.dynprm[0] = mujoco.mjtDyn.mjDYN_FILTEREXACT, LAG
    _replace_drag(spec, described.vehicle)
    for name, kind in (("place", mujoco.mjtSensor.mjSENS_FRAMEPOS), ("ahead", mujoco.mjtSensor.mjSENS_FRAMEXAXIS)):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="body")
    return spec


def _replace_drag(spec: Any, vehicle: Vehicle) -> None:
    """Bodies for quadratic drag that are fewer than in the export, and whose sizes a fit can change."""
    hull = spec.body("vehicle")
    for body in [body for body in spec.bodies if body.name.startswith("quadratic_drag")]:
        spec.delete(body)
    for name in [*(f"plate_{axis}_{number}" for axis, number in product(range(3), range(PLATES))), "paddle"]:
        hull.add_body(name=name, mass=SLIGHT, explicitinertial=True)
    for axis in range(3):
        _plates(spec, axis, float(vehicle.quadratic_drag[axis]), 1.0)
    _paddle(spec, float(vehicle.quadratic_drag[5]), 1.0)


def _modifiers(vehicle: Vehicle, nominal: Any) -> dict[str, Modifier]:
    """What each number changes in a model."""

    def gear(spec: Any, number: int, angle: float) -> None:
        turned = get_effect("thruster_misalignment").apply(vehicle, {f"angle_{number}": angle})
        spec.actuator(f"thruster_{number}").gear = np.asarray(allocation_matrix(turned))[:, number - 1]

    def lag(spec: Any, seconds: float) -> None:
        for number in range(vehicle.thrusters):
            spec.actuator(f"thruster_{number + 1}").dynprm[0] = max(seconds, LAG)

    def buoyancy(spec: Any, force: float) -> None:
        up = float(vehicle.buoyancy - vehicle.vertical_force) - force
        spec.body("buoyancy").gravcomp = 1 + up / (SLIGHT * GRAVITY)

    def offset(spec: Any, axis: int, metres: float) -> None:
        for place in (spec.body("weight").pos, spec.body("vehicle").ipos):
            place[axis] += metres

    def wind(spec: Any, axis: int, speed: float) -> None:
        spec.option.wind[axis] = DOWN[axis] * speed

    def scale(spec: Any, field: str, factor: float) -> None:
        setattr(spec.body("vehicle"), field, factor * getattr(nominal.body("vehicle"), field))

    made: dict[str, Modifier] = {}

    def add(name: str, change: Callable[..., None], *which: Any) -> None:
        made[name] = lambda spec, parameter: change(spec, *which, float(parameter.value[0]))

    for number in range(1, vehicle.thrusters + 1):
        add(f"thruster_gain.gain_{number}", _gain, number)
        add(f"thruster_misalignment.angle_{number}", gear, number)
    add("thruster_lag.time_constant", lag)
    add("buoyancy.force", buoyancy)
    for axis, (short, long) in enumerate(zip("xy", ("north", "east"), strict=True)):
        add(f"mass_offset.{short}", offset, axis)
        add(f"current.{long}", wind, axis)
    add("current.down", wind, 2)
    add("hidden.mass", scale, "mass")
    add("hidden.inertia", scale, "fullinertia")
    for name, axis in zip(CONTROLLED, CONTROLLED_INDEX, strict=True):
        add(f"linear_drag.scale_{name}", _linear_drag, name, float(vehicle.linear_drag[axis, axis]))
        nominal_drag = float(vehicle.quadratic_drag[axis])
        change, which = (_paddle, ()) if name == "yaw" else (_plates, (axis,))
        add(f"quadratic_drag.scale_{name}", change, *which, nominal_drag)
    return made


def _gain(spec: Any, number: int, gain: float) -> None:
    spec.actuator(f"thruster_{number}").gainprm[0] = gain


def _linear_drag(spec: Any, name: str, nominal: float, factor: float) -> None:
    spec.actuator(f"linear_drag_{name}").biasprm[2] = -nominal * factor


def _plates(spec: Any, axis: int, nominal: float, factor: float) -> None:
    """Plates for quadratic drag along an axis grow along z, those that face z along x.

    MuJoCo resists a box (a, b, c) with rho/2 b c v^2 along a, and with rho/64 c (a^4 + b^4) w^2 about c.
    """
    area = 2.0 * nominal / WATER_DENSITY / PLATES
    size = np.full(3, np.sqrt(area / TALL))
    size[0 if axis == 2 else 2] *= TALL * factor
    size[axis] = THIN
    for number in range(PLATES):
        spec.body(f"plate_{axis}_{number}").inertia = _box_inertia(size)


def _paddle(spec: Any, nominal: float, factor: float) -> None:
    """What the plates leave of quadratic drag in yaw, by a box that is flat and long."""
    rest = factor * nominal
    for axis, number in product((0, 1), range(PLATES)):
        squares = 12 / SLIGHT * np.asarray(spec.body(f"plate_{axis}_{number}").inertia)
        height, width = np.sqrt(squares[1 - axis]), np.sqrt(squares[2])
        rest -= WATER_DENSITY / 64 * height * width**4
    spec.body("paddle").inertia = _box_inertia(
        np.array([PADDLE, THIN, max(64 * rest / WATER_DENSITY / PADDLE**4, THIN)])
    )


def _box_inertia(size: np.ndarray) -> np.ndarray:
    squares = size**2
    return SLIGHT / 12 * (squares.sum() - squares)


def _thrust(vehicle: Vehicle, commands: np.ndarray) -> np.ndarray:
    """Newtons (W, T, n) that the nominal vehicle makes of commands."""
    c = prepare(vehicle.expand(len(commands))).numpy()
    terms = ActiveTerms.of(c)
    return np.stack([thrust_target(c, terms, commands[:, k]) for k in range(commands.shape[1])], axis=1)


def _state(model: Any, start: np.ndarray, thrust: np.ndarray) -> np.ndarray:
    """The state of a model at a reported start (12,), with thrusters (n,) at work."""
    attitude = np.asarray(quaternion_product(HALF_TURN, quaternion_from_euler(*start[3:6])))
    linear = np.asarray(rotation_matrix(attitude)) @ start[6:9]
    place = np.concatenate([start[:3] * DOWN, attitude])
    return sysid.create_initial_state(model, place, np.concatenate([linear, start[9:]]), thrust)


def _true(states: np.ndarray, bias: float, factor: float) -> np.ndarray:
    """States (W, time, qpos 7, qvel 6, ...) as they are where sensors turn headings and stretch positions."""
    states = states.copy()
    states[:, 1:4] /= factor
    states[:, 8:11] /= factor
    turn = np.array([np.cos(bias / 2), 0.0, 0.0, np.sin(bias / 2)])  # about MuJoCo's z, which is up
    states[:, 4:8] = quaternion_product(np.broadcast_to(turn, states[:, 4:8].shape), states[:, 4:8])
    return states


def _seen(measured: np.ndarray) -> Any:
    return sysid.TimeSeries(CONTROL_DT * np.arange(1, len(measured) + 1), measured)
