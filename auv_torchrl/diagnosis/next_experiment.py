"""What to fly next: of some safe manoeuvres the one that best separates what the log leaves open."""

import numpy as np

from auv_torchrl.diagnosis.identify.equivalence import alternatives
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.hypotheses import batch
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.search import Found
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.summary import suspects
from auv_torchrl.diagnosis.verdict import NextExperiment, Verdict, Where
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.physics.kinematics import least_turn
from auv_torchrl.quantities import percent
from auv_torchrl.simulator import simulate
from auv_torchrl.vehicle import CONTROLLED, CONTROLLED_INDEX, Vehicle

SECONDS = 12.0
SIZE = 0.4  # of the full command: a tank leaves no room for more
YAW_REACH = 0.4  # of SIZE: a vehicle turns fast
STEADY, TURNING = 0.3, 0.06  # of the full command, while turning slowly
OPEN = 6.0  # log evidence by which another explanation may be worse and still is worth an experiment
MOST_RIVALS = 4  # pairs that manoeuvres are flown for in simulation
SEPARATES = 3.0  # noise standard deviations, root mean square, below which flying it is no use


STICKS = {
    "surge": "forward and back",
    "sway": "right and left",
    "heave": "down and up",
    "yaw": "to turn right and left",
}


def by_hand(name: str) -> str:
    """A manoeuvre of :func:`manoeuvres` as its pilot does it: with the sticks, or with the motor test."""
    if name.startswith("pulse thruster "):
        return (
            f"in the motor test of the ground station run thruster {name.split()[2]} at {percent(SIZE)} for 1.5 s, "
            "rest 1.5 s, run it the other way for 1.5 s, rest 1.5 s; twice"
        )
    if name.startswith("drift"):
        return f"let go of all sticks for {SECONDS:.0f} s"
    channel = next(word for word in name.split() if word in STICKS)
    reach = SIZE * (YAW_REACH if channel == "yaw" else 1.0)
    if name.startswith("steps"):
        sizes = f"3 s each way at {percent(reach / 2)}, then 3 s each way at {percent(reach)}"
        return f"push the stick {STICKS[channel]}, {sizes}; let go of the others"
    if name.startswith("a sweep"):
        swings = f"at {percent(reach)} for {SECONDS:.0f} s, from one swing in 10 s to more than one a second"
        return f"swing the stick {STICKS[channel]} {swings}; let go of the others"
    return f"hold {channel} at {percent(STEADY)} and yaw at {percent(TURNING)} for {SECONDS:.0f} s"


def manoeuvres(vehicle: Vehicle) -> dict[str, Floats]:
    """Commands (T, n) by description: a pulse per thruster, steps and sweeps per channel, and turns under way."""
    steps = round(SECONDS / CONTROL_DT)
    t = np.arange(steps) * CONTROL_DT
    pulse = np.where(t % 6 < 1.5, 1.0, np.where((t % 6 > 3) & (t % 6 < 4.5), -1.0, 0.0)) * SIZE
    found = {}
    for i in range(vehicle.thrusters):
        found[f"pulse thruster {i + 1} alone"] = pulse[:, None] * np.eye(vehicle.thrusters)[i]
    mixer = vehicle.mixer[:, list(CONTROLLED_INDEX)]
    chirp = SIZE * np.sin(2 * np.pi * (0.1 + 0.06 * t) * t)
    stairs = SIZE * np.sign(np.sin(2 * np.pi * t / 6)) * np.where(t < 6, 0.5, 1.0)
    for column, name in enumerate(CONTROLLED):
        reach = YAW_REACH if name == "yaw" else 1.0
        found[f"steps of {name} at two sizes"] = stairs[:, None] * reach * mixer[:, column]
        found[f"a sweep of {name} from slow to fast"] = chirp[:, None] * reach * mixer[:, column]
    for column, name in enumerate(CONTROLLED[:2]):
        found[f"steady {name} while turning slowly"] = (
            STEADY * mixer[:, column] + TURNING * mixer[:, 3] + 0 * t[:, None]
        )
    found["drift without any command"] = np.zeros((steps, vehicle.thrusters))
    return {name: np.clip(commands, -1.0, 1.0) for name, commands in found.items()}


def choose_experiment(problem: Problem, found: Found, verdict: Verdict, where: Where) -> NextExperiment | None:
    """What to fly next; None where nothing is open or nothing helps.

    The manoeuvre under which the two closest rivals differ most, or one that shows alone what no effect explains.
    """
    for name, other, explanation in rivals(problem, found)[:MOST_RIVALS]:
        separates = separate(problem, (name, found.best.explanation), (other, explanation))
        if separates is not None:
            return separates
    return explore(problem.vehicle, where) if verdict in (Verdict.PARTLY_EXPLAINED, Verdict.UNEXPLAINED) else None


def rivals(problem: Problem, found: Found) -> list[tuple[str, str, Explanation]]:
    """What could be instead of the best explanation: what fits nearly as well, and what has the same response."""
    best = found.best
    close = [
        (_called(best.explanation), _called(fit.explanation), fit.explanation)
        for fit in found.fits
        if fit.explanation.effects != best.explanation.effects and fit.evidence > best.evidence - OPEN
    ]
    return [*close, *alternatives(problem, found)]


def separate(problem: Problem, one: tuple[str, Explanation], other: tuple[str, Explanation]) -> NextExperiment | None:
    """The manoeuvre under which two named explanations differ most; None where that is too little."""
    vehicle, sigma = problem.vehicle, problem.sigma
    pair = batch(vehicle, [explanation.values(vehicle) for _, explanation in (one, other)])
    noise = np.array([sigma.get(axis, np.inf) for axis in ("x", "y", "z", "roll", "pitch", "yaw")])
    plans = manoeuvres(vehicle)
    poses = _fly(pair, np.stack(list(plans.values())))
    apart = poses[:, :, 0] - poses[:, :, 1]
    apart[..., 3:] = least_turn(apart[..., 3:])
    distance = dict(zip(plans, np.sqrt(((apart / noise) ** 2).mean((0, 2))).tolist(), strict=True))
    best = max(distance, key=lambda name: distance[name])
    if not distance[best] > SEPARATES:
        return None
    names = " and ".join(f"“{name.replace('_', ' ')}”" for name, _ in (one, other))
    why = f"{best} tells {names} apart, by {distance[best]:.0f} times the noise"
    return _planned(why, best, plans[best])


def explore(vehicle: Vehicle, where: Where) -> NextExperiment | None:
    """A manoeuvre that shows alone what no effect explains: the suspected thruster, or where the gap is largest."""
    plans = manoeuvres(vehicle)
    suspected = [f"pulse thruster {i} alone" for i in suspects(where)]
    largest = [f"steps of {name} at two sizes" for name, _ in sorted(where.dof.items(), key=lambda item: -item[1])]
    plan = next((name for name in (*suspected, *largest) if name in plans), None)
    if plan is None:
        return None
    why = f"{plan}: the gap is largest there and no known effect explains it; alone, it shows what the gap follows"
    return _planned(why, plan, plans[plan])


def _called(explanation: Explanation) -> str:
    return " + ".join(explanation.effects) or "no effect"


def _planned(why: str, name: str, commands: Floats) -> NextExperiment:
    t = CONTROL_DT * np.arange(len(commands), dtype=np.float64)
    return NextExperiment(why, by_hand=by_hand(name), t=t, thruster_commands=commands)


def _fly(vehicles: Vehicle, plans: Floats) -> Floats:
    """Measured poses (T, P, 2, 6) of two vehicles from rest, under each of the commands (P, T, n)."""
    number, steps = plans.shape[:2]
    rows = vehicles[np.tile(np.arange(2), number)]
    reported = simulate(rows, np.repeat(plans, 2, axis=0), CONTROL_DT * np.arange(steps + 1)).reported
    return reported.pose[:, 1:].swapaxes(0, 1).reshape(steps, number, 2, 6)
