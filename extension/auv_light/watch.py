"""When a dive is diagnosed: after the vehicle is disarmed and its log has come to rest, one at a time, never in flight.

The diagnosis is the command ``auv-diagnose`` in a process of its own, the last to get the processor and the first to be
ended for memory. Where the vehicle is armed meanwhile it is ended, and begins anew after the dive.
"""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from auv_light.dives import Dive, Dives
from auv_light.light import light_of

QUIET_S = 30.0  # without a change of the log, where the autopilot says that it is disarmed
UNKNOWN_S = 180.0  # where nobody says so: a log that an armed autopilot writes changes several times a second
NICE = 19  # behind everything else
MOST_HEALTHY = 3  # the newest of those marked sound: more take time and tell little
LONGEST_S = 1800.0  # for a diagnosis
_EVERY_S = 1.0
ONE_CORE = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
Clock = Callable[[], float]


class Watch:
    """Looks for new dives and works on the newest.

    Args:
        dives: of the vehicle.
        vehicle: a name of ``conf/vehicle``, or a file.
        armed: asks the autopilot; None where it does not answer.
        parameters: a file of the vehicle's, as a ground station saves it; recordings lack them. None for none.
        clock: s since 1970.
        program: runs a module: what stands before its name and arguments.
    """

    def __init__(
        self, dives: Dives, vehicle: str, armed: Callable[[], bool | None], clock: Clock = time.time,
        program: Sequence[str] = (sys.executable, "-m", "auv_torchrl.page.child", str(NICE)),
        parameters: Path | None = None,
    ) -> None:  # fmt: skip
        self.dives, self.vehicle, self.armed, self.clock, self.program = dives, vehicle, armed, clock, program
        self.parameters = parameters
        self.doing = "waiting for a dive"

    def step(self) -> bool:
        """Do the next piece of work, if there is one and the vehicle is disarmed; whether there was one."""
        state = self.armed()
        if state is True:
            self.doing = "the vehicle is armed: nothing is worked on"
            return False
        self.dives.look(self.clock() - (QUIET_S if state is False else UNKNOWN_S))
        newest = next(iter(self.dives), None)
        if newest is not None and not newest.sound and not newest.is_diagnosed:
            self._diagnose(newest)
            return True
        unread = next((dive for dive in self.dives if not dive.worked), None)
        if unread is not None:
            self._work(unread)
            return True
        self.doing = "waiting for a dive"
        return False

    def _diagnose(self, dive: Dive) -> None:
        self.doing = f"diagnosing {dive.name}"
        healthy = self._healthy(dive)
        folder = self.dives.results(dive)
        shutil.rmtree(folder, ignore_errors=True)
        words = ["auv_torchrl.monitoring.command", str(self.dives.path(dive)), "--vehicle", self.vehicle]
        words += ["--healthy", *(str(self.dives.path(other)) for other in healthy)] if healthy else []
        given = self._parameters_of(dive)
        words += ["--params", str(given)] if given else []
        said = self._run([*words, "--output", str(folder)])
        if said is None or dive.sound or healthy != self._healthy(dive):
            return  # armed meanwhile, or marks have changed: the next step begins anew
        dive.against = [other.name for other in healthy]
        if (folder / "diagnosis.json").is_file():
            diagnosis = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
            dive.light, dive.summary = str(light_of(diagnosis)), diagnosis["summary"]
        else:
            last = said.strip().splitlines()[-1:] or ["the diagnosis ended without a word"]
            dive.summary = last[0].removeprefix("diagnose: ")
        self.dives.save()

    def _healthy(self, dive: Dive) -> list[Dive]:
        return self.dives.healthy(dive)[:MOST_HEALTHY]

    def _parameters_of(self, dive: Dive) -> Path | None:
        """What is given beside a recording; a log of the autopilot has its own."""
        there = dive.is_recording and self.parameters is not None and self.parameters.is_file()
        return self.parameters if there else None

    def _work(self, dive: Dive) -> None:
        self.doing = f"reading the outputs of {dive.name}"
        given = self._parameters_of(dive)
        said = self._run(["auv_light.odometer", str(self.dives.path(dive)), *([str(given)] if given else [])])
        if said is None:
            return
        told: dict[str, Any] = {}
        for line in said.splitlines():
            if line.startswith("{"):
                told = json.loads(line)
        dive.thrusters, dive.worked = told.get("thrusters", []), True
        self.dives.save()

    def _run(self, words: Sequence[str]) -> str | None:
        """What a module prints; None where it was ended because the vehicle was armed."""
        here = str(Path(__file__).parents[1])
        path = os.pathsep.join(filter(None, (here, os.environ.get("PYTHONPATH"))))
        environment = {**os.environ, **ONE_CORE, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1"}
        begun = time.monotonic()
        held, hold = os.pipe()  # while this process holds it, page.child knows that somebody waits for the answer
        try:
            with subprocess.Popen(
                [*self.program, *words], env=environment, text=True, start_new_session=True, stdin=held,
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            ) as process:  # fmt: skip
                while True:
                    try:
                        return process.communicate(timeout=_EVERY_S)[0]
                    except subprocess.TimeoutExpired:
                        armed, late = self.armed() is True, time.monotonic() - begun > LONGEST_S
                        if armed or late:
                            process.kill()
                            process.communicate()
                            return None if armed else "it took more than half an hour and was ended"
        finally:
            os.close(hold)
            os.close(held)

    def again(self) -> None:
        """Have the newest dive that is not marked sound diagnosed anew, as after a mark was set or taken away."""
        newest = next(iter(self.dives), None)
        if newest is not None and not newest.sound:
            newest.light, newest.summary = "", ""
        self.dives.save()
