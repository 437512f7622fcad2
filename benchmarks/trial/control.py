"""``python -m benchmarks.trial.control FOLDER reversed swap``: who holds a place through the firmware under a fault.

The source policy, the adapted one, and ArduSub's own POSHOLD, on the same vehicle. FOLDER/export_<scenario> is what
``auv-export`` wrote of a run with that scenario. Prints a line of JSON for each flight: true distances from where it
began, for t >= 10 s of simulated time, and ``reported_m``, those by the vehicle's own estimate.
"""

import json
import math
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from auv_torchrl.fly.flyer import Flyer
from auv_torchrl.fly.pilot import Pilot, Settings
from auv_torchrl.fly.safety import Limits
from auv_torchrl.link.plant import Moment, Plant, Start
from auv_torchrl.paths import PROJECT
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.yaml_file import read_yaml
from benchmarks.trial.dive import Diver
from benchmarks.trial.stack import Stack

VEHICLE, FRAME = "bluerov2_heavy", 2
POSHOLD = 16
SECONDS, SETTLED_S, FURTHEST_M = 40.0, 10.0, 5.0
DOWN_M = 5.0


class Watcher:
    """Keeps how far a vehicle is from where it was."""

    def __init__(self) -> None:
        self.path: list[tuple[float, tuple[float, float, float]]] = []

    def begin(self, moment: Moment) -> None:
        """A vehicle was placed."""

    def flown(self, command: Any, moment: Moment) -> None:
        """A step was flown."""
        self.path.append((moment.time_s, tuple(moment.state[0][0].tolist())))

    def distances(self, begun_s: float) -> list[tuple[float, float]]:
        """Time since a flight began, and how far the vehicle is from where it began then, in m."""
        flown = [one for one in self.path if one[0] >= begun_s]
        return [(at - begun_s, math.dist(place, flown[0][1])) for at, place in flown]


By = Callable[[Diver], dict[str, Any]]


def hold(vehicle: str, frame: int, effects: Mapping[str, Any], folder: Path, by: By) -> dict[str, Any]:
    """Let ``by`` hold a vehicle through a firmware that knows nothing of what is wrong; how far off it is."""
    flown = load_vehicle(vehicle)
    scenario = read_scenario("fault", {"effects": effects}, flown) if effects else Scenario("nominal")
    shutil.rmtree(folder, ignore_errors=True)
    watcher = Watcher()
    plant = Plant(flown, scenario, Start(down=DOWN_M, held=True))
    stack = Stack(plant, folder, {"FRAME_CONFIG": frame}, observers=(watcher,))
    try:
        diver = Diver(stack)
        diver.begin(plant.start.let_down_s)
        diver.wait(5.0)
        begun_s = stack.now()
        said = by(diver)
    finally:
        stack.close()
    off = watcher.distances(begun_s)
    settled = [distance for at, distance in off if SETTLED_S <= at <= SECONDS]
    return {
        **said,
        "mean_m": sum(settled) / len(settled) if settled else math.nan,
        "largest_m": max(distance for at, distance in off if at <= SECONDS),
        "flown_s": off[-1][0],
    }


def by_policy(export: Path, adapted: bool) -> By:
    """A policy, as ``auv-fly`` flies it."""

    def fly(diver: Diver) -> dict[str, Any]:
        limits = Limits(0.3, 20.0, FURTHEST_M)
        pilot = Pilot(diver.stack, Flyer(export, adapted=adapted), Settings(limits, arm=True, until_s=SECONDS))
        ended = pilot.fly().name.lower()
        reported = pilot.tally.off_m[round(SETTLED_S / pilot.flyer.control_dt) :]
        return {"ended": ended, "reported_m": sum(reported) / len(reported) if reported else math.nan}

    return fly


def by_poshold(diver: Diver) -> dict[str, Any]:
    """ArduSub's own mode, with centred sticks."""
    diver.arm(POSHOLD)
    begun = diver.stack.now()
    while diver.armed and diver.stack.now() - begun < SECONDS:
        diver.wait(1.0)
    return {"ended": "time" if diver.armed else "disarmed"}


def effects_of(scenario: str, folder: Path) -> Mapping[str, Any]:
    """The effects of a scenario of ``conf/scenario``."""
    return read_yaml(folder / f"{scenario}.yaml", scenario)["effects"]


def main(exports: Path, scenarios: Sequence[str]) -> None:
    """Fly all of them."""
    for scenario in scenarios:
        effects = effects_of(scenario, PROJECT / "conf" / "scenario")
        export = exports / f"export_{scenario}"
        flown = {"u_s": by_policy(export, False), "u_t": by_policy(export, True), "POSHOLD": by_poshold}
        for name, by in flown.items():
            found = hold(VEHICLE, FRAME, effects, exports / "ardusub", by)
            sys.stdout.write(json.dumps({"scenario": scenario, "by": name, **found}) + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
