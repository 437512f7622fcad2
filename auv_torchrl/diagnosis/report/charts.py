"""The charts of the report: curves over time, errors by horizon, shares, intervals."""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from markupsafe import Markup

from auv_torchrl.diagnosis.report.svg import circle, decades, line, polyline, rect, svg, text, ticks
from auv_torchrl.diagnosis.verdict import Errors, Estimate, ThrustMap
from auv_torchrl.flightlog.log import Floats
from auv_torchrl.quantities import number, percent, quantity

_WIDTH, _HEIGHT = 300.0, 170.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 44.0, 8.0, 22.0, 24.0
_BAR = 16.0
_MAP_RANGE = -0.25, 1.75  # of the thrust, that the picture of a map shows
_DOTS = 36  # measured samples drawn per curve
_LABEL_WIDTH, _LABEL_HEIGHT = 32.0, 9.0  # of five digits in 10.5 px
# Where the label of a point may stand, best first: above, below, and beside a curve that is steep
_PLACES = ((0.0, -7.0), (0.0, 14.0), (-16.0, -7.0), (18.0, 12.0), (18.0, -7.0), (-16.0, 14.0))


def curves(title: str, unit: str, t: Floats, series: Mapping[str, Floats]) -> Markup:
    """Curves (T,) over time (T,): ``measured`` as dots, the others as lines; the names are CSS classes."""
    values = np.concatenate([np.asarray(v)[np.isfinite(v)] for v in series.values()])
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    margin = max(0.06 * (high - low), 1e-3)
    low, high = low - margin, high + margin
    start, stop = float(t[0]), float(t[-1])

    def across(time: Floats) -> Floats:
        return _LEFT + (np.asarray(time) - start) / (stop - start) * (_WIDTH - _LEFT - _RIGHT)

    def down(value: Floats) -> Floats:
        return _HEIGHT - _BOTTOM - (np.asarray(value) - low) / (high - low) * (_HEIGHT - _TOP - _BOTTOM)

    parts = [text(_LEFT, 13, f"{title}, {unit}", "title")]
    for tick in ticks(low, high):
        y = float(down(np.array(tick)))
        parts += [line(_LEFT, y, _WIDTH - _RIGHT, y, "grid"), text(_LEFT - 5, y + 3.5, f"{tick:g}", "tick", "end")]
    for tick in ticks(start, stop, 5):
        x = float(across(np.array(tick)))
        parts.append(text(x, _HEIGHT - 8, f"{tick:g} s", "tick", "middle"))
    for name in sorted(series, key=lambda name: name == "measured"):
        y = down(series[name])
        if name != "measured":
            parts.append(polyline(across(t).tolist(), y.tolist(), f"curve {name}"))
            continue
        every = max(1, len(t) // _DOTS)
        points = zip(across(t)[::every], y[::every], strict=True)
        parts += [circle(float(a), float(b), 2.6, "dot measured") for a, b in points if np.isfinite(b)]
    return svg(_WIDTH, _HEIGHT, f"{title} over time: {', '.join(series)}", parts, "chart")


def horizons(title: str, unit: str, horizon_s: Sequence[float], errors: Errors) -> Markup:
    """Errors before, after and the floor over the horizon, on a logarithmic scale."""
    curves_of = {"before": errors.before, "after": errors.after, "floor": errors.floor}
    positive = [value for values in curves_of.values() for value in values if value > 0] or [1.0]
    low, high = math.log10(min(positive)), math.log10(max(positive))
    low, high = low - 0.08 * (high - low) - 0.05, high + 0.16 * (high - low) + 0.1  # room for the labels
    slot = (_WIDTH - _LEFT - _RIGHT) / len(horizon_s)
    xs = [_LEFT + (i + 0.5) * slot for i in range(len(horizon_s))]

    def down(value: float) -> float:
        share = (math.log10(value) - low) / (high - low) if value > 0 else 0.0 * value  # of what is no number, none
        return _HEIGHT - _BOTTOM - share * (_HEIGHT - _TOP - _BOTTOM)

    parts = [text(_LEFT, 13, f"{title}, {unit}", "title")]
    for tick in decades(low, high):
        y = down(tick)
        parts += [line(_LEFT, y, _WIDTH - _RIGHT, y, "grid"), text(_LEFT - 5, y + 3.5, f"{tick:g}", "tick", "end")]
    for x, horizon in zip(xs, horizon_s, strict=True):
        parts.append(text(x, _HEIGHT - 8, f"{horizon:g} s", "tick", "middle"))
    drawn = {name: [down(value) for value in values] for name, values in curves_of.items()}
    parts += [polyline(xs, ys, f"curve {name}") for name, ys in reversed(drawn.items())]
    labels: list[tuple[float, float]] = []
    for name in ("after", "before"):
        points = zip(xs, drawn[name], strict=True)
        parts += [circle(x, y, 3.5, f"bar {name}") for x, y in points if math.isfinite(y)]
    for name in ("before", "after"):
        for x, y, value in zip(xs, drawn[name], curves_of[name], strict=True):
            places = [(x + across, y + below) for across, below in _PLACES]
            free = (place for place in places if _is_free(*place, xs, drawn.values(), labels))
            if math.isfinite(y) and (place := next(free, None)) is not None:
                labels.append(place)
                parts.append(text(*place, number(value, 2), f"value {name}", "middle"))
    label = f"{title} after {', '.join(f'{h:g} s' for h in horizon_s)}: before, after and floor"
    return svg(_WIDTH, _HEIGHT, label, parts, "chart")


def _is_free(
    x: float, base: float, xs: Sequence[float], curves: Iterable[Sequence[float]], labels: Sequence[tuple[float, float]]
) -> bool:
    """Whether a label centred at ``x`` on a base line lies over no curve and no other label, and within the chart."""
    left, right, top, bottom = x - _LABEL_WIDTH / 2, x + _LABEL_WIDTH / 2, base - _LABEL_HEIGHT, base + 2.0
    if top < _TOP or bottom > _HEIGHT - _BOTTOM or right > _WIDTH:
        return False
    if any(abs(x - other) < _LABEL_WIDTH and abs(base - line) < _LABEL_HEIGHT for other, line in labels):
        return False
    across = np.linspace(max(left, xs[0]), min(right, xs[-1]), 9)  # a curve ends at its outermost points
    heights = (np.interp(across, xs, ys) for ys in curves)
    return not any(((top < ys) & (ys < bottom)).any() for ys in heights)


def shares(label: str, values: Mapping[str, float]) -> Markup:
    """Horizontal bars of shares in [0, 1], in the order given."""
    parts = []
    for i, (name, value) in enumerate(values.items()):
        y = i * (_BAR + 6)
        parts.append(text(138, y + 12, name, "name", "end"))
        parts.append(rect(144, y, 130, _BAR, "track"))
        parts.append(rect(144, y, 130 * min(max(value, 0.0), 1.0), _BAR, "bar share"))
        parts.append(text(280, y + 12, percent(value), "value"))
    return svg(330, max(len(values), 1) * (_BAR + 6), label, parts, "shares")


def interval(estimate: Estimate) -> Markup:
    """The estimate with its interval, and a tick at the nominal value."""
    finite = [v for v in (estimate.value, estimate.low, estimate.high, estimate.nominal) if np.isfinite(v)]
    low, high = min(finite), max(finite)
    span = (high - low) or 1.0
    low, high = low - 0.1 * span, high + 0.1 * span

    def across(value: float) -> float:
        return 4 + 152 * (min(max(value, low), high) - low) / (high - low)

    parts = [
        line(4, 10, 156, 10, "grid"),
        line(across(estimate.nominal), 2, across(estimate.nominal), 18, "nominal"),
        line(across(estimate.low), 10, across(estimate.high), 10, "interval"),
        circle(across(estimate.value), 10, 4, "point"),
    ]
    numbers = (estimate.value, estimate.low, estimate.high, estimate.nominal)
    value, least, most, nominal = (quantity(n, estimate.unit) for n in numbers)
    return svg(160, 20, f"{value} in {least} to {most}, nominal {nominal}", parts, "interval")


def thrusts(measured: ThrustMap) -> Markup:
    """What a thruster gives of its thrust at each command, with its band, beside all of it."""
    low, high = _MAP_RANGE

    def across(command: float) -> float:
        return _LEFT + (command + 1) / 2 * (_WIDTH - _LEFT - _RIGHT)

    def down(share: float) -> float:
        return _HEIGHT - _BOTTOM - (min(max(share, low), high) - low) / (high - low) * (_HEIGHT - _TOP - _BOTTOM)

    parts = [text(_LEFT, 13, "share of its thrust, by command", "title")]
    for share in (0.0, 0.5, 1.0, 1.5):
        y = down(share)
        parts += [line(_LEFT, y, _WIDTH - _RIGHT, y, "grid"), text(_LEFT - 5, y + 3.5, percent(share), "tick", "end")]
    for command, label, anchor in ((-1.0, "full back", "start"), (0.0, "0", "middle"), (1.0, "full ahead", "end")):
        parts.append(text(across(command), _HEIGHT - 8, label, "tick", anchor))
    parts.append(polyline([across(-1.0), across(1.0)], [down(1.0)] * 2, "curve before"))
    for one in measured.slices:
        left, right, top, bottom = across(one.low), across(one.high), down(one.most), down(one.least)
        parts.append(rect(left, top, right - left, max(bottom - top, 1.0), "band", 0))
        parts.append(line(left, down(one.share), right, down(one.share), "curve after"))
    title = f"what thruster {measured.thruster} gives of its thrust, by its command"
    return svg(_WIDTH, _HEIGHT, title, parts, "chart")
