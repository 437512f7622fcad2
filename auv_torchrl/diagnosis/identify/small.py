"""What of an explanation does no more than slack does anyway."""

from collections.abc import Sequence

import numpy as np

from auv_torchrl.diagnosis.identify.declared import declared
from auv_torchrl.diagnosis.identify.explanation import Explanation, Knob
from auv_torchrl.diagnosis.identify.judged import Judged, sizes
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.sure import likeliest
from auv_torchrl.diagnosis.thresholds import MINOR


def is_minor(problem: Problem, judged: Judged) -> bool:
    """Whether some effect of an explanation does no more than slack does anyway, and slack explains the log."""
    if not problem.slack_suffices or not judged.explanation.effects or not np.isfinite(judged.chi2):
        return False
    return any(are_small(problem, judged))


def are_small(problem: Problem, judged: Judged) -> list[bool]:
    """Of each effect of an explanation, whether it does no more than slack does anyway."""
    knobs = likeliest(problem, judged).knobs
    return _do_little(problem, judged, [[k for k in knobs if k.effect == e] for e in judged.explanation.effects])


def small_members(problem: Problem, judged: Judged) -> list[int]:
    """Places of the knobs of one thruster or axis, of an effect that has several, that do no more than slack does."""
    knobs = likeliest(problem, judged).knobs
    each = [declared(knob.effect, problem.vehicle).parameters[knob.members[0]] for knob in knobs]
    kinds = [(knob.effect, p.name) for knob, p in zip(knobs, each, strict=True)]
    several = [i for i, p in enumerate(each) if p.over is not None and not p.discrete and kinds.count(kinds[i]) > 1]
    little = _do_little(problem, judged, [[knobs[i]] for i in several])
    return [i for i, is_little in zip(several, little, strict=True) if is_little]


def _do_little(problem: Problem, judged: Judged, parts: Sequence[Sequence[Knob]]) -> list[bool]:
    """Of each part of an explanation, with its likeliest values, whether it does no more than slack does anyway."""
    alone = [Explanation(tuple(part)) for part in parts]
    return (sizes(problem, alone, judged.base) < MINOR * problem.slack_size).tolist()
