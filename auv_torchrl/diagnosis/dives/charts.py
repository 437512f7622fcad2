"""One number over all dives: what each dive tells, what is normal, and what changed."""

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from auv_torchrl.diagnosis.dives.answer import ChangeTold, DiveTold, Followed
from auv_torchrl.diagnosis.report.svg import circle, line, polyline, rect, svg, text, ticks
from auv_torchrl.quantities import counted, scale

_WIDTH, _HEIGHT = 340.0, 172.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 46.0, 10.0, 24.0, 26.0
_MOST_MARKS = 9  # dives that are numbered under the axis
_ROOM = 0.08  # of the range, above and below
_CUT = 3.0  # times the range of the values, to which intervals of dives that tell little are cut


def over_dives(
    number: Followed, dives: Sequence[DiveTold], change: ChangeTold | None, alarms: Sequence[int] = ()
) -> Markup:
    """Points with 95 % intervals over the number of the dive; the reference shaded, a change as a line.

    Args:
        number: what is drawn.
        dives: all of them.
        change: what happened to it, if anything did.
        alarms: dives in which it raised an alarm.
    """
    factor, unit = (100.0, "%") if number.unit == "1" else scale(number.unit, 1.0)
    told = {dive.number: dive.values[number.key] for dive in dives if number.key in dive.values}
    points = {n: (factor * v.value, factor * v.low, factor * v.high) for n, v in told.items()}
    fitted = [factor * value for value in change.line] if change else []
    low, high = _range([*points.values()], fitted)
    first, last = dives[0].number, dives[-1].number

    def across(n: float) -> float:
        return _LEFT + (n - first + 0.5) / (last - first + 1) * (_WIDTH - _LEFT - _RIGHT)

    def down(value: float) -> float:
        share = (min(max(value, low), high) - low) / (high - low)
        return _HEIGHT - _BOTTOM - share * (_HEIGHT - _TOP - _BOTTOM)

    parts = [text(_LEFT, 14, f"{number.label}, {unit}", "title"), *_reference(dives, across)]
    for tick in ticks(low, high):
        css = "zero" if abs(tick) < 1e-9 * (high - low) else "grid"
        parts += [line(_LEFT, down(tick), _WIDTH - _RIGHT, down(tick), css)]
        parts.append(text(_LEFT - 5, down(tick) + 3.5, f"{0.0 if css == 'zero' else tick:g}", "tick", "end"))
    parts += _marks(dives, across)
    for n, (value, least, most) in points.items():
        css = "changed" if change else "sound"
        parts.append(line(across(n), down(least), across(n), down(most), f"whisker {css}"))
        parts.append(circle(across(n), down(value), 2.8, f"told {css}"))
    if change:
        xs = [across(dive.number) for dive in dives]
        parts.append(polyline(xs, [down(value) for value in fitted], "curve shift"))
    for n in alarms:
        parts.append(text(across(n), _TOP + 9, "▼", "alarm", "middle"))
    return svg(_WIDTH, _HEIGHT, _label(number, points, change), parts, "chart")


def _range(points: Sequence[tuple[float, float, float]], fitted: Sequence[float]) -> tuple[float, float]:
    """What the axis shows: all values and lines, and intervals as long as they do not hide them."""
    values = np.array([value for value, *_ in points] + list(fitted) + [0.0])
    widths = np.array([high - low for _, low, high in points] or [1.0])
    reach = max(float(np.ptp(values)), float(np.median(widths)))
    low = max(min([low for _, low, _ in points], default=-1.0), float(values.min()) - _CUT * reach)
    high = min(max([high for *_, high in points], default=1.0), float(values.max()) + _CUT * reach)
    low, high = min(low, float(values.min())), max(high, float(values.max()))
    room = max(_ROOM * (high - low), 1e-9)
    return low - room, high + room


def _reference(dives: Sequence[DiveTold], across) -> list[str]:
    sound = [dive.number for dive in dives if dive.is_reference]
    if not sound:
        return []
    left, right = across(sound[0] - 0.5), across(sound[-1] + 0.5)
    return [rect(left, _TOP, right - left, _HEIGHT - _TOP - _BOTTOM, "reference", 0)]


def _marks(dives: Sequence[DiveTold], across) -> list[str]:
    dated = all(dive.begun for dive in dives)
    most = _MOST_MARKS // 2 if dated else _MOST_MARKS
    every = max(1, -(-len(dives) // most))
    return [
        text(across(dive.number), _HEIGHT - 9, dive.begun[:10] if dated else str(dive.number), "tick", "middle")
        for dive in dives[every // 2 :: every]
    ]


def _label(number: Followed, points: dict[int, tuple[float, float, float]], change: ChangeTold | None) -> str:
    if not points:
        return f"{number.label}: no dive tells it"
    return f"{number.label} over {counted(len(points), 'dive')}: {change.sentence if change else 'no change'}"
