"""The verdict in words: one sentence for a pilot, and a headline above all else on console and page."""

from auv_torchrl.diagnosis.doubt import doubts
from auv_torchrl.diagnosis.localize.wording import does_otherwise, seen_to_do
from auv_torchrl.diagnosis.unanswered.wording import in_words, not_answering
from auv_torchrl.diagnosis.verdict import Diagnosis, FoundEffect, Gap, Verdict, Where, how_sure
from auv_torchrl.effects import EFFECTS, Origin
from auv_torchrl.quantities import series, words

NEAR_FLOOR = 1.5  # times the floor, below which a prediction is as good as the sensors allow
WORTH_A_WORD = 0.01  # probability below which nobody acts on an effect
MAINLY = 0.5  # share of the gap
SUSPECT = 0.3  # share of the gap, from which a thruster, or a cause that is perhaps there, is worth a look
SOUND = "No gap: the simulator predicts this vehicle as well as its sensors allow."
NO_FAULT = "No fault: this vehicle differs from the simulator by no more than the few per cent that every vehicle does."
MAY_BE_OFF = "the vehicle's file may be off, and something unknown acts"
GOES_WITH = {
    Origin.BODY: "its acceleration",
    Origin.FLOW: "its speed through the water",
    Origin.EXTERNAL: "where it is and where it points",
}
MOST_WORDS = 15  # what is read at a glance
FILE_OFF = "the vehicle's file is off in many coefficients at once"
FILE_MAY_BE_OFF = "the vehicle's file may be off"
LOG_OR_FILE = "the log or the vehicle's file is off; one sound dive would tell which"
UNKNOWN = "something unknown acts"


def summarise(
    verdict: Verdict,
    effects: tuple[FoundEffect, ...],
    where: Where,
    gap: Gap,
    corrected: tuple[str, ...] = (),
    examined: tuple[str, ...] = (),
) -> str:
    """What was found, how sure that is and how much of the gap; where to look for what was not found.

    Where no cause is likelier than not, what is sure stands first: that something unknown acts. Corrections of the file
    that are no likelier than not are not told one by one: they may have taken up anything.

    ``corrected`` is what the coefficients that were wrong mean to a pilot, what matters most first: one is said here.
    ``examined`` are the degrees of freedom that the log measures, where the vehicle moves in others too.
    """
    if verdict is Verdict.NO_GAP and not effects:
        sentence = SOUND if within_floor(gap) else NO_FAULT
        return sentence.replace(":", f" in {', '.join(examined)}:", 1) if examined else sentence
    worth = [effect for effect in effects if effect.probability >= WORTH_A_WORD]
    named, perhaps = (
        "; ".join(effect.clause for effect in worth if not effect.calibrates and effect.is_likely is likely)
        for likely in (True, False)
    )
    corrections = [effect for effect in effects if effect.calibrates]
    if corrections and not any(effect.is_likely for effect in corrections):
        return _begun(f"{_joined(named, perhaps, MAY_BE_OFF)}{mainly(where)}")
    if corrections:
        file = "; above all, ".join((FILE_OFF, *corrected[:1]))
        named = f"{named}; besides, {file}" if named else file
    if verdict is Verdict.UNEXPLAINED and (does := does_otherwise(where)):
        else_all = ", and else all of its thrust" if where.intermittence else ""
        return _begun(f"{does}{else_all}; no known effect does that")
    if verdict is Verdict.UNEXPLAINED:
        return f"The simulator misses this vehicle{mainly(where)}, and no known effect explains it."
    closed = "" if gap.closed is None else f"{100 * gap.closed:.0f} % of the gap"
    if verdict is Verdict.PARTLY_EXPLAINED:
        if not named:
            share = f"; that would explain {closed}" if closed else ""
            return f"Something unknown acts{mainly(where)}; {perhaps}{share}."
        share = f"{'together ' if perhaps else ''}that explains {closed}, and" if closed else "besides,"
        return _begun(f"{_joined(named, perhaps)}; {share} something unknown acts too{mainly(where)}")
    everything = _joined(named, perhaps)
    return _begun(f"{everything}; with that in the simulator, {closed} is gone" if closed else everything)


def mainly(where: Where) -> str:
    """Where most of a gap shows and what it goes with, as the end of a clause; empty where nothing stands out."""
    shown = [name for name, share in where.dof.items() if share > MAINLY]
    parts = [f", mostly in {shown[0]}"] if shown else []
    goes_with = next(
        (GOES_WITH[Origin(n)] for n, share in where.origin.items() if share > MAINLY and n in GOES_WITH), ""
    )
    if thrusters := suspects(where):
        one = "thruster" if len(thrusters) == 1 else "thrusters"
        goes_with = f"the commands of {one} {' and '.join(map(str, thrusters))}"
    elif where.origin.get(Origin.ACTUATION, 0.0) > MAINLY:
        goes_with = "the commands"
    if goes_with:
        parts.append(f", in step with {goes_with}")
    if does := seen_to_do(where):
        parts.append(f": {does}")
    return "".join(parts)


def suspects(where: Where) -> list[int]:
    """Thrusters, from 1, whose commands a large share of the gap goes with."""
    return [int(name) for name, share in where.thruster.items() if share > SUSPECT]


def within_floor(gap: Gap) -> bool:
    """Whether the simulator as it was predicts as well as sensors allow."""
    kinds = [errors for errors in (gap.position_m, gap.yaw_rad, gap.velocity) if errors is not None]
    return all(e.before[-1] < NEAR_FLOOR * e.floor[-1] for e in kinds if e.before)


def _joined(*clauses: str) -> str:
    return "; ".join(filter(None, clauses))


def _begun(clause: str) -> str:
    return f"{clause[0].upper()}{clause[1:]}."


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
    lists_values = ";" in clause and len(effect.thrusters) > 1
    for shorter in () if lists_values else (clause, clause.split(";")[0]):
        shown = how_sure(shorter, effect.probability)
        if ";" not in shown and _count(shown) <= MOST_WORDS:
            return shown
    name, numbers = words(effect.name), effect.thrusters
    of_several = EFFECTS[effect.name].of_several if effect.name in EFFECTS and len(numbers) > 1 else ""
    where = f" of thruster{'s' if len(numbers) > 1 else ''} {series(numbers)}" if numbers else ""
    clause = of_several.format(which=series(numbers)) if of_several else f"{name}{where}"
    shown = how_sure(clause, effect.probability)
    return shown if _count(shown) <= MOST_WORDS else how_sure(name, effect.probability)


def _sound(diagnosis: Diagnosis) -> str:
    """That there is no gap, or none but what every vehicle has."""
    return (SOUND if within_floor(diagnosis.gap) else NO_FAULT).split(":")[0]


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
