"""Simulated seconds of all vehicles per CPU second of one core: our engines, and what others would simulate with.

    python -m benchmarks.control.simulated_seconds [--sizes 1 64 256 1024] [--rounds 3]

All engines fly the same vehicles from the same starts under the same constant commands, in Runge-Kutta steps of the
same length. Before an engine is timed, its positions after a second of flight are compared with those of the plain
equations of motion on numpy. The engines take turns, so that load strikes all of them. What is not installed is named.
"""

import argparse
import statistics
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import torch

from auv_torchrl.extras import MissingLibrary
from auv_torchrl.physics import CONTROL_DT, SUBSTEPS
from benchmarks.control.engines import CHUNK, ENGINES, Engine, World

SIZES = [1, 64, 256, 1024]  # vehicles that are simulated together
ROUNDS = 3  # the median is reported, since other programs disturb
TIMED_S = 0.2  # CPU time of a round, at least: clocks of processes tick in 10 ms on some systems
TOLERANCE_M = 5e-3  # after a second of flight: Euler is half a step of 12.5 ms off, at 0.5 m/s 3 mm; others far less
OURS, OURS_MUJOCO, OURS_ENVIRONMENT = "array physics, torch", "MuJoCo fleet", "MujocoFleet"
MUST_TIMES, MUST_TIMES_AT = 2, 1024  # times the fastest of the others, with so many vehicles
MUST_MUJOCO, MUST_MUJOCO_AT = 150, 256  # thousands of control steps per CPU second, with so many vehicles


class Timed(NamedTuple):
    """One engine with one number of vehicles."""

    rates: list[float]  # simulated seconds of all vehicles per CPU second, in each round
    ready_s: float  # CPU time until the first second was flown: what is built and compiled
    apart_m: float  # greatest distance from the plain equations of motion after that second

    @property
    def rate(self) -> float:
        """The median of the rounds."""
        return statistics.median(self.rates)


Measured = dict[str, dict[int, Timed]]  # by engine and number of vehicles


def made_ready(name: str, world: World) -> tuple[Engine, Timed]:
    """An engine that has flown its first second, and how far from the plain equations of motion it came.

    Raises:
        MissingLibrary: for a package that is not installed.
        ValueError: for an engine that flies elsewhere.
    """
    begin = time.process_time()
    engine = ENGINES[name].build(world)
    engine.begin()
    engine.fly(CHUNK)
    ready = time.process_time() - begin
    apart = float(np.linalg.norm(engine.positions() - world.motion[-1].position, axis=-1).max())
    if not apart < TOLERANCE_M:
        raise ValueError(f"{name}: {apart:g} m from the equations of motion after {CHUNK * CONTROL_DT:g} s of flight")
    return engine, Timed([], ready, apart)


def rate(engine: Engine, count: int, least_steps: int) -> float:
    """Simulated seconds of ``count`` vehicles per CPU second, over flights of ``least_steps`` control steps."""
    engine.begin()
    steps, taken = 0, 0.0
    begin = time.process_time()
    while taken < TIMED_S:
        engine.fly(least_steps)
        steps, taken = steps + least_steps, time.process_time() - begin
    return count * steps * CONTROL_DT / taken


def measure(sizes: list[int], rounds: int) -> tuple[Measured, dict[str, str]]:
    """What each engine does, and of those that are not installed what says so."""
    found: Measured = {name: {} for name in ENGINES}
    missing: dict[str, str] = {}
    for count in sizes:
        world, engines = World.drawn(count), {}
        for name in ENGINES:
            try:
                engines[name], found[name][count] = made_ready(name, world)
            except MissingLibrary as error:
                missing[name] = str(error)
        for _ in range(rounds):
            for name, engine in engines.items():
                found[name][count].rates.append(rate(engine, count, ENGINES[name].least_steps))
    return found, missing


def report(found: Measured, missing: dict[str, str], sizes: list[int]) -> Iterator[str]:
    """The lines of the table, and what must be."""
    yield f"| engine | precision | what is computed | {' | '.join(map(str, sizes))} | ready after s | apart mm |"
    yield "|---" * 3 + "|---:" * (len(sizes) + 2) + "|"
    for name, entry in ENGINES.items():
        head = f"| {name} | {entry.precision} | {entry.what}"
        if name in missing:
            yield f"{head} | {' | '.join('–' for _ in sizes)} | {missing[name]} | – |"
            continue
        of_size = found[name]
        rates = " | ".join(f"{of_size[count].rate:,.0f}" for count in sizes)
        apart = max(timed.apart_m for timed in of_size.values())
        yield f"{head} | {rates} | {of_size[sizes[-1]].ready_s:.1f} | {1e3 * apart:.2g} |"
    yield from musts(found)


def musts(found: Measured) -> Iterator[str]:
    """What is demanded of our engines, beside what they do."""
    others = {name: found[name][MUST_TIMES_AT].rate for name, entry in ENGINES.items()
              if not entry.ours and MUST_TIMES_AT in found[name]}  # fmt: skip
    if others:
        best = max(others, key=lambda name: others[name])
        times = found[OURS][MUST_TIMES_AT].rate / others[best]
        yield ""
        yield (
            f"With {MUST_TIMES_AT} vehicles, {OURS}, simulates {times:.1f} times what the fastest of the others does, "
            f"{best}; at least {MUST_TIMES} times are demanded."
        )
    if MUST_MUJOCO_AT in found[OURS_MUJOCO]:
        thousands = [found[name][MUST_MUJOCO_AT].rate / CONTROL_DT / 1e3 for name in (OURS_MUJOCO, OURS_ENVIRONMENT)]
        yield ""
        yield (
            f"With {MUST_MUJOCO_AT} vehicles in MuJoCo, {thousands[0]:.0f} thousand control steps are simulated per "
            f"CPU second, of which {MUST_MUJOCO} thousand are demanded; as a whole environment {thousands[1]:.0f} "
            "thousand."
        )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, help="numbers of vehicles")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="of which the median counts")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    found, missing = measure(arguments.sizes, arguments.rounds)
    print(
        f"Simulated seconds of all vehicles per CPU second on one thread, vehicle paper, {SUBSTEPS} Runge-Kutta steps "
        f"in each control step of {CONTROL_DT:g} s, median of {arguments.rounds} rounds; columns are numbers of "
        f"vehicles. Ready after: CPU time to build, compile and fly the first {CHUNK * CONTROL_DT:g} s with the most "
        "vehicles. Apart: greatest distance from the plain equations of motion after that.\n"
    )
    print("\n".join(report(found, missing, arguments.sizes)))


if __name__ == "__main__":
    main()
