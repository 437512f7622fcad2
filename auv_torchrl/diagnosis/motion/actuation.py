"""The thrust that many vehicles make of the logged commands, before any motion.

Thrust depends on commands alone, so it is computed before the body moves. Each window starts with the thrust that
earlier commands have left behind, and the thrust targets of all steps are computed at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from auv_torchrl.diagnosis.latest import Latest
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.physics import ActiveTerms, Coefficients, Steps, prepare
from auv_torchrl.physics.thrusters import (
    CURVE_FIELDS,
    TARGET_FIELDS,
    at_volts,
    load,
    slowest_s,
    thrust_follower,
    thrust_target,
)
from auv_torchrl.sensors import Inverse, ages
from auv_torchrl.vehicle import Vehicle

LEAST_STEP = 0.005  # s; drag stops no vehicle within that: speeds that would need less are noise, and never end
# Of the time in which drag stops a turn, the longest Runge-Kutta step. Where vehicles turn as fast as they can, steps
# of this length are wrong by less than the noise of a gyroscope, 0.005 rad/s; steps of 1.6 by up to seven times that.
LONGEST_STEP = 0.85
LAG_MEMORY = 6.0  # time constants after which 0.25 % of an old thrust is left
MOST_MEANS, LARGEST = 64, 50_000  # mean targets, and numbers of one: 26 MB at most; long logs have larger ones
MEANS: Latest[list[Floats]] = Latest(MOST_MEANS)
COEFFICIENTS: Latest[Coefficients] = Latest(8)
SENSORS: Latest[Inverse] = Latest(8)
# Beside the latest no more than that many bytes of whitening: each subset of windows has its own copy.
ACTUATIONS: "Latest[Actuation]" = Latest(4, 96 << 20, lambda actuation: actuation.whitening_bytes)


@dataclass(frozen=True)
class Actuation:
    """Thrust that ``R`` vehicles make of the logged commands, before any motion."""

    windows: Windows
    c: Coefficients  # (R, ...); their delay is what is left of it behind whole grid steps
    terms: ActiveTerms
    whole: np.ndarray  # (R,) grid steps of delay
    thrust: Floats  # (W, R, n) N, at the start of each window
    substeps: int  # Runge-Kutta steps per grid step

    @property
    def whitening_bytes(self) -> int:
        """Memory of the whitening of the windows, the largest array that they hold."""
        return 0 if self.windows.whitening is None else self.windows.whitening.nbytes

    @cached_property
    def steps(self) -> Steps:
        """The vehicles' equations of motion."""
        return Steps(self.c, self.terms, self.windows.dt / self.substeps)

    @cached_property
    def sensors(self) -> Inverse:
        """The vehicles' sensors, from reports to true motion and back."""
        return sensors_of(self.c, self.windows.channels)

    @property
    def late(self) -> bool:
        """Whether some commands arrive within a grid step."""
        return bool((self.c.delay > 1e-6 * self.windows.dt).any())

    def targets(self, chunk: slice, steps: np.ndarray, parts: int = 1) -> list[Floats]:
        """Mean thrust target (w, R, S, n) in N during each of ``parts`` parts of grid steps (S,) of some windows.

        The arrays are shared: no caller may change them in place.
        """
        windows, (kinds, kind) = self.windows, self._kinds
        logged = windows.commands, windows.parts, windows.volts
        where = windows.start[chunk], windows.episode[chunk], steps, self._numbers[kinds]
        path = self.terms.routing, self.terms.curve
        key = (windows.dt, parts, *path, *((array.tobytes(), array.shape) for array in where))
        size = len(kinds) * where[0].size * steps.size * self.thrust.shape[-1]
        make = partial(self._means, chunk, steps, parts)
        means = MEANS.of(make, logged, key) if size <= LARGEST else make()
        if len(kinds) == 1:
            found = [np.broadcast_to(mean, (len(mean), len(kind), *mean.shape[2:])) for mean in means]
        else:
            found = [mean[:, kind] for mean in means]
        return found if self.late else found * parts

    def _means(self, chunk: slice, steps: np.ndarray, parts: int) -> list[Floats]:
        """Mean thrust targets (w, K, S, n) of each kind of vehicle; one array where all parts are the same."""
        windows, (kinds, _) = self.windows, self._kinds
        grid = np.clip(windows.start[chunk, None] + steps, 0, windows.commands.shape[1] - 1)
        shifts = self.whole[kinds]
        shifts = shifts[:1] if (shifts == shifts[0]).all() else shifts
        arrived = grid[:, None] - shifts[:, None]  # (w, K or 1, S)
        ages = (0, 1) if self.late else (0,)
        episode = windows.episode[chunk, None, None]
        held = np.stack([windows.held[episode, np.maximum(arrived - age, 0)] for age in ages], axis=-2)
        by_step = self.c.rows((kinds, None))
        each = [_targets(by_step, self.terms, some, windows.dt, parts) for some in np.moveaxis(held, -3, 0)]
        means = [_mean(part) for part in list(zip(*each, strict=True))[: parts if self.late else 1]]
        left = left_by_volts(windows, by_step, grid, chunk)
        return means if left is None else [mean * left[..., None] for mean in means]

    def load(self, chunk: slice, steps: int) -> Floats | None:
        """Share (w, R, S) of their full thrusts of thrusters at grid steps; None where no sensor depends on it."""
        if not self.c.compass_per_load.any():
            return None
        (target,) = self.targets(chunk, np.arange(steps) - 1)  # a sample is taken before its command acts
        return load(self.c.rows((slice(None), None)), target * self.c.gain[:, None])

    @cached_property
    def _numbers(self) -> Floats:
        """The numbers (R, k) on which the thrust target of a command depends."""
        fields = [getattr(self.c, name).reshape(len(self.whole), -1) for name in TARGET_FIELDS]
        return np.concatenate([self.whole[:, None], *fields], axis=1)

    @cached_property
    def _kinds(self) -> tuple[np.ndarray, np.ndarray]:
        """Vehicles whose thrust targets differ, and the one of them that each vehicle equals: most differ elsewhere."""
        return distinct(self._numbers)


def left_by_volts(
    windows: Windows, by_step: Coefficients, grid: np.ndarray, chunk: slice = slice(None)
) -> Floats | None:
    """Share (w, R, S) of their thrust that the logged volts leave vehicles (R, 1) at grid steps (w, S) of windows.

    None where no volts were logged, or no vehicle depends on them.
    """
    if windows.volts is None or not by_step.volts.any():
        return None
    return at_volts(by_step, windows.volts[windows.episode[chunk, None], grid][:, None])


def usual_speed(windows: Windows) -> float:
    """Root mean square of the speed ahead in m/s with which windows begin: that at which fins of the vehicle push."""
    return float(np.sqrt(np.mean(windows.guess[:, 6] ** 2)))


def oldest(windows: Windows, c: Coefficients) -> Floats:
    """Age (R,) in s of the oldest reports of each vehicle: its windows are simulated at those times."""
    return ages(c, windows.channels).max(-1)


def coefficients(vehicle: Vehicle) -> Coefficients:
    """Coefficients of vehicles in numpy, computed once for the same vehicles; no caller may change them in place."""
    return COEFFICIENTS.of(lambda: prepare(vehicle).numpy(), (vehicle,))


def sensors_of(c: Coefficients, channels: tuple[str, ...]) -> Inverse:
    """The sensors of vehicles with coefficients ``c``, computed once for the same ones."""
    return SENSORS.of(lambda: Inverse.of(c, channels), (c,), channels)


def actuate(windows: Windows, vehicle: Vehicle) -> Actuation:
    """The thrust that vehicles, a batch (R,), make of the commands of windows, computed once for the same ones."""
    return ACTUATIONS.of(lambda: actuate_prepared(windows, coefficients(vehicle)), (windows, vehicle))


def actuate_prepared(windows: Windows, c: Coefficients) -> Actuation:
    """Delay the commands, and run the lag up to the start of each window; ``c`` are coefficients of vehicles (R,)."""
    total = np.maximum(c.delay + oldest(windows, c), 0.0)  # late reports see the motion that older commands made
    whole = np.floor(total / windows.dt + 1e-6)
    c = c._replace(delay=np.maximum(total - whole * windows.dt, 0.0))
    silent = np.zeros((len(windows), len(total), c.full_thrust.shape[-1]))
    actuation = Actuation(windows, c, ActiveTerms.of(c), whole.astype(int), silent, _substeps(windows, c))
    if actuation.late:
        actuation = replace(actuation, substeps=max(actuation.substeps, 2))
    back = int(np.ceil(slowest_s(c, actuation.terms, LAG_MEMORY) / windows.dt))
    if back:
        (targets,) = actuation.targets(slice(0, len(windows)), np.arange(-back, 0))
        thrust, after = targets[:, :, 0], thrust_follower(c, actuation.terms, windows.dt)
        for ago in range(1, back):
            thrust = after(thrust, targets[:, :, ago])
        actuation = replace(actuation, thrust=thrust)
    return actuation


def _substeps(windows: Windows, c: Coefficients) -> int:
    """Runge-Kutta steps per grid step that are accurate at the speeds of the log."""
    speed = np.quantile(np.abs(windows.guess[:, 6:]), 0.99, axis=0)
    linear = np.diagonal(c.linear_drag, axis1=-2, axis2=-1)
    rate = (linear + 2 * c.quadratic_drag * speed) * np.diagonal(c.mass_inverse, axis1=-2, axis2=-1)
    most = int(np.ceil(windows.dt / LEAST_STEP))
    return int(np.clip(np.ceil(windows.dt * rate.max() / LONGEST_STEP), 1, most))


def _targets(c: Coefficients, terms: ActiveTerms, commands: Floats, dt: float, parts: int) -> list[Floats]:
    """Thrust targets by part of a step: vehicles (K, 1) of a delay below ``dt``, commands (w, K or 1, S, L, n)."""
    now = _target(c, terms, commands[..., 0, :])
    if commands.shape[-2] == 1:
        return [now] * parts
    older, late = _target(c, terms, commands[..., 1, :]) - now, np.clip(c.delay / dt, 0.0, 1.0)
    return [now + np.clip(late * parts - part, 0.0, 1.0)[..., None] * older for part in range(parts)]


def _target(c: Coefficients, terms: ActiveTerms, commands: Floats) -> Floats:
    """Thrust targets (w, K, S, n) of vehicles (K, 1) at commands (w, K or 1, S, n), those of equal thrusters once."""
    kinds, n = c.full_thrust.shape[0], commands.shape[-1]
    if kinds == 1 or commands.shape[1] != 1 or terms.routing:
        return thrust_target(c, terms, commands)
    numbers = np.stack([getattr(c, name)[:, 0] for name in CURVE_FIELDS], axis=-1)  # (K, n, 5)
    found = np.empty((len(commands), kinds, commands.shape[2], n))
    for thruster in range(n):
        first, kind = distinct(numbers[:, thruster])
        some = {name: getattr(c, name)[first][..., thruster, None] for name in CURVE_FIELDS}
        target = thrust_target(c._replace(**some), terms, commands[..., thruster, None])
        found[..., thruster] = target[..., 0][:, kind]
    return found


def distinct(numbers: Floats) -> tuple[np.ndarray, np.ndarray]:
    """Rows (K,) that differ from each other, among rows (R, k), and the one of them that each row (R,) equals."""
    known: dict[bytes, int] = {}
    kind = [known.setdefault(row.tobytes(), len(known)) for row in np.ascontiguousarray(numbers)]
    found = np.array(kind)
    return np.unique(found, return_index=True)[1], found


def _mean(targets: Sequence[Floats]) -> Floats:
    """Mean of thrust targets, and not of commands, because the dead band is not linear."""
    return targets[0] if len(targets) == 1 else sum(targets[1:], start=targets[0]) / len(targets)
