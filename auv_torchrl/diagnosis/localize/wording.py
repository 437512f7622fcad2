"""What one thruster was seen to do, in words for its owner: whether it comes and goes, or where its map departs."""

import math
from collections.abc import Sequence

from auv_torchrl.diagnosis.verdict import Slice, ThrustMap, Where
from auv_torchrl.quantities import percent

NEAR = 0.2  # of the thrust, by half of which slices are off on average where they are told as all of it, or nothing
KNOWN = 0.4  # half of the interval of a share, above which a slice tells nothing
ALONE = 0.99  # of what goes with the commands, from which one thruster is all that stands out
PUSHES = 0.01  # of the full thrust: what is less at rest moves no vehicle
ROUGHLY = 0.1  # of the full command, or of the thrust, by which both ways are told as one
ROUND = 0.05  # of the full command, to which people set one


def seen_to_do(where: Where) -> str:
    """The clause about the one thruster that pushes otherwise than commanded; empty where nothing more is known."""
    if one := where.intermittence:
        return f"thruster {one.thruster} gives nothing for {percent(one.share)} of the time"
    return map_in_words(where.thrust_map) if where.thrust_map else ""


def does_otherwise(where: Where) -> str:
    """The same of a log that no effect explains: where one thruster stands out, at least that it does."""
    alone = next((number for number, share in where.thruster.items() if share > ALONE), "")
    return seen_to_do(where) or (f"thruster {alone} pushes otherwise than commanded" if alone else "")


def map_in_words(measured: ThrustMap) -> str:
    """Where a measured map departs from what the thruster should give."""
    known = [one for one in measured.slices if (one.most - one.least) / 2 < KNOWN]
    rests = measured.at_rest_least <= 0 <= measured.at_rest_most or abs(measured.at_rest) < PUSHES
    name, way = f"thruster {measured.thruster}", "forwards" if measured.at_rest > 0 else "backwards"
    dead = _off(known, 0.0) < NEAR / 2
    if dead and not rests:
        return f"{name} pushes {way} with {percent(abs(measured.at_rest))} of its thrust, whatever is commanded"
    if not rests:
        return f"{name} pushes {way} with {percent(abs(measured.at_rest))} of its full thrust at rest"
    if dead:
        return f"{name} gives nothing"
    ahead, back = (_departs([one for one in known if sign * (one.low + one.high) > 0]) for sign in (1, -1))
    if ahead and back and ahead[0] == back[0] and abs(ahead[1] - back[1]) < ROUGHLY:
        both = (ahead[0], (ahead[1] + back[1]) / 2)
        return f"{name} gives {_in_words(*both)}"
    each = [f"{_in_words(*half)} {way}" for half, way in ((ahead, "forwards"), (back, "backwards")) if half]
    return f"{name} gives {' and '.join(each)}" if each else f"{name} pushes otherwise than commanded"


def _off(slices: Sequence[Slice], share: float) -> float:
    """How far slices are off a share on average, beyond what their intervals leave open; 0 of none."""
    beyond = [max(0.0, abs(one.share - share) - (one.most - one.least) / 2) for one in slices]
    return sum(beyond) / max(len(beyond), 1)


def _departs(slices: Sequence[Slice]) -> tuple[str, float] | None:
    """What a thruster gives one way where that is not all of its thrust, and a number that goes with it; or None."""
    ordered = sorted(slices, key=lambda one: abs(one.low + one.high))
    if _off(ordered, 1.0) < NEAR / 2:
        return None
    if _off(ordered, 0.0) < NEAR / 2:
        return "nothing", 0.0
    steps = [(*_step(ordered, k, large), k) for k in range(1, len(ordered) - 1) for large in (0.0, 1.0)]
    off, large, k = min(steps, default=(NEAR, 0.0, 0))
    if not off < NEAR / 2:
        return "about", sum(one.share for one in ordered) / len(ordered)
    near, far = sorted((abs(ordered[k].low), abs(ordered[k].high)))
    share = min(max(ordered[k].share, 0.0), 1.0)
    edge = near + (far - near) * (share if large == 0.0 else 1 - share)
    return ("nothing above" if large == 0.0 else "nothing below"), edge


def _step(ordered: Sequence[Slice], k: int, large: float) -> tuple[float, float]:
    """How far slices are off a step within slice ``k``, to a share of ``large`` at large commands; and that share."""
    small, beyond = ordered[:k], ordered[k + 1 :]
    return (_off(small, 1 - large) * len(small) + _off(beyond, large) * len(beyond)) / (len(ordered) - 1), large


def _in_words(what: str, much: float) -> str:
    """The clause for what a thruster gives."""
    if what == "nothing":
        return what
    if what == "about":
        return f"about {percent(much)} of its thrust"
    return f"{what} {percent(ROUND * math.floor(much / ROUND + 0.5))} of its command"
