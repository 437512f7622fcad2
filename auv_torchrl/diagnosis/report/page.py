"""report.html: what a diagnosis says, on one page that needs nothing else."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import jinja2
import numpy as np
from jinja2.bccache import Bucket
from markupsafe import Markup

from auv_torchrl import __version__
from auv_torchrl.diagnosis.conclude.findings import set_wrong, to_change
from auv_torchrl.diagnosis.conclude.summary import suspects
from auv_torchrl.diagnosis.localize.wording import does_otherwise, seen_to_do
from auv_torchrl.diagnosis.report.charts import curves, horizons, interval, shares, thrusts
from auv_torchrl.diagnosis.report.dive import dive
from auv_torchrl.diagnosis.report.drawing import from_above, from_behind
from auv_torchrl.diagnosis.report.wording import (
    diverged,
    likely_causes,
    measured_errors,
    next_best,
    rows,
    sentence,
    shown,
    to_do,
)
from auv_torchrl.diagnosis.unanswered.wording import is_all, not_answering
from auv_torchrl.diagnosis.verdict import Diagnosis, Errors, FoundEffect, Verdict, Where, Window
from auv_torchrl.effects import EFFECTS, Origin
from auv_torchrl.files import say_not_kept
from auv_torchrl.flightlog import POSE, VELOCITY
from auv_torchrl.paths import cache_folder
from auv_torchrl.quantities import counted, number, percent, quantity, scale, with_unit, words
from auv_torchrl.vehicle import DEGREES_OF_FREEDOM, Vehicle

_HERE = Path(__file__).parent
STYLE = _HERE / "style.css"  # of all pages
_UNITS: dict[str, str] = dict(
    zip(POSE + VELOCITY, ("m",) * 3 + ("rad",) * 3 + ("m/s",) * 3 + ("rad/s",) * 3, strict=True)
)
_TITLES: dict[str, str] = {
    "x": "north", "y": "east", "z": "depth", "roll": "roll", "pitch": "pitch", "yaw": "heading", "u": "surge speed",
    "v": "sway speed", "w": "heave speed", "p": "roll rate", "q": "pitch rate", "r": "yaw rate",
}  # fmt: skip
LOOKS_LIKE = {
    Origin.ACTUATION: "the commands: thrusters, propellers, motor controllers, battery",
    Origin.BODY: "acceleration: mass, trapped water, payload",
    Origin.FLOW: "speed through the water: drag, fouling, current",
    Origin.EXTERNAL: "place, heading or time: tether, waves, contact, compass",
    Origin.SENSING: "the sensors: delay, bias, noise",
}
LOCATED = "found at one thruster"
_CLEAR_SHARE = 0.2  # degrees of freedom with a larger share of the gap are marked where no thruster is at fault
_GLYPH = {
    Verdict.NO_GAP: "✓", Verdict.EXPLAINED: "●", Verdict.PARTLY_EXPLAINED: "◐", Verdict.UNEXPLAINED: "○",
    Verdict.CANNOT_TELL: "?",
}  # fmt: skip


def templates(folder: Path) -> jinja2.Environment:
    """What turns the templates of a folder into pages, with the frame and the words that all of them use."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([folder, _HERE]), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, bytecode_cache=_compiled_before(),
    )  # fmt: skip
    environment.globals["version"] = __version__
    environment.filters |= {
        "percent": percent, "number": number, "quantity": quantity, "words": words, "sentence": sentence,
        "counted": counted,
    }  # fmt: skip
    return environment


def _compiled_before() -> jinja2.BytecodeCache | None:
    """Where templates are kept compiled, which takes 0.1 s; None where there is no folder for it."""
    try:
        folder = cache_folder() / "pages"
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        say_not_kept(error.strerror or str(error))
        return None
    return _Kept(str(folder))


class _Kept(jinja2.FileSystemBytecodeCache):
    """A cache that costs time and nothing else where it is full, read-only or damaged."""

    def load_bytecode(self, bucket: Bucket) -> None:
        """Read what was kept, if it can be read."""
        try:
            super().load_bytecode(bucket)
        except (OSError, EOFError, ValueError, TypeError):  # of marshal and pickle, where a file is cut or damaged
            bucket.reset()

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep it, if there is room."""
        try:
            super().dump_bytecode(bucket)
        except OSError as error:
            say_not_kept(error.strerror or str(error))


def report_page(diagnosis: Diagnosis, vehicle: Vehicle) -> str:
    """The page as HTML.

    Args:
        diagnosis: with its windows, which the curves are drawn from.
        vehicle: the nominal vehicle, no batch, for the drawing.
    """
    environment = templates(_HERE)
    environment.globals |= {"interval": interval, "shown": shown, "with_unit": with_unit, "rows": rows}
    likely = [effect for effect in diagnosis.effects if effect.is_likely]  # no red for what is likelier sound
    thrusters = sorted({i for effect in likely for i in effect.thrusters})
    has_gap = diagnosis.verdict is not Verdict.NO_GAP
    shows = has_gap and diagnosis.verdict is not Verdict.CANNOT_TELL  # a channel that does not answer shows no gap
    axes = _clear_axes(diagnosis.where, likely) if shows and not thrusters else []
    suspected = suspects(diagnosis.where) if has_gap and not likely else []
    marked = [_numbered(thrusters)] if thrusters else []
    marked += [f"{', '.join(axes)}, where the gap shows"] if axes else []
    marked += [f"{_numbered(suspected)}, whose commands it goes with"] if suspected else []
    thrusters = thrusters or suspected
    does = seen_to_do(diagnosis.where) if diagnosis.effects else does_otherwise(diagnosis.where)
    does = does if diagnosis.verdict in (Verdict.PARTLY_EXPLAINED, Verdict.UNEXPLAINED) else ""
    located = bool(does) and not diagnosis.effects
    candidates = [candidate for candidate in diagnosis.candidates if np.isfinite(candidate.probability)]
    return environment.get_template("page.html.j2").render(
        d=diagnosis,
        verdict=diagnosis.verdict,
        sign=(_GLYPH[diagnosis.verdict], LOCATED if located else words(diagnosis.verdict.key), diagnosis.verdict.key),
        style=Markup(STYLE.read_text(encoding="utf-8")),
        drawing=(from_above(vehicle, thrusters, axes), from_behind(vehicle, thrusters, axes)),
        marked=marked,
        unanswered=not_answering(diagnosis.findings),
        nothing_else=is_all(diagnosis.findings),
        set_wrong=set_wrong(diagnosis.findings, diagnosis.effects),
        to_change=to_change(diagnosis),
        leads=_leads(diagnosis),
        thrusts=thrusts(diagnosis.where.thrust_map) if diagnosis.where.thrust_map else None,
        does=does,
        next_best=next_best(diagnosis.decision),
        after=_after(diagnosis),
        diverged=diverged(diagnosis),
        figures=_figures(diagnosis.windows),
        overview=_overview(diagnosis),
        gap_charts=_gap_charts(diagnosis),
        confirmed=measured_errors(diagnosis.gap.confirmed) if diagnosis.gap.confirmed else [],
        facts=_facts(diagnosis),
        where=_where(diagnosis),
        likely=likely_causes(diagnosis),
        corrections=[effect for effect in diagnosis.effects if effect.calibrates],
        further=candidates,
        to_do=to_do(diagnosis),
        meaning={name: effect.meaning for name, effect in EFFECTS.items()},
    )


def _numbered(thrusters: Sequence[int]) -> str:
    return f"thruster{'s' if len(thrusters) > 1 else ''} {', '.join(map(str, thrusters))}"


def _after(diagnosis: Diagnosis) -> str:
    """What the simulator after the diagnosis has that it had not before."""
    if diagnosis.effects:
        return f"with the effect{'s' if len(diagnosis.effects) > 1 else ''} in it"
    return "with its coefficients calibrated"


def _leads(diagnosis: Diagnosis) -> list[str]:
    """Where to look for what no effect explains."""
    where = diagnosis.where
    found = [f"{percent(s)} of it shows in {name}" for name, s in where.dof.items() if s > _CLEAR_SHARE]
    found += [f"{percent(s)} goes with {LOOKS_LIKE[Origin(n)]}" for n, s in where.origin.items() if s > _CLEAR_SHARE]
    found += [f"{percent(where.thruster[str(i)])} of that with thruster {i}" for i in suspects(where)]
    return found + [f"it is {number(r.gap, 2)} times as large with {r.when}" for r in where.regime[:2]]


def _clear_axes(where: Where, effects: Iterable[FoundEffect]) -> list[str]:
    named = {part for effect in effects for name in effect.parameters for part in name.split("_")}
    from_effects = [axis for axis in DEGREES_OF_FREEDOM if axis in named]
    return from_effects or [axis for axis, share in where.dof.items() if share > _CLEAR_SHARE]


def _facts(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """The few numbers beside the verdict."""
    if not diagnosis.effects and diagnosis.verdict is not Verdict.NO_GAP:
        return []  # what was not explained has no numbers to show
    closed = diagnosis.gap.closed
    facts = [("of the gap closed", percent(closed))] if closed is not None else []
    widest_gaps = sorted(
        (kind for kind in measured_errors(diagnosis.gap) if kind[2].before), key=lambda kind: -_gap(kind[2])
    )
    for name, unit, errors in widest_gaps[:1]:
        before = number(errors.before[-1], 2) if np.isfinite(errors.before[-1]) else "diverges"
        change = with_unit(f"{before} → {number(errors.after[-1], 2)}", unit)
        floor = with_unit(number(errors.floor[-1], 2), unit)
        when = f"after {diagnosis.gap.horizon_s[-1]:g} s, before and after (floor {floor})"
        facts.append((f"{name} error {when}", change))
    faults = [effect for effect in diagnosis.effects if not effect.calibrates]
    if faults:
        first = faults[0]
        facts.append((f"probability of {words(first.name)}", percent(first.probability)))
    return facts


def _gap(errors: Errors) -> float:
    """How many floors the error is before, at the longest horizon: the quantity with most of them carries the gap."""
    before, floor = errors.before[-1], errors.floor[-1]
    return before / floor if np.isfinite(before) and floor > 0 else 0.0


def _gap_charts(diagnosis: Diagnosis) -> list[Markup]:
    gap = diagnosis.gap
    return [horizons(f"{name.capitalize()} error", unit, gap.horizon_s, e) for name, unit, e in measured_errors(gap)]


def _where(diagnosis: Diagnosis) -> list[tuple[str, Markup]]:
    where = diagnosis.where
    numbered = {f"thruster {name}": share for name, share in where.thruster.items()}
    kinds = (("by degree of freedom", where.dof), ("by origin", where.origin), ("by thruster", numbered))
    return [(title, shares(f"Share of the gap {title}", values)) for title, values in kinds if values]


def _overview(diagnosis: Diagnosis) -> Markup | None:
    """The whole log, where it is at hand."""
    overview = diagnosis.overview
    if overview is None:
        return None
    known = [window for window in diagnosis.windows if window.episode in overview.episodes]
    held_out = [(overview.at(w.episode, float(w.t[0])), overview.at(w.episode, float(w.t[-1]))) for w in known]
    return dive(overview, held_out, diagnosis.where.onset_s)


def _figures(windows: Sequence[Window]) -> list[tuple[str, list[Markup]]]:
    """A typical window and the one that is explained worst: a title, and measured curves beside simulated ones."""
    if not windows:
        return []
    order = np.argsort([_misfit(window) for window in windows])
    typical, worst = windows[order[len(order) // 2]], windows[order[-1]]
    shown = {"A typical held-out stretch": typical}
    if worst is not typical:
        shown["The held-out stretch that is explained worst"] = worst
    return [
        (f"{title}: episode {w.episode}, {w.t[0]:.1f} to {w.t[-1]:.1f} s", list(_window_charts(w)))
        for title, w in shown.items()
    ]


def _misfit(window: Window) -> float:
    """Size of what is left after the effects are in, each axis in units of its own motion."""
    left = []
    for kind in ("pose", "velocity"):
        measured = getattr(window.measured, kind)
        seen = np.isfinite(measured).all(axis=0)
        scale = measured[:, seen].std(axis=0) + 1e-3
        left.append((np.abs(getattr(window.after, kind)[:, seen] - measured[:, seen]) / scale).mean(axis=0))
    every = np.concatenate(left)
    return float(np.nan_to_num(every, nan=np.inf).mean()) if len(every) else 0.0


def _window_charts(window: Window) -> Iterable[Markup]:
    velocity_seen = np.isfinite(window.measured.velocity[:, [0, 1, 2, 5]]).all()
    kind, names, axes = ("velocity", VELOCITY, "uvwr") if velocity_seen else ("pose", POSE, ("x", "y", "z", "yaw"))
    for axis in axes:
        column = names.index(axis)
        factor, unit = scale(_UNITS[axis], 1.0)
        flown = {name: getattr(window, name) for name in ("measured", "before", "after")}
        series = {name: factor * getattr(motion, kind)[:, column] for name, motion in flown.items()}
        if np.isfinite(series["measured"]).any():
            yield curves(_TITLES[axis], unit, window.t, series)
