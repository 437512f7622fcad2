"""What to fly next: of some safe manoeuvres the one that tells most of what is in doubt now.

What is in doubt is said as the diagnosis says it: two explanations that are both alive, or a thruster that gives what
it likes while any other one may do so too. A manoeuvre is worth the difference that it makes between them, in noise.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from auv_torchrl.diagnosis.conclude.summary import suspects
from auv_torchrl.diagnosis.identify.equivalence import alternatives
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.hypotheses import batch
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.search import Found
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import FAULT_KNOWN
from auv_torchrl.diagnosis.verdict import NextExperiment, Verdict, Where
from auv_torchrl.flightlog.log import ANGLES
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.physics.kinematics import least_turn
from auv_torchrl.quantities import percent
from auv_torchrl.sensors import MOTION
from auv_torchrl.simulator import simulate
from auv_torchrl.vehicle import CONTROLLED, CONTROLLED_INDEX, Vehicle

SECONDS = 12.0
SIZE = 0.4  # of the full command: a tank leaves no room for more
SIZES = (0.2, 0.3, 0.4, 0.5)  # of the full command, of one thruster: what it does may begin at a size
YAW_REACH = 0.4  # of SIZE: a vehicle turns fast
STEADY, TURNING = 0.3, 0.06  # of the full command, while turning slowly
OPEN = 6.0  # log evidence by which another explanation may be worse and still is worth an experiment
MOST_RIVALS = 4  # pairs that manoeuvres are flown for in simulation
SEPARATES = 3.0  # noise standard deviations, root mean square, below which flying it is no use
SAME_COMMAND = 0.05  # of the full command, within which a thruster with a map gives the same
SHOWS = 1.0  # nats about a moment of a thruster: what it gives is then known within 0.37 of its thrust
MOMENT_S = 1.5  # s over which a thruster gives one share of its thrust: as long as a pulse


STICKS = {
    "surge": "forward and back",
    "sway": "right and left",
    "heave": "down and up",
    "yaw": "to turn right and left",
}


class Manoeuvre(NamedTuple):
    """What is commanded, and how a pilot does the same."""

    commands: Floats  # (T, n)
    by_hand: str  # with the sticks, or with the motor test


def manoeuvres(vehicle: Vehicle) -> dict[str, Manoeuvre]:
    """By description: pulses of each thruster, steps and sweeps of each channel, turns under way, and a drift."""
    t = np.arange(round(SECONDS / CONTROL_DT)) * CONTROL_DT
    alone = {name: one for i in range(vehicle.thrusters) for name, one in _of_thruster(i, t, vehicle.thrusters)}
    drift = Manoeuvre(np.zeros((len(t), vehicle.thrusters)), f"let go of all sticks for {SECONDS:.0f} s")
    found = {**alone, **dict(_of_channels(t, vehicle)), "drift without any command": drift}
    return {name: one._replace(commands=np.clip(one.commands, -1.0, 1.0)) for name, one in found.items()}


def _of_thruster(own: int, t: Floats, thrusters: int) -> Iterator[tuple[str, Manoeuvre]]:
    """Pulses of one thruster, from 0, at times (T,): at one size, and rising."""
    pulse = np.where(t % 6 < 1.5, 1.0, np.where((t % 6 > 3) & (t % 6 < 4.5), -1.0, 0.0)) * SIZE
    turn = np.minimum(t // MOMENT_S, 2 * len(SIZES) - 1).astype(int)
    rising = np.array([way * size for size in SIZES for way in (1.0, -1.0)])[turn]
    run, column = f"in the motor test of the ground station run thruster {own + 1}", np.eye(thrusters)[own]
    yield (
        f"pulse thruster {own + 1} alone",
        Manoeuvre(
            pulse[:, None] * column,
            f"{run} at {percent(SIZE)} for 1.5 s, rest 1.5 s, run it the other way for 1.5 s, rest 1.5 s; twice",
        ),
    )
    sizes = ", ".join(percent(size) for size in SIZES)
    yield (
        f"a series of rising pulses of thruster {own + 1} alone",
        Manoeuvre(
            rising[:, None] * column,
            f"{run} for {MOMENT_S:g} s forwards and {MOMENT_S:g} s backwards, at {sizes} in turn",
        ),
    )


def _of_channels(t: Floats, vehicle: Vehicle) -> Iterator[tuple[str, Manoeuvre]]:
    """Steps and sweeps of each channel at times (T,), and turns under way."""
    mixer = vehicle.mixer[:, list(CONTROLLED_INDEX)]
    chirp = SIZE * np.sin(2 * np.pi * (0.1 + 0.06 * t) * t)
    stairs = SIZE * np.sign(np.sin(2 * np.pi * t / 6)) * np.where(t < 6, 0.5, 1.0)
    for column, name in enumerate(CONTROLLED):
        share = YAW_REACH if name == "yaw" else 1.0
        reach, push = SIZE * share, share * mixer[:, column]
        sizes = f"3 s each way at {percent(reach / 2)}, then 3 s each way at {percent(reach)}"
        steps = f"push the stick {STICKS[name]}, {sizes}; let go of the others"
        yield f"steps of {name} at two sizes", Manoeuvre(stairs[:, None] * push, steps)
        swings = f"at {percent(reach)} for {SECONDS:.0f} s, from one swing in 10 s to more than one a second"
        sweep = f"swing the stick {STICKS[name]} {swings}; let go of the others"
        yield f"a sweep of {name} from slow to fast", Manoeuvre(chirp[:, None] * push, sweep)
    for column, name in enumerate(CONTROLLED[:2]):
        held = STEADY * mixer[:, column] + TURNING * mixer[:, 3] + 0 * t[:, None]
        by_hand = f"hold {name} at {percent(STEADY)} and yaw at {percent(TURNING)} for {SECONDS:.0f} s"
        yield f"steady {name} while turning slowly", Manoeuvre(held, by_hand)


def choose_experiment(problem: Problem, found: Found, verdict: Verdict, where: Where) -> NextExperiment | None:
    """What to fly next; None where nothing is open or nothing helps.

    Where something unknown acts, the manoeuvre that shows most of it; else the one under which the closest rivals of
    the best explanation differ most from it.
    """
    unknown = verdict in (Verdict.PARTLY_EXPLAINED, Verdict.UNEXPLAINED)
    suspected = suspects(where) if unknown else []
    if suspected and (planned := watch(problem, found, suspected[0])):
        return planned
    for name, other, explanation in rivals(problem, found)[:MOST_RIVALS]:
        separates = separate(problem, (name, found.best.explanation), (other, explanation))
        if separates is not None:
            return separates
    return explore(problem.vehicle, where) if unknown else None


def rivals(problem: Problem, found: Found) -> list[tuple[str, str, Explanation]]:
    """What could be instead of the best explanation: what fits nearly as well, and what has the same response.

    What fits better than the best was dropped for another reason, as held-out flight, and is no rival.
    """
    best = found.best
    close = [
        (_called(best.explanation), _called(fit.explanation), fit.explanation)
        for fit in found.fits
        if fit.explanation.effects != best.explanation.effects and abs(fit.evidence - best.evidence) < OPEN
    ]
    return [*close, *alternatives(problem, found)]


def separate(problem: Problem, one: tuple[str, Explanation], other: tuple[str, Explanation]) -> NextExperiment | None:
    """The manoeuvre under which two named explanations differ most; None where that is too little."""
    vehicle = problem.vehicle
    pair = batch(vehicle, [explanation.values(vehicle) for _, explanation in (one, other)])
    plans = manoeuvres(vehicle)
    flown = _fly(
        problem,
        pair[np.tile(np.arange(2), len(plans))],
        np.repeat(np.stack([plan.commands for plan in plans.values()]), 2, axis=0),
    )
    apart = _apart(problem, flown[0::2], flown[1::2])
    best, distance = _farthest(dict(zip(plans, np.sqrt((apart**2).mean((1, 2))).tolist(), strict=True)))
    if not distance > SEPARATES:
        return None
    names = " and ".join(f"“{name.replace('_', ' ')}”" for name, _ in (one, other))
    return _planned(best, f"{names} apart, by {distance:.0f} times the noise", plans[best])


def watch(problem: Problem, found: Found, thruster: int) -> NextExperiment | None:
    """The manoeuvre that best tells what a thruster gives from moment to moment, whatever all others give.

    As where it was located: each thruster may lose its thrust in each moment by itself. What its own moments change is
    held against noise and what the moments of all others change. None where that is too little.
    """
    vehicle = problem.vehicle
    now = batch(vehicle, [found.best.explanation.values(vehicle)])
    plans = manoeuvres(vehicle)
    best, nats = _farthest({name: _shows(problem, now, plan.commands, thruster - 1) for name, plan in plans.items()})
    if not nats > SHOWS:
        return None
    return _planned(best, f"what thruster {thruster} gives at each command, whatever the others do", plans[best])


def _shows(problem: Problem, vehicle: Vehicle, commands: Floats, own: int) -> float:
    """Nats that commands (T, n) tell of what a thruster gives in a moment, on average.

    Before, that is 1 ± 1 of its thrust, half of the variance for each command and half for each moment.
    """
    moment = (np.arange(len(commands)) * CONTROL_DT // MOMENT_S).astype(int)
    lost = [(i, k) for k in range(moment[-1] + 1) for i in np.flatnonzero(np.abs(commands[moment == k]).max(0) > 0)]
    mine = np.array([i == own for i, _ in lost], bool)
    if not mine.any():
        return 0.0
    plans = np.repeat(commands[None], 1 + len(lost), axis=0)
    for row, (i, k) in enumerate(lost, start=1):
        plans[row, moment == k, i] = 0.0
    flown = _fly(problem, vehicle[np.zeros(len(plans), int)], plans)
    changes = _apart(problem, flown[1:], flown[:1]).reshape(len(lost), -1)
    information = changes[mine] @ changes[mine].T
    others = changes[~mine]
    if len(others):
        across = others @ changes[mine].T
        information -= across.T @ np.linalg.solve(others @ others.T + np.eye(len(others)), across)
    size = np.array([np.abs(commands[moment == k, i]).max() * np.sign(commands[moment == k, i].sum()) for i, k in lost])
    same = np.abs(size[mine, None] - size[mine]) < SAME_COMMAND
    before = 0.5 * (same + np.eye(len(information)))  # half by the map of the thruster, half by the moment
    return float(0.5 * np.linalg.slogdet(np.eye(len(information)) + before @ information)[1] / (moment[-1] + 1))


def explore(vehicle: Vehicle, where: Where) -> NextExperiment | None:
    """A manoeuvre that shows alone what no effect explains: the suspected thruster, or where the gap is largest."""
    plans = manoeuvres(vehicle)
    suspected = [f"pulse thruster {i} alone" for i in suspects(where)]
    largest = [f"steps of {name} at two sizes" for name, _ in sorted(where.dof.items(), key=lambda item: -item[1])]
    plan = next((name for name in (*suspected, *largest) if name in plans), None)
    if plan is None:
        return None
    return _planned(plan, "what goes with it, where the gap is largest and no known effect explains it", plans[plan])


def _called(explanation: Explanation) -> str:
    return " + ".join(explanation.effects) or "no effect"


def _planned(name: str, tells: str, plan: Manoeuvre) -> NextExperiment:
    t = CONTROL_DT * np.arange(len(plan.commands), dtype=np.float64)
    why = f"{name} tells {tells}"
    return NextExperiment(why, by_hand=plan.by_hand, tells=tells, t=t, thruster_commands=plan.commands)


def _farthest(distances: dict[str, float]) -> tuple[str, float]:
    return max(distances.items(), key=lambda one: one[1])


def _fly(problem: Problem, vehicles: Vehicle, plans: Floats) -> Floats:
    """Reports (P, T, C) of what is measured, of vehicles from rest, each under its commands (P, T, n)."""
    reported = simulate(vehicles, plans, CONTROL_DT * np.arange(plans.shape[1] + 1)).reported
    motion = np.concatenate([reported.pose, reported.velocity], axis=-1)[:, 1:]
    return motion[..., [name in problem.sigma for name in MOTION]]


def _apart(problem: Problem, one: Floats, other: Floats) -> Floats:
    """How far reports (P, T, C) differ from ``other`` ones, in standard deviations of the noise.

    The simulator is wrong, too, by a share of how far the other vehicle goes: what drives far tells less.
    """
    known = [name for name in MOTION if name in problem.sigma]
    angles, sigma = [name in ANGLES for name in known], np.array([problem.sigma[name] for name in known])

    def less(one: Floats, other: Floats) -> Floats:
        apart = one - other
        apart[..., angles] = least_turn(apart[..., angles])
        return apart

    return less(one, other) / np.hypot(sigma, FAULT_KNOWN * less(other, other[:, :1]))
