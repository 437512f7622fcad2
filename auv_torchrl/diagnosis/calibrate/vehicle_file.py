"""A calibration as a vehicle file, and back.

The sections ``uncertainty`` and ``calibration`` of the file hold how certain each coefficient is, and what a diagnosis
takes from the healthy flights, so that it needs none.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import yaml

from auv_torchrl.command.errors import one_line
from auv_torchrl.diagnosis.calibrate.calibration import Calibration
from auv_torchrl.diagnosis.calibrate.flights import sizes_by_axis
from auv_torchrl.diagnosis.calibrate.parameters import Coefficient, VehicleEstimate
from auv_torchrl.diagnosis.identify.problem import HealthyPrior, NuisanceEntry
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import Z95
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import Finding, Severity
from auv_torchrl.quantities import counted
from auv_torchrl.sensors import CHANNELS
from auv_torchrl.settings import choices
from auv_torchrl.vehicle import CONTROLLED_INDEX, Vehicle, load_vehicle
from auv_torchrl.vehicle.changed_file import DIGITS, entries, flow, fold, section_lines

KEYS = (
    "logs", "seconds", "vehicle", "made", "version", "excess", "level", "floor", "noise", "rough_noise",
    "together", "shrinks", "scales",
)  # fmt: skip
ROUNDED = 1e-3  # by which the length of a row may be off 1
LEAST = 1e-12  # least eigenvalue of a correlation, which rounding may have made singular
REMEDY = "calibrate it again with auv-calibrate, or take the section calibration out"


@dataclass(frozen=True)
class StoredCalibration:
    """The section ``calibration`` of a vehicle file, with its section ``uncertainty``."""

    logs: tuple[str, ...]  # of the healthy flights
    seconds: float  # of flight
    made: str  # date and time, UTC
    excess: float  # chi-square per number of the healthy logs under the calibrated vehicle
    level: bool  # whether roll and pitch were held
    floor: Floats  # (6,) N, N m
    noise: dict[str, float]  # by channel
    rough_noise: dict[str, float]  # by channel, from third differences
    nuisance: tuple[NuisanceEntry, ...]
    together: Floats  # (k, k) lower triangle whose product with its transpose is their correlation
    shrinks: Floats | None  # (k, k) likewise, of the part that falls with more flights; None in files without it
    scales: Floats | None  # (k, g) in widths, of the scale ambiguity; None where a file was right

    @property
    def prior(self) -> HealthyPrior:
        """What a diagnosis takes from healthy logs."""
        width = np.array([width for *_, width in self.nuisance])[:, None]
        factor = width * self.together
        prior = HealthyPrior(self.floor, self.noise, self.rough_noise, self.nuisance, factor @ factor.T)
        prior = prior if self.scales is None else replace(prior, scales=width * self.scales)
        if self.shrinks is None:
            return prior
        factor = width * self.shrinks
        return replace(prior, flights=len(self.logs), shrinks=factor @ factor.T)

    def calibration(self, vehicle: Vehicle) -> Calibration:
        """The calibration without its healthy logs; ``vehicle`` is that of the file, roll and pitch held or free."""
        prior = self.prior
        estimate = VehicleEstimate.without_spread(vehicle, self.nuisance, prior.nuisance_covariance)
        found = Calibration(estimate, prior, (), self.excess, self.excess, False, (self._finding(),))
        return found if self.level else found.with_free_tilts()

    def _finding(self) -> Finding:
        sentence = (
            f"the verdict rests on the calibration of this vehicle's file, made on {self.made} from "
            f"{', '.join(self.logs)} ({self.seconds:.0f} s), of which it leaves a chi-square of {self.excess:.2f} per "
            f"number: disturbance of {sizes_by_axis(self.floor, CONTROLLED_INDEX)}"
        )
        return Finding(Severity.INFO, "calibration_kept", sentence)


def read_calibration(content: Any, coefficients: Sequence[Coefficient]) -> StoredCalibration | None:
    """The section ``calibration`` of a vehicle file; None where there is none.

    Args:
        content: the section.
        coefficients: those of the section ``uncertainty``, in its order.

    Raises:
        ValueError: for what no calibration wrote, naming it.
    """
    if content is None:
        return None
    if not isinstance(content, Mapping):
        raise ValueError(f"calibration is no mapping: {REMEDY}")
    if odd := set(content) - set(KEYS):
        raise ValueError(f"calibration: unknown entries {sorted(map(str, odd))}: {choices(odd, KEYS)}; or {REMEDY}")
    if missing := set(KEYS) - set(content) - {"shrinks", "scales"}:
        raise ValueError(f"calibration: {', '.join(sorted(missing))} missing: {REMEDY}")
    logs, level, count = content["logs"], content["level"], len(coefficients)
    if not isinstance(logs, list | tuple) or not isinstance(level, bool):
        raise ValueError(f"calibration: logs is no list, or level neither true nor false: {REMEDY}")
    return StoredCalibration(
        logs=tuple(map(str, logs)),
        seconds=float(_read_positive([content["seconds"]], "seconds", 1)[0]),
        made=str(content["made"]),
        excess=float(_read_positive([content["excess"]], "excess", 1)[0]),
        level=level,
        floor=_read_positive(content["floor"], "floor", 6),
        noise=_read_channels(content["noise"], "noise"),
        rough_noise=_read_channels(content["rough_noise"], "rough_noise"),
        nuisance=tuple((c.effect, c.member, c.nominal, c.width) for c in coefficients),
        together=_normalise(_read_triangle(content["together"], "together", count)),
        shrinks=_read_triangle(content["shrinks"], "shrinks", count) if "shrinks" in content else None,
        scales=_read_columns(content["scales"], "scales", count) if "scales" in content else None,
    )


def _read_positive(value: Any, key: str, count: int) -> Floats:
    try:
        found = np.array(value, float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"calibration: {key} is no list of numbers: {REMEDY}") from error
    if found.shape != (count,) or not (np.isfinite(found) & (found > 0)).all():
        raise ValueError(f"calibration: {key} is not {count} number{'s' * (count > 1)} above 0: {REMEDY}")
    return found


def _read_channels(value: Any, key: str) -> dict[str, float]:
    if not isinstance(value, Mapping) or not value or not set(value) <= set(CHANNELS):
        raise ValueError(f"calibration: {key} is no mapping out of {', '.join(CHANNELS)}: {REMEDY}")
    return dict(zip(value, _read_positive(list(value.values()), key, len(value)).tolist(), strict=True))


def _read_triangle(rows: Any, key: str, count: int) -> Floats:
    """Rows of 1, 2, ... numbers as a lower triangle (k, k) whose rows are no longer than 1."""
    if not isinstance(rows, list | tuple) or not count or len(rows) != count:
        raise ValueError(f"calibration: {key} has not one row for each of the {count} of uncertainty: {REMEDY}")
    found = np.zeros((count, count))
    for i, row in enumerate(rows):
        try:
            found[i, : i + 1] = np.array(row, float).reshape(i + 1)
        except (TypeError, ValueError) as error:
            raise ValueError(
                f"calibration: row {i + 1} of {key} is not {counted(i + 1, 'number')}: {REMEDY}"
            ) from error
    if not np.linalg.norm(found, axis=1).max() <= 1 + ROUNDED or not (np.diag(found) > 0).all():
        raise ValueError(f"calibration: {key} is no part of a correlation: {REMEDY}")
    return found


def _read_columns(rows: Any, key: str, count: int) -> Floats:
    """Rows of as many numbers each as an array (k, g)."""
    try:
        found = np.array(rows, float).reshape(count, -1)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"calibration: {key} has not {counted(count, 'row')} of as many numbers each: {REMEDY}"
        ) from error
    if not np.isfinite(found).all():
        raise ValueError(f"calibration: {key} has entries that are no numbers: {REMEDY}")
    return found


def _normalise(root: Floats) -> Floats:
    """The root of a correlation, with rows of length 1."""
    length = np.linalg.norm(root, axis=1, keepdims=True)
    if (length < 1 - ROUNDED).any():
        raise ValueError(f"calibration: together is no correlation: {REMEDY}")
    return root / length


def vehicle_yaml(
    calibration: Calibration, file: Vehicle, name: str, about: Mapping[str, Any], comments: Sequence[str] = ()
) -> str:
    """A vehicle file, which training, flights and diagnoses read like any other.

    Args:
        calibration: of the vehicle.
        file: the vehicle as its own file says, empty batch.
        name: of the calibrated vehicle.
        about: entries of the section ``calibration`` that the calibration itself does not hold.
        comments: lines at the top.

    Raises:
        ValueError: for a vehicle that no file can hold.
    """
    content = entries(fold(calibration.vehicle), name)
    prior = calibration.prior
    order, width = _order_as_file(prior, load_vehicle(content))
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
    sentences = _describe_coefficients(calibration, file)
    effect = ""
    for place in order:
        its, member, *_ = prior.nuisance[place]
        lines += [f"  {its}:"] if its != effect else []
        effect = its
        lines.append(f"    {member}: {width[place]:.{DIGITS}g}  # {sentences[place]}")
    section = {
        **about,
        "excess": _round(calibration.excess),
        "level": not calibration.tilts,
        "floor": [_round(size) for size in prior.floor.tolist()],
        "noise": {channel: _round(size) for channel, size in prior.noise.items()},
        "rough_noise": {channel: _round(size) for channel, size in prior.rough_noise.items()},
    }
    lines += [
        "# What a diagnosis takes from the healthy flights, so that it needs none; N, N m in surge to yaw, m, rad.",
        "calibration:",
        *("  " + line for line in yaml.safe_dump(section, sort_keys=False, default_flow_style=None).splitlines()),
        "  together:  # times its transpose, the correlation of the numbers above, in their order",
        *_triangle_lines(prior, prior.nuisance_covariance, order),
    ]
    if prior.shrinks is not None:
        lines.append("  shrinks:  # likewise, in the same units, the part of it that falls with more flights")
        lines += _triangle_lines(prior, prior.shrinks, order)
    if prior.scales is not None:
        lines.append("  scales:  # in the same units, how far each is off with each scale that no log tells")
        size = np.sqrt(np.diag(prior.nuisance_covariance))[:, None]
        lines += [f"    - {flow(row)}" for row in (prior.scales / size)[order].tolist()]
    return "\n".join([*lines, ""])


def _order_as_file(prior: HealthyPrior, own: Vehicle) -> tuple[list[int], list[float]]:
    """The places of the nuisance parameters in the order in which a file is read, and their widths in its units."""
    nuisance = prior.nuisance
    read = [(name, member) for name, effect in EFFECTS.items() for member in effect.member_parameters(own)]
    order = sorted(range(len(nuisance)), key=lambda place: read.index(nuisance[place][:2]))
    size = np.sqrt(np.diag(prior.nuisance_covariance)).tolist()
    for place, (effect, member, nominal, _) in enumerate(nuisance):
        if nominal and (now := EFFECTS[effect].nominal(own)[member]):
            size[place] *= abs(now / nominal)  # gains are part of the thrusts and dead bands now
    return order, size


def _triangle_lines(prior: HealthyPrior, covariance: Floats, order: list[int]) -> list[str]:
    """A covariance as rows of the lower triangle that times its transpose gives it, in widths of the parameters."""
    size = np.sqrt(np.diag(prior.nuisance_covariance))
    scaled = (covariance / np.outer(size, size))[np.ix_(order, order)]
    value, vector = np.linalg.eigh(0.5 * (scaled + scaled.T))
    half = vector * np.sqrt(np.maximum(value, LEAST))
    root: Floats = np.transpose(np.linalg.qr(half.T, mode="r"))
    triangle = root * np.where(np.diag(root) < 0, -1.0, 1.0)
    return [f"    - {flow(row[: i + 1])}" for i, row in enumerate(triangle.tolist())]


def _describe_coefficients(calibration: Calibration, file: Vehicle) -> list[str]:
    """Each coefficient in words, against the file that was calibrated, with its 95 % interval."""
    prior, offsets = calibration.prior, calibration.estimate.file_offset.tolist()
    sizes = np.sqrt(np.diag(prior.nuisance_covariance)).tolist()
    sentences = []
    for (effect, member, nominal, _), sd, offset in zip(prior.nuisance, sizes, offsets, strict=True):
        p = EFFECTS[effect].member_parameters(file)[member]
        before = p.nominal_value(file, member)
        if p.is_factor:
            value, half = before * nominal / (nominal + offset), Z95 * sd * before / abs(nominal + offset)
        else:
            value, half = (nominal if callable(p.nominal) else nominal - offset), Z95 * sd
        unit = "" if p.unit == "1" else f" {p.unit}"
        low, high = max(value - half, p.low), min(value + half, p.high)
        sentences.append(f"{p.sentence_of(member, value)}; 95 % in [{low:.3g}, {high:.3g}]{unit}")
    return sentences


def _round(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
