"""Values along which chi-square is rough or a narrow valley, so that slopes mislead: those near by are tried."""

import numpy as np

from auv_torchrl.diagnosis.which.assess import assess
from auv_torchrl.diagnosis.which.following import nudge, nudged_chi2
from auv_torchrl.diagnosis.which.judged import Judged, leaves_much, slack_now
from auv_torchrl.diagnosis.which.problem import Problem
from auv_torchrl.diagnosis.which.steps import moved_along
from auv_torchrl.effects.effect import mean
from auv_torchrl.physics import prepare

THRESHOLD_REACH = (0.05, 0.015, 0.004)  # of the plausible range
TRIED = np.linspace(-1.0, 1.0, 9)  # of each reach
WALKS = 3  # at most, over exponents of the thrust curve
EXPONENT, ASYMMETRY = ("thrust_curve", ("exponent",)), ("thrust_curve", ("asymmetry",))
DEAD_BAND = ("dead_band", ("width",))
SLACK_REACH = 2.0  # standard deviations, within which thresholds are tried, ...
SLACK_MOVED = 0.2  # ... where they moved by this much; "no gap" also within ...
SLACK_NEAR = 0.4  # ... of the best of them


def search_thresholds(problem: Problem, best: Judged) -> Judged:
    """Try values near by for effects that switch single samples, because there chi-square is rough.

    The smooth numbers go along with each.
    """
    for order, knob in enumerate(best.explanation.fitted):
        if knob.effect in problem.settings.thresholds:
            for reach in THRESHOLD_REACH:
                width = reach * problem.prior.width(knob.effect, knob.members[0])
                best = _best_along(problem, best, [{len(problem.slack) + order: width * u} for u in TRIED])
    for column, (effect, _, _, width) in enumerate(problem.slack):
        now = slack_now(problem, best.explanation)[column]
        alone = not best.explanation.effects  # "no gap" has no knob by which a threshold would be tried
        moved = abs(now) > SLACK_MOVED * width or not best.nothing_left
        if effect in problem.settings.thresholds and (moved or alone):
            best = _best_along(problem, best, [{column: SLACK_REACH * width * u - now} for u in TRIED])
            if alone:
                best = _best_along(problem, best, [{column: SLACK_NEAR * width * u} for u in TRIED])
    return best if leaves_much(problem, best) else _search_curve(problem, best)


def _search_curve(problem: Problem, best: Judged) -> Judged:
    """Try exponents of the thrust curve near by, with a dead band that lets the same commands through.

    Either alone lets others through, so that chi-square is a narrow valley along the two, which slopes do not show.
    """
    column = {(effect, (member,)): order for order, (effect, member, _, _) in enumerate(problem.slack)}
    column |= {knob.key: len(problem.slack) + order for order, knob in enumerate(best.explanation.fitted)}
    exponent, band, asymmetry = (column.get(key) for key in (EXPONENT, DEAD_BAND, ASYMMETRY))
    if exponent is None or band is None:
        return best
    for _ in range(WALKS):
        before = best
        for reach in THRESHOLD_REACH[1:]:
            best = _best_along(problem, best, _same_commands(problem, best, reach, exponent, band, asymmetry))
        if best is before:
            break
    return best


def _same_commands(
    problem: Problem, best: Judged, reach: float, exponent: int, band: int, asymmetry: int | None
) -> list[dict[int, float]]:
    """Moves of the columns of an exponent, a dead band and an asymmetry that keep the commands that get through."""
    c = prepare(best.base.vehicle)  # both effects move the means, and thrusters that differ in proportion
    now, width, full, weaker = (float(mean(x[0])) for x in (c.exponent, c.dead_band, c.full_thrust, c.asymmetry))
    moves = []
    for step in reach * problem.prior.width("thrust_curve", "exponent") * TRIED:
        power = (now + step) / now  # the same commands have their thrust, over the full one, to this power
        move = {exponent: step, band: full * (width / full) ** power - width}
        if asymmetry is not None:
            move[asymmetry] = (1 - weaker) - (1 - weaker) ** power
        moves.append(move)
    return moves


def _best_along(problem: Problem, best: Judged, amounts: list[dict[int, float]]) -> Judged:
    """The best of an explanation and of those with some numbers moved by amounts, alone or the others along."""
    if not np.isfinite(best.chi2):
        return best
    trials = [moved_along(problem, best, some, along) for along in (True, False) for some in amounts]
    chi2 = nudged_chi2(problem, trials, best.base)
    return (
        assess(problem, nudge(problem, trials[int(chi2.argmin())], best.base), before=best)[0]
        if chi2.min() < best.chi2 - 0.1
        else best
    )
