"""Small pieces of SVG whose colours come from the classes of style.css, so that they follow light and dark."""

import math
from collections.abc import Iterable, Sequence
from html import escape

from markupsafe import Markup


def svg(width: float, height: float, label: str, parts: Iterable[str], css: str = "") -> Markup:
    """A picture of that many units, scaled by its surroundings; ``label`` is read out to those who cannot see it."""
    body = "".join(parts)
    return Markup(
        f'<svg class="{css}" viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{escape(label)}">{body}</svg>'
    )


def line(x1: float, y1: float, x2: float, y2: float, css: str) -> str:
    """A straight line."""
    return f'<line class="{css}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'


def rect(x: float, y: float, width: float, height: float, css: str, radius: float = 2.0) -> str:
    """A rectangle with round corners."""
    return (
        f'<rect class="{css}" x="{x:.1f}" y="{y:.1f}" width="{max(width, 0):.1f}" height="{max(height, 0):.1f}" '
        f'rx="{radius:g}"/>'
    )


def circle(x: float, y: float, radius: float, css: str) -> str:
    """A circle."""
    return f'<circle class="{css}" cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}"/>'


def text(x: float, y: float, content: str, css: str = "", anchor: str = "start") -> str:
    """One line of text; ``anchor`` is start, middle or end."""
    return f'<text class="{css}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(content)}</text>'


def polyline(xs: Sequence[float], ys: Sequence[float], css: str) -> str:
    """A curve through finite points; it is interrupted where one is not finite."""
    commands, pen = [], "M"
    for x, y in zip(xs, ys, strict=True):
        if math.isfinite(x) and math.isfinite(y):
            commands.append(f"{pen}{x:.1f} {y:.1f}")
            pen = "L"
        else:
            pen = "M"
    return f'<path class="{css}" d="{"".join(commands)}"/>'


def arrow(x1: float, y1: float, x2: float, y2: float, css: str, head: float = 6.0) -> str:
    """A line with a head at its second end."""
    angle = math.atan2(y2 - y1, x2 - x1)
    corners = [(x2, y2)]
    for turn in (2.6, -2.6):
        corners.append((x2 + head * math.cos(angle + turn), y2 + head * math.sin(angle + turn)))
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
    return line(x1, y1, x2, y2, css) + f'<polygon class="{css} head" points="{points}"/>'


def decades(low: float, high: float) -> list[float]:
    """Round numbers between 10**low and 10**high: powers of ten, with 2 and 5 between where there is room."""
    factors = (1, 2, 5) if high - low < 1.6 else (1,)
    powers = range(math.floor(low), math.ceil(high))
    return [f * 10.0**p for p in powers for f in factors if low <= math.log10(f * 10.0**p) <= high]


def ticks(low: float, high: float, most: int = 5) -> list[float]:
    """Round numbers within a range, at most that many."""
    span = high - low
    if not span > 0:
        return [low]
    power = 10.0 ** math.floor(math.log10(span / most))
    step = next(power * factor for factor in (1, 2, 5, 10) if span / (power * factor) <= most)
    first = math.ceil(low / step - 1e-9)
    return [step * i for i in range(first, int(math.floor(high / step + 1e-9)) + 1)]
