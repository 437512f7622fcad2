"""The verdict in at most :data:`MOST_WORDS` words: what stands above all else on console and page."""

from auv_torchrl.diagnosis.doubt import doubts
from auv_torchrl.diagnosis.localize.wording import does_otherwise, seen_to_do
from auv_torchrl.diagnosis.summary import MAINLY, SLACK, SOUND, suspects, within_floor
from auv_torchrl.diagnosis.unanswered.wording import in_words, not_answering
from auv_torchrl.diagnosis.verdict import Diagnosis, FoundEffect, Verdict, Where, how_sure
from auv_torchrl.effects import EFFECTS
from auv_torchrl.quantities import series, words

MOST_WORDS = 15  # what is read at a glance
FILE_OFF = "the vehicle's file is off in many coefficients at once"
FILE_MAY_BE_OFF = "the vehicle's file may be off"
LOG_OR_FILE = "the log or the vehicle's file is off; one sound dive would tell which"
UNKNOWN = "something unknown acts"


def headline_of(diagnosis: Diagnosis) -> str:
    """What was found, in one sentence that leaves out what does not fit."""
    found = diagnosis.effects
    likely, perhaps = (
        [_short(effect) for effect in found if effect.is_likely is sure and not effect.calibrates]
        for sure in (True, False)
    )
    unanswered = not_answering(diagnosis.findings)
    if unanswered:
        return _sentence(in_words(unanswered), *likely)
    if diagnosis.verdict is not Verdict.NO_GAP and doubts(diagnosis.findings):
        either = any(effect.calibrates for effect in found) and not likely
        return _sentence(LOG_OR_FILE if either else "the log itself is in doubt", *likely)
    if diagnosis.verdict is Verdict.NO_GAP:
        return _sentence(*(likely or [_sound(diagnosis)]))
    does = seen_to_do(diagnosis.where)
    if diagnosis.verdict is Verdict.UNEXPLAINED and (alone := does_otherwise(diagnosis.where)):
        return _sentence(alone, "" if diagnosis.where.thrust_map else "its cause is not known")
    if diagnosis.verdict is Verdict.UNEXPLAINED:
        return _sentence(f"no known effect explains what the simulator misses{_where(diagnosis.where)}")
    file = [effect for effect in found if effect.calibrates]
    off = [FILE_OFF if any(effect.is_likely for effect in file) else FILE_MAY_BE_OFF] if file else []
    if diagnosis.verdict is Verdict.PARTLY_EXPLAINED:
        if likely:
            return _sentence(*likely, does or f"{UNKNOWN} too", *off)
        return _sentence(*off, does or f"{UNKNOWN}{_where(diagnosis.where)}", *perhaps)
    return _sentence(*likely, *off, *perhaps)


def _short(effect: FoundEffect) -> str:
    """The sentence of an effect, or where it is long or tells of several values, what is wrong with which thrusters."""
    clause = effect.sentence.rstrip(".")
    several = ";" in clause and len(effect.thrusters) > 1
    for shorter in () if several else (clause, clause.split(";")[0]):
        shown = how_sure(shorter, effect.probability)
        if ";" not in shown and _count(shown) <= MOST_WORDS:
            return shown
    name, numbers = words(effect.name), effect.thrusters
    several = EFFECTS[effect.name].of_several if effect.name in EFFECTS and len(numbers) > 1 else ""
    where = f" of thruster{'s' if len(numbers) > 1 else ''} {series(numbers)}" if numbers else ""
    clause = several.format(which=series(numbers)) if several else f"{name}{where}"
    shown = how_sure(clause, effect.probability)
    return shown if _count(shown) <= MOST_WORDS else how_sure(name, effect.probability)


def _sound(diagnosis: Diagnosis) -> str:
    """That there is no gap, or none but what every vehicle has."""
    return (SOUND if within_floor(diagnosis.gap) else SLACK).split(":")[0]


def _where(where: Where) -> str:
    """Where most of a gap shows, or nothing."""
    thrusters = suspects(where)
    if len(thrusters) == 1:
        return f" at thruster {thrusters[0]}"
    shown = [name for name, share in where.dof.items() if share > MAINLY]
    return f", mostly in {shown[0]}" if shown else ""


def _sentence(*clauses: str) -> str:
    """The clauses that fit, the first in any case."""
    kept: list[str] = []
    for clause in filter(None, clauses):
        if not kept or _count(" ".join((*kept, clause))) <= MOST_WORDS:
            kept.append(clause)
    text = "; ".join(kept)
    return f"{text[:1].upper()}{text[1:]}."


def _count(text: str) -> int:
    return len(text.split())
