"""The verdict in one sentence for a pilot."""

from auv_torchrl.diagnosis.localize.wording import does_otherwise, seen_to_do
from auv_torchrl.diagnosis.verdict import FoundEffect, Gap, Verdict, Where
from auv_torchrl.effects import Origin

NEAR_FLOOR = 1.5  # times the floor, below which a prediction is as good as the sensors allow
WORTH_A_WORD = 0.01  # probability below which nobody acts on an effect
MAINLY = 0.5  # share of the gap
SUSPECT = 0.3  # share of the gap, from which a thruster, or a cause that is perhaps there, is worth a look
SOUND = "No gap: the simulator predicts this vehicle as well as its sensors allow."
SLACK = "No fault: this vehicle differs from the simulator by no more than the few per cent that every vehicle does."
MAY_BE_OFF = "the vehicle's file may be off, and something unknown acts"
GOES_WITH = {
    Origin.BODY: "its acceleration",
    Origin.FLOW: "its speed through the water",
    Origin.EXTERNAL: "where it is and where it points",
}


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
        sentence = SOUND if within_floor(gap) else SLACK
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
        file = "; above all, ".join(("the vehicle's file is off in many coefficients at once", *corrected[:1]))
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
