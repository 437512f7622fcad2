"""dives.html: the report over many dives on one page that needs nothing else, with a chart of each parameter."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup

from auv_torchrl.diagnosis.report.drawing import from_above, from_behind
from auv_torchrl.diagnosis.report.svg import circle, line, polyline, rect, svg, text, ticks
from auv_torchrl.effects import EFFECTS
from auv_torchrl.monitoring.dive_history import ChangeEntry, DiveEntry, DiveHistory, ParameterEntry, rate, size_of
from auv_torchrl.monitoring.dive_record import NOISE
from auv_torchrl.quantities import counted, percent, scale, words
from auv_torchrl.vehicle import Vehicle

_HERE = Path(__file__).parent
_MANY = 8  # charts of one group, from which they are folded away where none of them changed
_WIDTH, _HEIGHT = 340.0, 172.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 46.0, 10.0, 24.0, 26.0
_MOST_LABELS = 9  # dives that are numbered under the axis
_ROOM = 0.08  # of the range, above and below
_CUT = 3.0  # times the range of the values, to which intervals of dives with little information are cut


@dataclass(frozen=True)
class ChartGroup:
    """The charts of one effect."""

    title: str
    meaning: str
    charts: Sequence[Markup]
    changed: bool
    is_folded: bool


def dives_page(history: DiveHistory, vehicle: Vehicle) -> str:
    """The page as HTML.

    Args:
        history: the report.
        vehicle: the nominal vehicle, no batch, for the drawing.
    """
    from auv_torchrl.diagnosis.report.page import STYLE, templates  # here: jinja2 is needed once the work is done

    environment = templates(_HERE)
    parameters = history.parameters
    environment.filters |= {
        "label": lambda key: parameters[key].label,
        "size": lambda value, key: size_of(value, parameters[key].unit),
    }
    environment.globals["state"] = state
    style = STYLE.read_text(encoding="utf-8")
    thrusters = sorted(_thrusters(history, vehicle))
    return environment.get_template("dives.html.j2").render(
        d=history,
        style=Markup(style + (_HERE / "dives.css").read_text(encoding="utf-8")),
        drawing=(from_above(vehicle, thrusters, ()), from_behind(vehicle, thrusters, ())),
        thrusters=thrusters,
        sign=_sign(history),
        facts=_facts(history),
        groups=_groups(history),
        rate=rate(history),
        dated=any(dive.begun for dive in history.dives),
        diagnosed=any(dive.diagnosis for dive in history.dives),
    )


def state(dive: DiveEntry, history: DiveHistory) -> tuple[str, str]:
    """A word about a dive, and the class of its colour."""
    if dive.refused:
        return "not used", "error"
    if any(alarm.dive == dive.number for alarm in history.alarms):
        return "alarm", "error"
    if not dive.is_explained:
        return "not explained", "warning"
    return ("reference", "info") if dive.is_reference else ("", "info")


def _sign(history: DiveHistory) -> tuple[str, str, str]:
    """Sign, word and class of the verdict."""
    if any(change.is_likely for change in history.changes):
        return "●", "changed", "unexplained"
    if history.changes or history.alarms or not all(dive.is_explained for dive in history.dives):
        return "◐", "look closer", "partly_explained"
    return "✓", "as it was", "no_gap"


def _facts(history: DiveHistory) -> list[tuple[str, str]]:
    """The few numbers beside the verdict."""
    used = [dive for dive in history.dives if not dive.refused]
    facts = [("dive" if len(used) == 1 else "dives", str(len(used)))]
    if history.alarms:
        facts.append(("the first alarm", f"dive {history.alarms[0].dive}"))
    if history.changes:
        first = history.changes[0]
        label = history.parameters[first.number].label
        facts.append((f"probability that it changed: {label}", percent(first.probability)))
    facts.append(("of a sound vehicle pass for one false alarm", f"{history.dives_per_false_alarm:g} dives"))
    return facts


def _thrusters(history: DiveHistory, vehicle: Vehicle) -> set[int]:
    """Those of which a parameter changed, likelier than not."""
    found, parameters = set(), history.parameters
    for change in filter(lambda change: change.is_likely, history.changes):
        for key in (change.number, *change.rivals):
            effect = parameters[key].effect
            if effect == NOISE:
                continue
            declared = EFFECTS[effect].member_parameters(vehicle)[key.split(".", 1)[1]]
            if declared.over == "thruster":
                found.add(int(key.rsplit("_", 1)[1]))
    return found


def _groups(history: DiveHistory) -> list[ChartGroup]:
    """Charts by effect: those with a change first."""
    by_effect: dict[str, list[ParameterEntry]] = {}
    seen = {key for dive in history.dives for key in dive.values}
    for parameter in history.numbers:
        if parameter.key in seen:
            by_effect.setdefault(parameter.effect, []).append(parameter)
    groups = [_group(effect, parameters, history) for effect, parameters in by_effect.items()]
    return sorted(groups, key=lambda group: (not group.changed, group.is_folded))


def _group(effect: str, parameters: Sequence[ParameterEntry], history: DiveHistory) -> ChartGroup:
    changed = history.changed
    alarms = {p.key: [alarm.dive for alarm in history.alarms if alarm.number == p.key] for p in parameters}
    charts = [dive_chart(p, history.dives, changed.get(p.key), alarms[p.key]) for p in parameters]
    moved = any(p.key in changed or alarms[p.key] for p in parameters)
    meaning = "how noisy the sensors are" if effect == NOISE else EFFECTS[effect].meaning
    if not parameters[0].watched:
        meaning += "; shown, but not watched"
    return ChartGroup(words(effect), meaning, charts, moved, len(parameters) > _MANY and not moved)


def dive_chart(
    parameter: ParameterEntry, dives: Sequence[DiveEntry], change: ChangeEntry | None, alarms: Sequence[int] = ()
) -> Markup:
    """Points with 95 % intervals over the number of the dive; the reference shaded, a change as a line.

    Args:
        parameter: what is drawn.
        dives: all of them.
        change: what happened to the parameter, if anything did.
        alarms: dives in which it raised an alarm.
    """
    factor, unit = (100.0, "%") if parameter.unit == "1" else scale(parameter.unit, 1.0)
    values = {dive.number: dive.values[parameter.key] for dive in dives if parameter.key in dive.values}
    points = {n: (factor * v.value, factor * v.low, factor * v.high) for n, v in values.items()}
    fitted = [factor * value for value in change.line] if change else []
    low, high = _range([*points.values()], fitted)
    first, last = dives[0].number, dives[-1].number

    def across(n: float) -> float:
        return _LEFT + (n - first + 0.5) / (last - first + 1) * (_WIDTH - _LEFT - _RIGHT)

    def down(value: float) -> float:
        share = (min(max(value, low), high) - low) / (high - low)
        return _HEIGHT - _BOTTOM - share * (_HEIGHT - _TOP - _BOTTOM)

    parts = [text(_LEFT, 14, f"{parameter.label}, {unit}", "title"), *_reference(dives, across)]
    for tick in ticks(low, high):
        css = "zero" if abs(tick) < 1e-9 * (high - low) else "grid"
        parts += [line(_LEFT, down(tick), _WIDTH - _RIGHT, down(tick), css)]
        parts.append(text(_LEFT - 5, down(tick) + 3.5, f"{0.0 if css == 'zero' else tick:g}", "tick", "end"))
    parts += _axis_labels(dives, across)
    for n, (value, least, most) in points.items():
        css = "changed" if change else "sound"
        parts.append(line(across(n), down(least), across(n), down(most), f"whisker {css}"))
        parts.append(circle(across(n), down(value), 2.8, f"told {css}"))
    if change:
        xs = [across(dive.number) for dive in dives]
        parts.append(polyline(xs, [down(value) for value in fitted], "curve shift"))
    for n in alarms:
        parts.append(text(across(n), _TOP + 9, "▼", "alarm", "middle"))
    return svg(_WIDTH, _HEIGHT, _title(parameter, points, change), parts, "chart")


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


def _reference(dives: Sequence[DiveEntry], across: Callable[[float], float]) -> list[str]:
    healthy = [dive.number for dive in dives if dive.is_reference]
    if not healthy:
        return []
    left, right = across(healthy[0] - 0.5), across(healthy[-1] + 0.5)
    return [rect(left, _TOP, right - left, _HEIGHT - _TOP - _BOTTOM, "reference", 0)]


def _axis_labels(dives: Sequence[DiveEntry], across: Callable[[float], float]) -> list[str]:
    dated = all(dive.begun for dive in dives)
    most = _MOST_LABELS // 2 if dated else _MOST_LABELS
    every = max(1, -(-len(dives) // most))
    return [
        text(across(dive.number), _HEIGHT - 9, dive.begun[:10] if dated else str(dive.number), "tick", "middle")
        for dive in dives[every // 2 :: every]
    ]


def _title(parameter: ParameterEntry, points: dict[int, tuple[float, float, float]], change: ChangeEntry | None) -> str:
    if not points:
        return f"{parameter.label}: no dive tells it"
    over = f"{parameter.label} over {counted(len(points), 'dive')}"
    return f"{over}: {change.sentence if change else 'no change'}"
