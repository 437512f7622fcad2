"""Whether a log keeps to the frames of the format: earth NED, body FRD.

Two witnesses: where pose and velocity are both there, d(position)/dt must equal R(attitude) v; and the vehicle must
move the way its thrusters push it. Faults do not imitate a wrong frame: a frame with z up mirrors sway, heave and yaw
at once and leaves surge alone.
"""

from collections.abc import Callable

import numpy as np

from auv_torchrl.flightlog.checks.agreement import NEEDED, reconcile
from auv_torchrl.flightlog.checks.motion import FEWEST_BLOCKS, SLOWEST, Blocks, Response, blocks, responses, rotations
from auv_torchrl.flightlog.checks.readings import convert_units
from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.log import Episode, Floats
from auv_torchrl.physics.kinematics import matvec
from auv_torchrl.quantities import percent
from auv_torchrl.vehicle import Vehicle

_FITS = 0.8  # share of the motion that a convention must explain to be named
_FAILS = 0.5  # share below which the format's own convention is in doubt
_REVERSED, _FOLLOWS = -0.5, 0.3  # correlations with the thrusters

_NED = "Give x north, y east, z down, yaw clockwise from north seen from above, and body axes forward, right, down"


def check_frames(
    episodes: tuple[Episode, ...],
    axes: tuple[str, ...],
    vehicle: Vehicle,
    units_known: bool = False,
    frame_known: bool = False,
) -> tuple[tuple[Episode, ...], tuple[str, ...], list[Finding]]:
    """The episodes and axes that can be used, in the units of the format, and what was found about frames and units.

    Where the units are known, a motion that does not fit the thrusters is not taken for one in other units; where the
    frame is, because a firmware wrote the log, not for one in another frame. No finding where the log keeps to the
    format, one of little weight where it is too short to tell.
    """
    b = blocks(episodes, vehicle)
    if len(b.length) < FEWEST_BLOCKS:
        sentence = "the log is too short to check its frames and units"
        finding = Finding(Severity.INFO, "frames_not_checked", sentence, "Log 10 s or more of motion")
        return episodes, axes, [finding]
    if found := _kinematics(b, axes):
        return episodes, axes, found
    episodes, axes, disagreeing = reconcile(b, episodes, axes, vehicle)
    episodes, converted = (episodes, []) if units_known else convert_units(episodes, axes, vehicle)
    return episodes, axes, [*disagreeing, *converted, *_dynamics(blocks(episodes, vehicle), axes, frame_known)]


def _kinematics(b: Blocks, axes: tuple[str, ...]) -> list[Finding]:
    """Look for a frame in which d(position)/dt is R v, where it is not in that of the format."""
    if not set(axes) >= NEEDED:
        return []
    velocity = np.nan_to_num(b.velocity[:, :3])
    seen = [0, 1, 2] if {"z", "w"} <= set(axes) else [0, 1]
    if np.sqrt((velocity**2).sum(-1).mean()) < SLOWEST:
        return []
    fits = {name: _explained(convention(b, velocity), seen) for name, convention in _CONVENTIONS.items()}
    own = fits.pop("")
    best = max(fits, key=lambda name: fits[name])
    if own >= _FAILS or fits[best] < _FITS:
        return []
    columns = tuple(axis for axis in ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w") if axis in axes)
    disagree = f"d(position)/dt and R(attitude) v agree to {percent(max(own, 0))} only"
    if best == _HEADING:
        close = percent(fits[best])
        sentence = f"{disagree}; they agree to {close} if yaw has a constant offset, or the Doppler log is turned"
        remedy = "Calibrate the compass, or see how the Doppler log is mounted (sensors: dvl_turn of the vehicle file)"
        return [Finding(Severity.WARNING, "heading_offset", sentence, remedy, ("yaw",))]
    sentence = f"{disagree}, but to {percent(fits[best])} if {best}"
    return [Finding(Severity.ERROR, "wrong_frame", sentence, _NED, columns, limits=True)]


def _explained(pair: tuple[Floats, Floats], seen: list[int]) -> float:
    given, derived = pair[0][:, seen], pair[1][:, seen]
    return 1.0 - float(((given - derived) ** 2).sum() / (given**2).sum())


def _turned(attitude: Floats, roll: float = 1, pitch: float = 1, yaw: float = 1, offset: float = 0) -> Floats:
    return rotations(attitude * np.array([roll, pitch, yaw]) + np.array([0, 0, offset]))


def _best_heading(b: Blocks, velocity: Floats) -> tuple[Floats, Floats]:
    derived = matvec(_turned(b.attitude), velocity)
    z = (derived[:, 0] + 1j * derived[:, 1]).conj() @ (b.rate[:, 0] + 1j * b.rate[:, 1])
    return b.rate[:, :3], matvec(_turned(b.attitude, offset=float(np.angle(z))), velocity)


_EAST_NORTH_UP = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
_EXCHANGED = np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]])
_Z_UP = np.array([1, 1, -1])
_HEADING = "yaw is off by a constant"
_CONVENTIONS: dict[str, Callable[[Blocks, Floats], tuple[Floats, Floats]]] = {
    "": lambda b, v: (b.rate[:, :3], matvec(_turned(b.attitude), v)),
    _HEADING: _best_heading,
    "u, v, w are earth velocities instead of body velocities": lambda b, v: (b.rate[:, :3], v),
    "x, y, z, yaw are east, north, up (ENU) and u, v, w forward, right, down": lambda b, v: (
        b.rate[:, :3] @ _EAST_NORTH_UP,
        matvec(_turned(b.attitude, pitch=-1, yaw=-1, offset=np.pi / 2), v),
    ),
    "x is east and y is north": lambda b, v: (b.rate[:, :3] @ _EXCHANGED, matvec(_turned(b.attitude), v)),
    "x, y, z are east, north, up (ENU)": lambda b, v: (b.rate[:, :3] @ _EAST_NORTH_UP, matvec(_turned(b.attitude), v)),
    "z is up": lambda b, v: (b.rate[:, :3] * _Z_UP, matvec(_turned(b.attitude), v)),
    "u, v, w are forward, left, up": lambda b, v: (
        b.rate[:, :3],
        matvec(_turned(b.attitude), v * np.array([1, -1, -1])),
    ),
    "yaw counts counter-clockwise": lambda b, v: (b.rate[:, :3], matvec(_turned(b.attitude, yaw=-1), v)),
    "yaw counts counter-clockwise from east": lambda b, v: (
        b.rate[:, :3],
        matvec(_turned(b.attitude, yaw=-1, offset=np.pi / 2), v),
    ),
}


def _dynamics(b: Blocks, axes: tuple[str, ...], frame_known: bool) -> list[Finding]:
    """Compare the motion with the push of the thrusters."""
    answer = responses(b)
    mirrored = {name for name, response in answer.items() if response.correlation < _REVERSED}
    if frame_known:
        if not mirrored:
            return []
        goes = f"{', '.join(sorted(mirrored))} {'goes' if len(mirrored) == 1 else 'go'}"
        sentence = f"{goes} against the thrusters: some of these are reversed, or their plugs are exchanged"
        return [Finding(Severity.WARNING, "against_thrusters", sentence, "See which the diagnosis names", axes)]
    follows = {name for name, response in answer.items() if response.correlation > _FOLLOWS}
    if mirrored == {"sway", "heave", "yaw"}:
        sentence = (
            "sway, heave and yaw all go against the thrusters while surge does not: the pose is in a frame with z up "
            "(ENU) or the body axes are forward, left, up"
        )
        return [Finding(Severity.ERROR, "z_up", sentence, _NED, axes, limits=True)]
    if mirrored == {"sway", "yaw"} and "surge" in follows and "heave" not in answer:
        sentence = (
            "sway and yaw go against the thrusters while surge does not: either the frame has z up (ENU), or the "
            "thrusters of the two sides are exchanged"
        )
        remedy = "Check the frame: NED"
        return [Finding(Severity.WARNING, "z_up_or_sides_exchanged", sentence, remedy, axes, limits=True)]
    if mirrored == {"heave"}:
        sentence = "heave goes against the vertical thrusters: either z is up, or these thrusters are reversed"
        columns = tuple(axis for axis in ("z", "w") if axis in axes)
        remedy = "Check that z is depth"
        return [Finding(Severity.WARNING, "z_up_or_reversed", sentence, remedy, columns, limits=True)]
    return _other_pose_frame(b, axes, answer)


def _other_pose_frame(b: Blocks, axes: tuple[str, ...], answer: dict[str, Response]) -> list[Finding]:
    """Another reading of the pose under which the vehicle follows its thrusters, where as given it does not."""
    planar = [answer[name].correlation for name in ("surge", "sway") if name in answer]
    if not {"x", "y", "yaw"} <= set(axes) or len(planar) < 2 or max(planar) > _FAILS:
        return []
    for name, reading in _POSE_READINGS.items():
        answer = responses(reading(b))
        if len(answer) >= 3 and min(response.correlation for response in answer.values()) > _FITS:
            sentence = f"the vehicle goes where its thrusters push it only if {name}"
            return [Finding(Severity.ERROR, "wrong_frame", sentence, _NED, axes, limits=True)]
    return []


def _read_as(matrix: Floats, yaw: float, offset: float) -> Callable[[Blocks], Blocks]:
    def reading(b: Blocks) -> Blocks:
        attitude = b.attitude * np.array([1, 1, yaw]) + np.array([0, 0, offset])
        rate = np.concatenate((b.rate[:, :3] @ matrix, yaw * b.rate[:, 3:]), axis=-1)
        return b._replace(attitude=attitude, rate=rate)

    return reading


_POSE_READINGS = {
    "x is east and y is north": _read_as(_EXCHANGED, 1, 0),
    "x, y, z are east, north, up (ENU)": _read_as(_EAST_NORTH_UP, 1, 0),
    "yaw counts counter-clockwise": _read_as(np.eye(3), -1, 0),
    "yaw counts counter-clockwise from east": _read_as(np.eye(3), -1, np.pi / 2),
}
