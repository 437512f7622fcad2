"""A calibration as a vehicle file: coefficients, how sure they are, and what a diagnosis needs of the healthy logs."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import yaml

from auv_torchrl.command.errors import one_line
from auv_torchrl.diagnosis.calibrate.healthy import Calibration
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import Z95
from auv_torchrl.effects import EFFECTS
from auv_torchrl.vehicle import Vehicle, load_vehicle
from auv_torchrl.vehicle_file import DIGITS, entries, flow, fold, section_lines

LEAST = 1e-12  # of an eigenvalue of a correlation, which rounding may have made singular


def vehicle_yaml(
    sound: Calibration, given: Vehicle, name: str, about: Mapping[str, Any], comments: Sequence[str] = ()
) -> str:
    """A vehicle file, which training, flights and diagnoses read like any other.

    Args:
        sound: what was calibrated.
        given: the vehicle that it was calibrated from, as its file says, empty batch.
        name: of the vehicle.
        about: entries of the section ``calibration`` that the calibration itself does not know.
        comments: lines at the top.

    Raises:
        ValueError: for a vehicle that no file can hold.
    """
    content = entries(fold(sound.vehicle), name)
    own = load_vehicle(content)
    order, width = _as_in_file(sound, own)
    lines = [f"# {line}" for line in comments]
    for key, value in content.items():
        lines += section_lines(key, value)
    lines += [
        "# Standard deviations, each with all others unknown. No log tells the overall scale, of all masses, thrusts",
        "# and drags alike: it is where the vehicle that was calibrated had it. calibration.scales, where it was not",
        "# known, is how far each may be off with it, calibration.together what logs tell of them. Words compare with",
        f"# the vehicle that was calibrated, {one_line(str(about['vehicle']))}.",
        "uncertainty:",
    ]
    told = _told(sound, given)
    effect = ""
    for place in order:
        its, member, *_ = sound.known.nuisance[place]
        lines += [f"  {its}:"] if its != effect else []
        effect = its
        lines.append(f"    {member}: {width[place]:.{DIGITS}g}  # {told[place]}")
    kept = {
        **about,
        "excess": _round(sound.excess),
        "level": not sound.tilts,
        "floor": [_round(size) for size in sound.known.floor.tolist()],
        "noise": {channel: _round(size) for channel, size in sound.known.noise.items()},
        "rough_noise": {channel: _round(size) for channel, size in sound.known.rough_noise.items()},
    }
    lines += [
        "# What a diagnosis takes from the healthy flights, so that it needs none; N, N m in surge to yaw, m, rad.",
        "calibration:",
        *("  " + line for line in yaml.safe_dump(kept, sort_keys=False, default_flow_style=None).splitlines()),
        "  together:  # times its transpose, the correlation of the numbers above, in their order",
        *_rows(_root(sound, sound.known.nuisance_covariance, order)),
    ]
    if sound.known.shrinks is not None:
        lines.append("  shrinks:  # likewise, in the same units, the part of it that falls with more flights")
        lines += _rows(_root(sound, sound.known.shrinks, order))
    if sound.known.scales is not None:
        lines.append("  scales:  # in the same units, how far each is off with each scale that no log tells")
        size = np.sqrt(np.diag(sound.known.nuisance_covariance))[:, None]
        lines += [f"    - {flow(row)}" for row in (sound.known.scales / size)[order].tolist()]
    return "\n".join([*lines, ""])


def _as_in_file(sound: Calibration, own: Vehicle) -> tuple[list[int], list[float]]:
    """The places of the slack parameters in the order in which a file is read, and their deviations in its units."""
    nuisance = sound.known.nuisance
    read = [(name, member) for name, effect in EFFECTS.items() for member in effect.member_parameters(own)]
    order = sorted(range(len(nuisance)), key=lambda place: read.index(nuisance[place][:2]))
    size = np.sqrt(np.diag(sound.known.nuisance_covariance)).tolist()
    for place, (effect, member, nominal, _) in enumerate(nuisance):
        if nominal and (now := EFFECTS[effect].nominal(own)[member]):
            size[place] *= abs(now / nominal)  # gains are part of the thrusts and dead bands now
    return order, size


def _root(sound: Calibration, covariance: Floats, order: list[int]) -> Floats:
    """Lower triangle (k, k) whose product with its transpose is a covariance, in deviations of the slack parameters."""
    size = np.sqrt(np.diag(sound.known.nuisance_covariance))
    scaled = (covariance / np.outer(size, size))[np.ix_(order, order)]
    value, vector = np.linalg.eigh(0.5 * (scaled + scaled.T))
    half = vector * np.sqrt(np.maximum(value, LEAST))
    root: Floats = np.transpose(np.linalg.qr(half.T, mode="r"))
    return root * np.where(np.diag(root) < 0, -1.0, 1.0)


def _rows(triangle: Floats) -> list[str]:
    return [f"    - {flow(row[: i + 1])}" for i, row in enumerate(triangle.tolist())]


def _told(sound: Calibration, given: Vehicle) -> list[str]:
    """Each coefficient in words, against the file that was calibrated, with its 95 % interval."""
    size, away = np.sqrt(np.diag(sound.known.nuisance_covariance)), sound.centred.file
    told = []
    for (effect, member, nominal, _), sd, file in zip(sound.known.nuisance, size.tolist(), away.tolist(), strict=True):
        p = EFFECTS[effect].member_parameters(given)[member]
        before = p.nominal_value(given, member)
        if p.is_factor:
            value, half = before * nominal / (nominal + file), Z95 * sd * before / abs(nominal + file)
        else:
            value, half = (nominal if callable(p.nominal) else nominal - file), Z95 * sd
        words = p.said(member, value)
        unit = "" if p.unit == "1" else f" {p.unit}"
        low, high = max(value - half, p.low), min(value + half, p.high)
        told.append(f"{words}; 95 % in [{low:.3g}, {high:.3g}]{unit}")
    return told


def _round(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
