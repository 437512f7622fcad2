"""Held-out stretches predicted from the commands alone, without and with the effects: how far the gap shrinks.

The spread of a prediction holds sensor noise and the estimated start. Neither tells what pushes a vehicle next, nor
what its simulator leaves out: healthy flights do, by how much they miss their own predictions (:func:`unforeseen`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from auv_torchrl.diagnosis.calibrate.calibration import Calibration
from auv_torchrl.diagnosis.identify.hypotheses import Settings, apply_values, batch
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.actuation import actuate
from auv_torchrl.diagnosis.motion.cut import cut_windows, grid_step
from auv_torchrl.diagnosis.motion.noise import colour_in_pieces, whiten
from auv_torchrl.diagnosis.motion.rollout import DIVERGING, fly
from auv_torchrl.diagnosis.motion.smooth import Layout, follow, noise_per_sample, rough_force
from auv_torchrl.diagnosis.motion.windows import Floats, Windows, columns_of_motion
from auv_torchrl.diagnosis.thresholds import FLEW_OFF, HORIZONS_S, WITHIN_FLOOR
from auv_torchrl.diagnosis.verdict import Errors, Gap, Trajectory, Window
from auv_torchrl.flightlog import FlightLog
from auv_torchrl.flightlog.readiness import START_S
from auv_torchrl.physics.kinematics import least_turn
from auv_torchrl.sensors import MOTION, motion_of
from auv_torchrl.vehicle import DEGREES_OF_FREEDOM, Vehicle

# Times the disturbance, the force under which a start is estimated: some of all stretches begin in as large a one.
PUSHED = 4.0
MOST_STRETCHES = 60
SMALL = 1e-2  # standard deviations of the start, for the slope of the prediction
BIN_S = HORIZONS_S[0] / 2  # s of horizon, over which errors are averaged
BINS = round(HORIZONS_S[-1] / BIN_S)
MIDDLES = BIN_S * (np.arange(BINS) + 0.5)  # s


@dataclass(frozen=True)
class Predictions:
    """``W`` held-out stretches with the predictions of ``V`` vehicles from the same starts."""

    windows: Windows
    error: Floats  # (W, V, m, C) measured less predicted
    spread: Floats  # (W, m, C) standard deviation that sensor noise and the estimated start leave to a true model
    states: Floats  # (W, V, S + 1, 13) true states on the grid
    reported: Floats  # (W, V, m, C) what the sensors would have measured


def predict_by(problem: Problem, log: FlightLog, vehicles: list[Vehicle], settings: Settings) -> Predictions:
    """The prediction of held-out stretches, with the sensor noise and the disturbance of a problem."""
    return predict(log, vehicles, settings, problem.sigma, PUSHED * problem.floor)


@DIVERGING
def predict(
    log: FlightLog, vehicles: list[Vehicle], settings: Settings, sigma: dict[str, float], force: Floats
) -> Predictions:
    """Predict every held-out stretch with each vehicle (empty batches), the best of them last.

    All start from the same states: those which the best one, pushed by a disturbance of ``force`` (D,) N and N m,
    needs to follow the first second of samples.

    Raises:
        ValueError: if the log holds no stretch of one second.
    """
    windows, head = cut_stretches(log, settings)
    parts = windows.steps // head
    if len(windows) > MOST_STRETCHES:
        windows = windows.subset(np.linspace(0, len(windows) - 1, MOST_STRETCHES).astype(int))
    begin = windows.split(head).subset(np.arange(0, len(windows) * parts, parts))
    layout = Layout.of(begin, vehicles[0], settings.bin_s)
    best = batch(vehicles[-1], [{}])
    rough = rough_force(begin, best, layout)
    if begin.errors.coloured:
        begin = whiten(begin, best, layout, sigma, (begin.guess, rough))
    state = follow(begin, best, layout, sigma, force, rough)
    slope = state.slope / noise_per_sample(begin, sigma)[:, None]
    widths = np.concatenate([layout.loose, np.tile(force, layout.bins)])
    root = root_of_covariance(information_of(slope), widths, len(layout.start))
    starts = np.repeat(state.start[:, None], 1 + len(layout.start), axis=1)
    starts[:, 1:, layout.start] += SMALL * root.swapaxes(1, 2)
    left = windows.residual(fly(actuate(windows, best), starts)[0])
    change = left[:, 1:] - left[:, :1]
    change[..., windows.angular] = least_turn(change[..., windows.angular])
    noise = np.array([sigma[channel] for channel in windows.channels])
    spread = np.sqrt(((change / SMALL) ** 2).sum(1) + noise**2 + colour_of(windows, best, settings, state.start))
    errors, states, reported = [], [], []
    for vehicle in vehicles:
        one = batch(vehicle, [{}])
        predicted, passed = fly(actuate(windows, one), state.start[:, None])
        errors.append(errors_along(windows, predicted)[:, 0])
        states.append(passed[:, 0])
        reported.append(predicted[:, 0])
    return Predictions(windows, np.stack(errors, 1), spread, np.stack(states, 1), np.stack(reported, 1))


def information_of(slope: Floats) -> Floats:
    """Information (W, k, k) of whitened slopes (W, m, k): none where the vehicle diverges and follows no sample."""
    information = slope.swapaxes(1, 2) @ slope
    return np.where(np.isfinite(information).all((1, 2), keepdims=True), information, 0.0)


def root_of_covariance(information: Floats, widths: Floats, first: int) -> Floats:
    """A root (W, n, n) of the covariance of the ``first`` n numbers, by information (W, k, k) and ``widths`` (k,).

    ``widths`` are those of the prior. In units of the prior every direction has an information of 1 at least. So there
    is a root whatever rounding leaves of directions that samples tell a million times as well as others.
    """
    told, along = np.linalg.eigh(np.eye(len(widths)) + information * np.outer(widths, widths))
    whole = widths[:first, None] * along[:, :first] / np.sqrt(np.maximum(told, 1.0))[:, None]  # (W, n, k)
    _, upper = np.linalg.qr(whole.swapaxes(1, 2))
    return upper.swapaxes(1, 2)


def errors_along(windows: Windows, predicted: Floats) -> Floats:
    """Measured less predicted (W, V, m, C), where angles count on from sample to sample.

    A heading that is predicted three quarters of a turn too far is not a quarter of a turn off: beyond half a turn,
    wrapped errors are as large as chance makes them, whatever predicts.
    """
    left = windows.residual(predicted)
    for w, c in product(range(len(windows)), np.flatnonzero(windows.angular)):
        seen = windows.trust[w, :, c] > 0
        left[w, :, seen, c] = np.unwrap(left[w, :, seen, c], axis=0)
    return left


def colour_of(windows: Windows, vehicle: Vehicle, settings: Settings, start: Floats) -> Floats:
    """Variance (W, m, C) of samples of which commands and estimates of a filter do not tell; ``vehicle`` is (1,)."""
    if not windows.errors.coloured:
        return np.zeros(windows.measured.shape)
    layout = Layout.of(windows, vehicle, settings.bin_s)
    still = np.zeros((len(windows), layout.bins, len(layout.dof)))
    pieces = colour_in_pieces(windows, vehicle, layout, (start, still))
    variance = [np.einsum("wgkk->wkg", covariance).copy() for _, covariance in pieces]  # a view would keep them all
    return np.concatenate(variance).reshape(windows.measured.shape)


def cut_stretches(log: FlightLog, settings: Settings) -> tuple[Windows, int]:
    """Stretches as long as the horizons and the log allow, and the grid steps of about a second; they divide it.

    Raises:
        FlightLogError: if the log holds no stretch of one second.
    """
    dt, _ = grid_step(log)
    pair = 2 * max(1, round(settings.bin_s / dt))
    head = pair * max(1, round(START_S / (pair * dt)))
    longest = max(episode.duration for episode in log.episodes) - settings.lead_s
    parts = max(1, min(int((longest + 1e-6) / (head * dt)), int(np.ceil(HORIZONS_S[-1] / (head * dt)))))
    return cut_windows(log, parts * head * dt, settings.lead_s), head


@DIVERGING
def closed_share(p: Predictions) -> float | None:
    """Share of the gap that is closed, over all channels and horizons in units of the floor.

    None without a gap, or where the first vehicle diverges.
    """
    scaled = p.error / p.spread[:, None]
    share = [_rms(scaled[:, v][p.windows.trust > 0]) for v in (0, 1)]
    if not WITHIN_FLOOR < share[0] < np.inf:
        return None
    return float(np.clip((share[0] - share[1]) / (share[0] - 1.0), 0.0, 1.0))


def measure_gap(p: Predictions, held_out: tuple[int, ...], closed: float | None) -> Gap:
    """Errors at the horizons, by kind and by degree of freedom."""
    return Gap(horizons_of(p.windows), **errors_by_kind(p), closed=closed, held_out_episodes=held_out)


@DIVERGING
def errors_by_kind(p: Predictions) -> dict[str, Any]:
    """``position_m``, ``yaw_rad`` and ``velocity`` (None where not measured), and ``dof``: errors at the horizons."""
    windows = p.windows
    rows = [_at_horizon(windows, horizon) for horizon in horizons_of(windows)]
    columns = {name: i for i, name in enumerate(windows.channels)}

    def errors(values: Floats, floor: Floats, seen: np.ndarray) -> Errors:
        """``values`` (W, V, m) and ``floor`` (W, m), where they are ``seen``, to root mean squares at each horizon."""
        known = [rows_h & seen for rows_h in rows]
        measured = [[_rms(values[:, v][rows_h]) for rows_h in known] for v in (0, 1)]
        return Errors(tuple(measured[0]), tuple(measured[1]), tuple(_rms(floor[rows_h]) for rows_h in known))

    def together(*names: str) -> Errors | None:
        inside = [columns[name] for name in names if name in columns]
        if not inside:
            return None
        seen = np.asarray((windows.trust[..., inside] > 0).all(-1))
        return errors(_norm(p.error[..., inside]), _norm(p.spread[..., inside]), seen)

    return {
        "position_m": together("x", "y", "z"),
        "yaw_rad": together("yaw"),
        "velocity": together("u", "v", "w"),
        "dof": {name: errors(*parts) for name, parts in _body_errors(p).items()},
    }


def horizons_of(windows: Windows) -> tuple[float, ...]:
    """Horizons in s that stretches of a log are long enough for."""
    return tuple(h for h in HORIZONS_S if h <= windows.steps * windows.dt + windows.dt)


def _body_errors(p: Predictions) -> dict[str, tuple[Floats, Floats, np.ndarray]]:
    """Errors (W, V, m), floors and whether they are seen (W, m), by degree of freedom; from velocities if measured."""
    columns = {name: i for i, name in enumerate(p.windows.channels)}
    found: dict[str, tuple[Floats, Floats, np.ndarray]] = {}
    seen = p.windows.trust > 0
    for channels in (MOTION[6:], MOTION[:6]):
        for name, channel in zip(DEGREES_OF_FREEDOM, channels, strict=True):
            if channel in columns and name not in found:
                column = columns[channel]
                found[name] = p.error[..., column], p.spread[..., column], seen[..., column]
    if {"x", "y", "yaw"} <= set(columns) and not {"u", "v"} <= set(columns):
        yaw = p.windows.measured[..., columns["yaw"]]
        c, s = np.cos(yaw), np.sin(yaw)
        (ex, fx, sx), (ey, fy, sy) = found["surge"], found["sway"]
        found["surge"] = c[:, None] * ex + s[:, None] * ey, np.hypot(c * fx, s * fy), sx & sy
        found["sway"] = c[:, None] * ey - s[:, None] * ex, np.hypot(c * fy, s * fx), sx & sy
    return found


def _at_horizon(windows: Windows, horizon: float) -> np.ndarray:
    """(W, m) True for the last sample of each stretch up to ``horizon`` seconds."""
    time = np.where(windows.present, windows.sampled, np.inf)
    nearest = np.abs(time - horizon).argmin(1)
    chosen = np.zeros(time.shape, bool)
    chosen[np.arange(len(windows)), nearest] = True
    return chosen


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _norm(values: Floats) -> Floats:
    return np.sqrt((values**2).sum(-1))


def held_out_windows(p: Predictions, log: FlightLog) -> tuple[Window, ...]:
    """The stretches as trajectories at the times of the samples, as sensors report them where they do."""
    found, windows = [], p.windows
    moved, columns = columns_of_motion(windows.channels)
    for w in range(len(windows)):
        rows = windows.present[w]
        grid = windows.index[w, rows]
        values = np.full((len(grid), 12), np.nan)
        values[:, columns] = windows.measured[w, rows][:, moved]
        commands = windows.commands[windows.episode[w], windows.start[w] + grid]
        time = windows.time[w] + (grid + windows.fraction[w, rows]) * windows.dt
        simulated = []
        for v in (0, 1):
            numbers = motion_of(p.states[w, v][grid])
            numbers[:, columns] = p.reported[w, v, rows][:, moved]
            simulated.append(_trajectory(numbers, values))
        measured = Trajectory(values[:, :6], values[:, 6:])
        found.append(Window(int(windows.number[w]), time, commands, measured, *simulated))
    return tuple(found)


def _trajectory(numbers: Floats, measured: Floats) -> Trajectory:
    """Simulated numbers (T, 12) as a trajectory, whose angles do not jump and begin near the measured ones (T, 12)."""
    angles = np.unwrap(numbers[:, 3:6], axis=0)
    ahead = np.nan_to_num(angles[0] - measured[0, 3:6])
    angles -= 2 * np.pi * np.round(ahead / (2 * np.pi))
    return Trajectory(np.concatenate([numbers[:, :3], angles], axis=1), numbers[:, 6:])


def unforeseen(healthy: Sequence[FlightLog], calibration: Calibration | None, settings: Settings) -> dict[str, Floats]:
    """Variance by channel at ``MIDDLES``, (BINS,), of errors beyond the spread of a prediction.

    Empty without fits to the healthy flights. Each flight is predicted by the vehicle that was fitted to it, with its
    own trim and current: the variance is rather too small than too large.
    """
    fits = calibration.flights_fit.fits if calibration and calibration.flights_fit else ()
    if len(fits) != len(healthy):
        return {}
    missed: dict[str, list[tuple[Floats, Floats]]] = {}
    for log, (problem, fit) in zip(healthy, fits, strict=True):
        own = apply_values(problem.vehicle, fit.explanation.values(problem.vehicle))
        p = predict_by(problem, log, [own], settings)
        beyond = np.clip(p.error[:, 0] ** 2, None, (FLEW_OFF * p.spread) ** 2) - p.spread**2
        time = p.windows.sampled
        for c, channel in enumerate(p.windows.channels):
            seen = p.windows.trust[..., c] > 0
            missed.setdefault(channel, []).append((time[seen], beyond[..., c][seen]))
    return {channel: _by_horizon(*map(np.concatenate, zip(*parts, strict=True))) for channel, parts in missed.items()}


def _by_horizon(time: Floats, beyond: Floats) -> Floats:
    """Means (BINS,) of squares at some times, and between where there are none."""
    at = np.minimum((time / BIN_S).astype(int), BINS - 1)
    count = np.bincount(at, minlength=BINS)
    if not count.any():
        return np.zeros(BINS)
    mean = np.bincount(at, np.nan_to_num(beyond), BINS)[count > 0] / count[count > 0]
    return np.interp(MIDDLES, MIDDLES[count > 0], np.maximum(mean, 0.0))


def widened(p: Predictions, variance: Mapping[str, Floats]) -> Predictions:
    """Predictions whose spread holds the variance of :func:`unforeseen`, too."""
    time, none = p.windows.sampled, np.zeros(BINS)
    more = [np.interp(time, MIDDLES, variance.get(channel, none)) for channel in p.windows.channels]
    return replace(p, spread=np.sqrt(p.spread**2 + np.stack(more, -1)))
