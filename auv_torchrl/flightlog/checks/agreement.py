"""Whether position and body velocity tell the same motion; where they do not, the one that obeys the thrusters stays.

d(position)/dt must equal R(attitude) v. Faults of a vehicle leave that law alone, so what breaks it is a sensor.
"""

import numpy as np

from auv_torchrl.flightlog.checks.motion import SLOWEST, Blocks, blocks, force_balance, rotations
from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.log import POSE, VELOCITY, Episode, Floats, with_axes
from auv_torchrl.physics.kinematics import cross, matvec
from auv_torchrl.quantities import percent, quantity
from auv_torchrl.vehicle import Vehicle

NEEDED = {"x", "y", "yaw", "u", "v"}
FAILS = 0.5  # share of the motion that velocities must give, or they disagree ...
CLEARLY = 0.5  # ... as they do where a scale or a delay takes away this share of what is left open,
SCALED = 0.15  # relative, if the scale is at least so far from 1,
LATE_S = np.arange(0.0, 1.05, 0.1)  # s
LEAST_LATE_S = 0.2  # or the delay is at least so long
MOUNTED = 0.8  # share of the motion that a Doppler log mounted otherwise must give for both to stay
BALANCED = 0.3  # balance of forces from which a sensor is believed against another one


def reconcile(
    b: Blocks, episodes: tuple[Episode, ...], axes: tuple[str, ...], vehicle: Vehicle
) -> tuple[tuple[Episode, ...], tuple[str, ...], list[Finding]]:
    """The episodes and axes without the sensor that disagrees, and a finding that says so; else as they are.

    ``b`` are the blocks of the episodes.
    """
    if not set(axes) >= NEEDED or not np.sqrt(np.nanmean(b.velocity[:, :3] ** 2)) > SLOWEST:
        return episodes, axes, []
    own, _ = _agreement(b, 1.0)
    tried = {late: _agreement(blocks(episodes, vehicle, late)) for late in LATE_S.tolist()}
    late, (best, scale) = max(tried.items(), key=lambda item: item[1][0])
    explains = 1 - best < CLEARLY * (1 - own) and best > FAILS
    odd = abs(scale - 1) > SCALED or late >= LEAST_LATE_S
    if own >= FAILS and not (explains and odd):
        return episodes, axes, []
    how = f"d(position)/dt and R(attitude) v agree to {percent(max(own, 0))} only"
    turn, place, mounted = _mounting(b)
    if mounted > MOUNTED and 1 - mounted < CLEARLY * (1 - max(own, best)):
        at = ", ".join(f"{value:.2f}" for value in place)
        turned = quantity(turn, "rad", 2, sign=True)
        sentence = f"{how}; to {percent(mounted)} of a Doppler log that is turned by {turned} and sits at ({at}) m"
        remedy = "Enter its mounting in the vehicle file (sensors: dvl_turn, dvl_position), if it is meant"
        return episodes, axes, [Finding(Severity.WARNING, "dvl_mounting", sentence, remedy, ("u", "v"))]
    if explains and odd:
        what = [f"{scale:.2f} times the velocity"] if abs(scale - 1) > SCALED else []
        what += [f"{late:.1f} s before the velocity"] if late >= LEAST_LATE_S else []
        how += f"; the position moves with {' and '.join(what)} (to {percent(best)})"
    lost, kept = _less_believed(b, axes)
    columns = tuple(axis for axis in (*POSE, *VELOCITY[:3]) if axis in axes)
    remedy = "Check units, signs and time stamps of pose and velocity"
    if not lost:
        sentence = f"{how}; neither of the two follows the thrusters"
        finding = Finding(Severity.WARNING, "pose_velocity_disagree", sentence, remedy, columns, limits=True)
        return episodes, axes, [finding]
    sentence = f"{how}; {', '.join(lost)} are left out, because the thrusters push as {', '.join(kept)} say"
    finding = Finding(Severity.WARNING, "pose_velocity_disagree", sentence, remedy, columns)
    axes = tuple(axis for axis in axes if axis not in lost)
    return tuple(with_axes(episode, axes) for episode in episodes), axes, [finding]


def _agreement(b: Blocks, scale: float | None = None) -> tuple[float, float]:
    """Share of d(position)/dt that velocities give at a scale, by default the one that fits best, and that scale."""
    derived = matvec(rotations(b.attitude), np.nan_to_num(b.velocity[:, :3]))
    known = np.isfinite(b.rate[:, :3]) & np.isfinite(derived)
    given, derived = b.rate[:, :3][known], derived[known]
    if scale is None:
        scale = float(given @ derived / max(derived @ derived, 1e-12))
    return 1 - float(((given - scale * derived) ** 2).sum() / max(given @ given, 1e-12)), scale


def _mounting(b: Blocks) -> tuple[float, Floats, float]:
    """Turn in rad and place (3,) in m at which a Doppler log agrees best, beyond those of the file, and how well."""
    moved = matvec(rotations(b.attitude).mT, b.rate[:, :3])
    u, v, w = np.nan_to_num(b.velocity[:, :3].T)
    spinning = np.nan_to_num(b.velocity[:, 3:])
    felt = -np.stack([cross(spinning, np.broadcast_to(axis, spinning.shape)) for axis in np.eye(3)], axis=-1)
    seen = np.isfinite(moved) & np.isfinite(b.velocity[:, :3])
    turned = np.stack([np.stack([u, v, 0 * w], -1), np.stack([-v, u, 0 * w], -1)], axis=-1)
    rest = moved - np.stack([0 * w, 0 * w, w], -1)
    cos, sin, *_ = np.linalg.lstsq(np.concatenate([turned, felt], axis=-1)[seen], rest[seen], rcond=None)[0]
    angle = float(np.arctan2(sin, cos))
    rest = rest - turned @ np.array([np.cos(angle), np.sin(angle)])
    place = np.linalg.lstsq(felt[seen], rest[seen], rcond=None)[0]
    left = (rest - felt @ place)[seen]
    return angle, place, 1 - float(left @ left / max(moved[seen] @ moved[seen], 1e-12))


def _less_believed(b: Blocks, axes: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The axes that the balance of forces speaks against, and those that it speaks for; both empty where for none."""
    nothing = np.full_like(b.velocity, np.nan)
    by_pose = force_balance(b._replace(velocity=nothing))
    by_velocity = force_balance(b)
    if max(by_pose, by_velocity) < BALANCED:
        return (), ()
    poses, velocities = (tuple(n for n in names if n in axes) for names in (POSE[:3], VELOCITY))
    return (velocities, poses) if by_pose >= by_velocity else (poses, velocities)
