"""dives.html: what many dives say, on one page that needs nothing else."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from auv_torchrl.diagnosis.dives.answer import DiveTold, Followed, ManyDives
from auv_torchrl.diagnosis.dives.charts import over_dives
from auv_torchrl.diagnosis.dives.said import rate, size_of
from auv_torchrl.diagnosis.dives.told import NOISE
from auv_torchrl.diagnosis.report.drawing import from_above, from_behind
from auv_torchrl.diagnosis.report.page import STYLE, templates
from auv_torchrl.effects import EFFECTS
from auv_torchrl.quantities import percent, words
from auv_torchrl.vehicle import Vehicle

_HERE = Path(__file__).parent
_MANY = 8  # charts of one family, from which they are folded away where none of them changed


@dataclass(frozen=True)
class Family:
    """The charts of one effect."""

    title: str
    meaning: str
    charts: Sequence[Markup]
    changed: bool
    is_folded: bool


def dives_page(told: ManyDives, vehicle: Vehicle) -> str:
    """The page as HTML.

    Args:
        told: what is said.
        vehicle: the nominal vehicle, no batch, for the drawing.
    """
    environment = templates(_HERE)
    followed = told.followed
    environment.filters |= {
        "label": lambda key: followed[key].label,
        "size": lambda value, key: size_of(value, followed[key].unit),
    }
    environment.globals["state"] = state
    style = STYLE.read_text(encoding="utf-8")
    thrusters = sorted(_thrusters(told, vehicle))
    return environment.get_template("dives.html.j2").render(
        d=told,
        style=Markup(style + (_HERE / "dives.css").read_text(encoding="utf-8")),
        drawing=(from_above(vehicle, thrusters, ()), from_behind(vehicle, thrusters, ())),
        thrusters=thrusters,
        sign=_sign(told),
        facts=_facts(told),
        families=_families(told),
        rate=rate(told),
        dated=any(dive.begun for dive in told.dives),
        diagnosed=any(dive.diagnosis for dive in told.dives),
    )


def state(dive: DiveTold, told: ManyDives) -> tuple[str, str]:
    """A word about a dive, and the class of its colour."""
    if dive.refused:
        return "not used", "error"
    if any(alarm.dive == dive.number for alarm in told.alarms):
        return "alarm", "error"
    if not dive.is_explained:
        return "not explained", "warning"
    return ("reference", "info") if dive.is_reference else ("", "info")


def _sign(told: ManyDives) -> tuple[str, str, str]:
    """Sign, word and class of the verdict."""
    if any(change.is_likely for change in told.changes):
        return "●", "changed", "unexplained"
    if told.changes or told.alarms or not all(dive.is_explained for dive in told.dives):
        return "◐", "look closer", "partly_explained"
    return "✓", "as it was", "no_gap"


def _facts(told: ManyDives) -> list[tuple[str, str]]:
    """The few numbers beside the verdict."""
    used = [dive for dive in told.dives if not dive.refused]
    facts = [("dive" if len(used) == 1 else "dives", str(len(used)))]
    if told.alarms:
        facts.append(("the first alarm", f"dive {told.alarms[0].dive}"))
    if told.changes:
        first = told.changes[0]
        label = told.followed[first.number].label
        facts.append((f"probability that it changed: {label}", percent(first.probability)))
    facts.append(("of a sound vehicle pass for one false alarm", f"{told.dives_per_false_alarm:g} dives"))
    return facts


def _thrusters(told: ManyDives, vehicle: Vehicle) -> set[int]:
    """Those of which a number changed, likelier than not."""
    found, followed = set(), told.followed
    for change in filter(lambda change: change.is_likely, told.changes):
        for key in (change.number, *change.rivals):
            effect = followed[key].effect
            if effect == NOISE:
                continue
            declared = EFFECTS[effect].member_parameters(vehicle)[key.split(".", 1)[1]]
            if declared.over == "thruster":
                found.add(int(key.rsplit("_", 1)[1]))
    return found


def _families(told: ManyDives) -> list[Family]:
    """Charts by effect: those with a change first."""
    groups: dict[str, list[Followed]] = {}
    seen = {key for dive in told.dives for key in dive.values}
    for number in told.numbers:
        if number.key in seen:
            groups.setdefault(number.effect, []).append(number)
    families = [_family(effect, numbers, told) for effect, numbers in groups.items()]
    return sorted(families, key=lambda family: (not family.changed, family.is_folded))


def _family(effect: str, numbers: Sequence[Followed], told: ManyDives) -> Family:
    changed = told.changed
    alarms = {n.key: [alarm.dive for alarm in told.alarms if alarm.number == n.key] for n in numbers}
    charts = [over_dives(n, told.dives, changed.get(n.key), alarms[n.key]) for n in numbers]
    moved = any(n.key in changed or alarms[n.key] for n in numbers)
    meaning = "how noisy the sensors are" if effect == NOISE else EFFECTS[effect].meaning
    if not numbers[0].watched:
        meaning += "; shown, but not watched"
    return Family(words(effect), meaning, charts, moved, len(numbers) > _MANY and not moved)
