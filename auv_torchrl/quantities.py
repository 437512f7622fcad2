"""Numbers as people read them, on the console and on pages: digits, units, shares and plurals. Files keep SI units."""

import math
from collections.abc import Iterable

_LENGTHS = ((1.0, 1.0, "m"), (0.01, 100.0, "cm"), (0.0, 1000.0, "mm"))  # least size in m, factor, unit
_DEGREES = {"rad": "°", "rad/s": "°/s"}  # angles in radians are for programs


def words(name: str) -> str:
    """The name of an effect, a parameter or a scenario as people write it: ``thruster_gain`` as thruster gain."""
    return name.replace("_", " ")


def counted(count: int, one: str, many: str = "") -> str:
    """``1 episode``, ``3 episodes``; ``many`` where the plural is not the singular with an s."""
    return f"{count:,} {one if count == 1 else many or one + 's'}"


def series(names: Iterable[object]) -> str:
    """Names in a row: ``2``, ``2 and 3``, ``2, 3 and 5``."""
    *first, last = map(str, names)
    return f"{', '.join(first)} and {last}" if first else last


def number(value: float | None, digits: int = 3) -> str:
    """A number with so many significant digits, without an exponent where people would not write one."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    if not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{decimals}f}"


def scale(unit: str, size: float) -> tuple[float, str]:
    """Factor and unit by which people read numbers of a unit that are about so large; a unit of 1 is none.

    Lengths are read in m, cm or mm, angles in degrees; other units stay.
    """
    if unit in _DEGREES:
        return math.degrees(1.0), _DEGREES[unit]
    if unit == "m":
        return next((factor, name) for least, factor, name in _LENGTHS if abs(size) >= least or not size >= 0)
    return 1.0, "" if unit == "1" else unit


def with_unit(shown: str, unit: str) -> str:
    """A number that was written, and its unit."""
    return shown + (unit if not unit or unit.startswith("°") else f" {unit}")


def quantity(value: float | None, unit: str, digits: int = 3, sign: bool = False) -> str:
    """A value in SI units as people read it: ``1.53 mm``, ``91.2°``, ``0.552``.

    Args:
        value: in ``unit``.
        unit: of SI, or "1".
        digits: that are significant.
        sign: write a plus, too.
    """
    if value is None or not math.isfinite(value):
        return "–"
    factor, shown = scale(unit, abs(value))
    return ("+" if sign and value > 0 else "") + with_unit(number(factor * value, digits), shown)


def estimated(value: float, low: float, high: float) -> str:
    """A value with no digits that its interval leaves open: next to ± 0.005, 3e-5 is 0."""
    half = (high - low) / 2
    if not (math.isfinite(half) and half > 0):
        return number(value)
    if abs(value) >= half:
        return number(value)
    power = math.floor(math.log10(half / 10))
    rounded = round(value / 10.0**power) * 10.0**power
    return f"{rounded:.{max(0, -power)}f}" if 1e-4 <= abs(rounded) < 1e6 else number(rounded)


def between(low: float, high: float) -> str:
    """An interval in words; a dash where it has no width because the value was not fitted but chosen."""
    return f"{number(low)} to {number(high)}" if low < high else "–"


def percent(share: float | None, sign: bool = False) -> str:
    """A share in per cent, honest at both ends, or with a ``sign`` a change of something."""
    if share is None or not math.isfinite(share):
        return "–"
    if sign:
        return f"{100 * share:+.0f}\u202f%"
    if 0 < share < 0.005:
        return "<\u202f1\u202f%"
    if 0.995 < share < 1:
        return ">\u202f99\u202f%"
    return f"{100 * share:z.0f}\u202f%"  # no "-0"


def duration(seconds: float) -> str:
    """``0.5 ms``, ``4.1 s`` or ``2 min 05 s``."""
    if seconds < 0.1:
        return f"{1e3 * seconds:.1f} ms"
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s"
