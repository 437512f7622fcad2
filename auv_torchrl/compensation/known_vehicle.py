"""The changes of a vehicle are known: command it so that it moves as the source vehicle would.

Dynamic inversion with the simulator's own equations on both sides, and prediction over what comes late.
"""

from typing import Any, NamedTuple, Self, cast

import numpy as np
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Composite, TensorSpec

from auv_torchrl.adaptation.config import load_adaptation_config
from auv_torchrl.adaptation.motion import axis_weights, followed_axes
from auv_torchrl.adaptation.transform import ThrusterTransform, array, measured_state, set_expected
from auv_torchrl.ddr.actuation import Actuation
from auv_torchrl.ddr.allocation import Allocation
from auv_torchrl.ddr.transform import ACTION
from auv_torchrl.effects.effect import changed
from auv_torchrl.envs.start import EXPECTED, TIME, expected_spec
from auv_torchrl.physics import ActiveTerms, Coefficients, State, prepare
from auv_torchrl.physics.fins import fin_wrench
from auv_torchrl.physics.hydrodynamics import acceleration
from auv_torchrl.physics.kinematics import conjugate, matvec, normalise, quaternion_product, rotation_matrix
from auv_torchrl.physics.pushes import steady_thrust
from auv_torchrl.physics.step import push
from auv_torchrl.physics.surface import given_in_water
from auv_torchrl.physics.thrusters import CURVE_FIELDS, body_wrench, lag_left, thrust_after, thrust_target
from auv_torchrl.sensors import MOTION, Inverse, ages
from auv_torchrl.simulator import PlainSimulator, at_rest
from auv_torchrl.simulator.arrays import with_rows
from auv_torchrl.tasks import Task, cruise_speed
from auv_torchrl.vehicle import Vehicle, index_of

Array = Any


class Model(NamedTuple):
    """A vehicle as the equations of motion read it, numpy."""

    c: Coefficients
    terms: ActiveTerms
    sensors: Inverse  # from what they report, of body velocities too, to the true motion
    pose_age: float  # s, of what they report of the pose

    @classmethod
    def of(cls, vehicle: Vehicle) -> Self:
        """Of one vehicle (empty batch)."""
        c = prepare(vehicle)
        one = c.rows(None)
        age = float(ages(one, MOTION[:6]).max())
        return cls(c, ActiveTerms.of(c), Inverse.of(one, MOTION[6:]), age)

    def rate(self, state: State, thrust: Array) -> Array:
        """Acceleration (N, 6) under thrusts (N, n) in N, of fins deflections in rad, before gains."""
        rotation, wrench = rotation_matrix(state.quaternion), self.wrench(state, thrust)
        return acceleration(self.c, self.terms, rotation, state.position, state.velocity, wrench)

    def rate_per_share(self, state: State) -> Array:
        """What full thrust of each thruster adds to it, (N, 6, n): half of the difference to full thrust back.

        Of a fin that is the mean over its reach in the flow that there is, stall included, and of a servo that over its
        reach with the thrust that it turns.
        """
        each, others = np.diag(self.c.full_thrust), np.zeros((1, 1, 1))
        if self.terms.azimuth:
            others = np.where(self.c.turns > 0, 0.0, state.thrust)[:, None] * (1.0 - np.eye(len(each)))
        alone = State(*(values[:, None] for values in state))
        difference = (self.wrench(alone, others + each) - self.wrench(alone, others - each)) / 2
        return self.c.mass_inverse @ difference.swapaxes(-1, -2)

    def wrench(self, state: State, thrust: Array) -> Array:
        """Of thrusters and fins, (..., 6), N and N m."""
        c, terms, rotation = self.c, self.terms, rotation_matrix(state.quaternion)
        given = given_in_water(c, terms, thrust, rotation, state.position) if terms.surface else thrust
        wrench = body_wrench(c, terms, given, state.time)
        if terms.fins:
            wrench = wrench + fin_wrench(c, terms, rotation, state.position, state.velocity, thrust)
        return wrench


def holding(vehicle: Vehicle, degrees: list[int]) -> Vehicle:
    """The vehicle with all but some degrees of freedom held: to invert its tilt as well would leave it swinging."""
    held = np.zeros_like(vehicle.free)
    held[degrees] = 1.0
    return changed(vehicle, free=held * vehicle.free)


class KnownVehicle(ThrusterTransform):
    """Turns the policy's channels into the thruster commands that move a known vehicle as they would the source.

    At every step the acceleration that the action gives the source vehicle is worked out, and the thrusts that give
    the known vehicle the same one in the degrees of freedom that are followed, within its limits: gains, routing, drag,
    inertia, load, current and tether are undone where the thrusters can. One that hovers is followed in those that are
    controlled, one at speed in all six, of which those that are not count little. Late commands, late poses and lag
    are undone by prediction, what the sensors do by their inverse: ``expected`` is what the source's sensors would
    report when the next command acts, and a policy sees it through :class:`auv_torchrl.ddr.transform.Observe`. A
    vehicle that hovers holds its place in a current; one at speed goes along with the water, and is compared with the
    source, and seen by the policy, as it moves through that.

    Args:
        source: one vehicle (empty batch), the one that the policy was trained on.
        known: one vehicle (empty batch), what the target is taken for.
        task: of the environment.
    """

    def __init__(self, source: Vehicle, known: Vehicle, task: Task):
        super().__init__(source, task)
        self.task = task
        axes, speed = task.axes, cruise_speed(task)
        self._degrees = index_of(followed_axes(axes, speed))
        self._source, self._known = Model.of(source), Model.of(known)
        self._drift = np.asarray(known.current - source.current) if speed else np.zeros(3)  # m/s, of its water
        shown = changed(known, current=known.current - self._drift)
        self._source_held, self._known_held = (Model.of(holding(one, self._degrees)) for one in (source, shown))
        c, terms, dt = self._known.c, self._known.terms, task.control_dt
        self._receiver = np.abs(c.routing).argmax(0)  # (n,) the thruster that a command reaches ...
        self._sense = c.routing[self._receiver, np.arange(self.thrusters)]  # ... and -1 where it turns the wrong way
        curve = {name: getattr(known, name)[self._receiver] for name in CURVE_FIELDS}
        self.actuation = Actuation(changed(source, **curve), axes, speed)
        self._curve = self.actuation.coefficients.numpy()
        low, high = (array(limit) for limit in self.actuation.share_limits)
        self._limits = np.where(self._sense < 0, (-high, -low), (low, high))
        start = at_rest(np.zeros((1, 3)), np.zeros(1), self.thrusters)
        start.velocity[:, 0] = speed
        start.thrust[:] = steady_thrust(self._source.c, self._source.terms, np.asarray(speed))  # which servos turn
        config = load_adaptation_config()
        self._kept = config.withheld_kept
        reach = np.abs(self._source.rate_per_share(start)[0, self._degrees]).sum(-1)
        self._weight = axis_weights(reach, axes, speed, config)
        edge = c.dead_band / c.full_thrust
        self._carry_limit = (np.abs(self._known.rate_per_share(start)[0, self._degrees]) * edge).max(-1)
        by_command = {name: getattr(c, name)[self._receiver] for name in ("full_thrust", "lag", "servo_rate")}
        self._by_command = c._replace(**by_command)
        self._left = lag_left(self._by_command, dt) if terms.lag else np.zeros(self.thrusters)
        self._ahead_steps = max(0, round(float(c.delay - self._source.c.delay) / dt))
        self._pose_age = max(0.0, (self._known.pose_age - self._source.pose_age) / dt)  # control steps
        self._vehicle = known
        self._make_room(1)

    # commands

    def thrusts(self, nominal: Array) -> Array:
        """Thrusts (N, n) to aim at, shares of full thrust by command, where the source would get ``nominal`` (N, n)."""
        source, known, ahead = self._source_held, self._known_held, self._carried_along
        aim = nominal * source.c.full_thrust
        self._source_thrust = thrust_after(source.c, source.terms, self._source_thrust, aim, self.task.control_dt)
        self._effect = known.rate_per_share(ahead)[:, self._degrees][..., self._receiver] * self._sense
        missing = source.rate(ahead, self._source_thrust) - known.rate(ahead, np.zeros_like(aim))
        now = self._share_ahead
        low, high = (self._after(now, limit) for limit in self._limits)
        wanted = missing[:, self._degrees] + self._carried
        share = Allocation(self._weight, low, high)(wanted, self._effect, reference=nominal)
        return now + (share - now) / (1.0 - self._left)

    def _after(self, share: Array, aim: Array) -> Array:
        """Thrusts (N, n) a control step after they were ``share``, as far as lag and servos let them follow."""
        c, full = self._by_command, self._by_command.full_thrust
        return thrust_after(c, self._known.terms, share * full, aim * full, self.task.control_dt) / full

    def command_for(self, wanted: Array) -> Array:
        """Commands (N, n) that give thrusts (N, n), shares of full thrust, by command, on the known vehicle; numpy."""
        return self._sense * super().command_for(self._sense * wanted)

    def withheld(self, wanted: Array, command: Array) -> None:
        """Remember the acceleration between what was aimed at, ``wanted`` (N, n), and what the dead band leaves."""
        turned = self._sense * command
        given = self._sense * thrust_target(self._curve, self.actuation.terms, turned) / self._curve.full_thrust
        missing = np.clip(wanted, *self._limits) - given
        lost = missing * (1.0 - self._left)
        carried = self._kept * self._carried + (self._effect @ lost[..., None])[..., 0]
        self._carried = np.clip(np.nan_to_num(carried), -self._carry_limit, self._carry_limit)

    @property
    def _share_ahead(self) -> Array:
        """Thrust (N, n) when the next command acts, shares of full thrust, by command."""
        return self._sense * (self._ahead.thrust / self._known.c.full_thrust)[:, self._receiver]

    # the state

    @property
    def _carried_along(self) -> State:
        """The state when the next command acts, as it is seen from where the water of the source stands still."""
        linear, angular = np.split(self._ahead.velocity, 2, axis=-1)
        linear = linear - matvec(rotation_matrix(self._ahead.quaternion).swapaxes(-1, -2), self._drift)
        return self._ahead._replace(velocity=np.concatenate((linear, angular), axis=-1))

    def learn(self, share: Array, before: TensorDictBase, after: TensorDictBase) -> None:
        """Follow the vehicle through the step, and say where it is and will be."""
        was = self._now.state
        self._now.step(array(before.get(ACTION)))
        expected = self._now.state
        turned = quaternion_product(expected.quaternion, conjugate(was.quaternion))
        moved = np.concatenate((expected.position - was.position, 2.0 * turned[:, 1:] / turned[:, :1]), axis=-1)
        self._moved = push(self._moved, moved)
        self._see(expected, after)

    def begin(self, rows: Tensor, tensordict: TensorDictBase) -> None:
        """Begin the episodes of some vehicles where they are measured, with silent thrusters."""
        count = len(tensordict.get(TIME))
        if len(self._moved) != count:
            self._make_room(count)
        for name in ("_moved", "_source_thrust", "_carried"):
            setattr(self, name, with_rows(getattr(self, name), rows, 0.0))
        state = self._now.state
        thrust, commands = (with_rows(values, rows, 0.0) for values in (state.thrust, state.commands))
        self._see(state._replace(thrust=thrust, commands=commands), tensordict)

    def _make_room(self, count: int) -> None:
        vehicles, dt, n = self._vehicle.expand(count), self.task.control_dt, self.thrusters
        self._now, self._later = PlainSimulator(vehicles, dt), PlainSimulator(vehicles, dt)
        self._now.resume(at_rest(np.zeros((count, 3)), np.zeros(count), n))
        self._ahead = self._now.state  # when the next command acts
        self._moved = np.zeros((count, int(np.ceil(self._pose_age)) + 1, 6))  # m, rad, along the earth, newest first
        self._source_thrust = np.zeros((count, n))  # N
        self._effect = np.zeros((count, len(self._degrees), n))
        self._carried = np.zeros((count, len(self._degrees)))  # acceleration that the dead band has withheld so far

    def _see(self, expected: State, tensordict: TensorDictBase) -> None:
        """Take in a measurement; where it is not a number, what was expected stands for it."""
        measured = measured_state(tensordict)
        usable = np.isfinite(measured).all(-1)
        position, quaternion, velocity = np.split(self._known.sensors.true_state(measured[usable]), (3, 7), axis=-1)
        age = np.clip(self._pose_age - np.arange(self._moved.shape[1]), 0.0, 1.0)
        since = np.einsum("j,bjk->bk", age, self._moved[usable])
        turn = normalise(np.concatenate((np.ones_like(since[:, :1]), since[:, 3:] / 2.0), axis=-1))
        self._now.state = expected._replace(
            position=with_rows(expected.position, usable, position + since[:, :3]),
            quaternion=with_rows(expected.quaternion, usable, quaternion_product(turn, quaternion)),
            velocity=with_rows(expected.velocity, usable, velocity),
            time=array(tensordict.get(TIME))[:, 0],
        )
        self._later.state = self._now.state
        for _ in range(self._ahead_steps):
            self._later.step(self._now.state.commands[:, 0])
        self._ahead = self._later.state
        state = self._source.sensors.reported_state(np.concatenate(self._carried_along[:3], axis=-1))
        set_expected(tensordict, state, self._ahead.time)

    def transform_observation_spec(self, observation_spec: TensorSpec) -> TensorSpec:
        """Declare ``applied_action`` and ``expected``."""
        spec = cast(Composite, super().transform_observation_spec(observation_spec))
        spec[EXPECTED] = expected_spec(spec)
        return spec
