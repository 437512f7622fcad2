"""What a vehicle file keeps of its calibration: how sure each coefficient is, and what a sound vehicle's logs leave."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from auv_torchrl.diagnosis.calibrate.floor import sizes_by_axis
from auv_torchrl.diagnosis.calibrate.healthy import Calibration
from auv_torchrl.diagnosis.calibrate.nuisance import Centred, Nuisance
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient
from auv_torchrl.diagnosis.identify.problem import Known, NuisanceEntry
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import Finding, Severity
from auv_torchrl.quantities import counted
from auv_torchrl.sensors import CHANNELS
from auv_torchrl.settings import choices
from auv_torchrl.vehicle import CONTROLLED_INDEX, Vehicle

KEYS = (
    "logs", "seconds", "vehicle", "made", "version", "excess", "level", "floor", "noise", "rough_noise",
    "together", "shrinks", "scales",
)  # fmt: skip
ROUNDED = 1e-3  # by which the length of a row may be off 1
REMEDY = "calibrate it again with auv-calibrate, or take the section calibration out"


@dataclass(frozen=True)
class Kept:
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
    scales: Floats | None  # (k, g) in widths, what scales that no log tells leave unsure; None where a file was right

    @property
    def known(self) -> Known:
        """What a diagnosis takes from healthy logs."""
        width = np.array([width for *_, width in self.nuisance])[:, None]
        factor = width * self.together
        known = Known(self.floor, self.noise, self.rough_noise, self.nuisance, factor @ factor.T)
        known = known if self.scales is None else replace(known, scales=width * self.scales)
        if self.shrinks is None:
            return known
        factor = width * self.shrinks
        return replace(known, flights=len(self.logs), shrinks=factor @ factor.T)

    def calibration(self, vehicle: Vehicle) -> Calibration:
        """As if the healthy logs were here; ``vehicle`` is that of the file, roll and pitch held or free."""
        k = len(self.nuisance)
        nothing = Nuisance(self.nuisance, np.zeros(k), (), np.zeros(k))
        known = self.known
        centred = Centred(vehicle, nothing, np.zeros(k), known.nuisance_covariance)
        sound = Calibration(centred, known, (), self.excess, self.excess, False, (self._finding(),))
        return sound if self.level else sound_free(sound)

    def _finding(self) -> Finding:
        sentence = (
            f"the verdict rests on the calibration of this vehicle's file, made on {self.made} from "
            f"{', '.join(self.logs)} ({self.seconds:.0f} s), of which it leaves a chi-square of {self.excess:.2f} per "
            f"number: disturbance of {sizes_by_axis(self.floor, CONTROLLED_INDEX)}"
        )
        return Finding(Severity.INFO, "calibration_kept", sentence)


def sound_free(sound: Calibration) -> Calibration:
    """The same calibration of a vehicle that may roll and pitch."""
    vehicle = sound.centred.vehicle
    return replace(sound, centred=replace(sound.centred, vehicle=changed(vehicle, free=vehicle.free.new_ones(6))))


def read_kept(content: Any, coefficients: tuple[Coefficient, ...]) -> Kept | None:
    """The section ``calibration`` of a vehicle file; None where there is none.

    Args:
        content: the section.
        coefficients: what the section ``uncertainty`` says, in its order.

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
    return Kept(
        logs=tuple(map(str, logs)),
        seconds=float(_positive([content["seconds"]], "seconds", 1)[0]),
        made=str(content["made"]),
        excess=float(_positive([content["excess"]], "excess", 1)[0]),
        level=level,
        floor=_positive(content["floor"], "floor", 6),
        noise=_by_channel(content["noise"], "noise"),
        rough_noise=_by_channel(content["rough_noise"], "rough_noise"),
        nuisance=tuple((c.effect, c.member, c.nominal, c.width) for c in coefficients),
        together=_correlation(_triangle(content["together"], "together", count)),
        shrinks=_triangle(content["shrinks"], "shrinks", count) if "shrinks" in content else None,
        scales=_columns(content["scales"], "scales", count) if "scales" in content else None,
    )


def _positive(value: Any, key: str, count: int) -> Floats:
    try:
        found = np.array(value, float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"calibration: {key} is no list of numbers: {REMEDY}") from error
    if found.shape != (count,) or not (np.isfinite(found) & (found > 0)).all():
        raise ValueError(f"calibration: {key} is not {count} number{'s' * (count > 1)} above 0: {REMEDY}")
    return found


def _by_channel(value: Any, key: str) -> dict[str, float]:
    if not isinstance(value, Mapping) or not value or not set(value) <= set(CHANNELS):
        raise ValueError(f"calibration: {key} is no mapping out of {', '.join(CHANNELS)}: {REMEDY}")
    return dict(zip(value, _positive(list(value.values()), key, len(value)).tolist(), strict=True))


def _triangle(rows: Any, key: str, count: int) -> Floats:
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


def _columns(rows: Any, key: str, count: int) -> Floats:
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


def _correlation(root: Floats) -> Floats:
    """The root of a correlation, whose rows have length 1."""
    length = np.linalg.norm(root, axis=1, keepdims=True)
    if (length < 1 - ROUNDED).any():
        raise ValueError(f"calibration: together is no correlation: {REMEDY}")
    return root / length
