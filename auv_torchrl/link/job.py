"""What ``auv-sim`` does once its command line is read."""

import logging
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from threadpoolctl import threadpool_limits

from auv_torchrl.agents.interrupt import interruptible
from auv_torchrl.command import BadInput, Run, checking_input, claim_folder
from auv_torchrl.command.chosen import scenario_name
from auv_torchrl.command.folder import finish
from auv_torchrl.extras import command, is_installed, library
from auv_torchrl.link.keep import FLIGHT, Keeper
from auv_torchrl.link.lockstep import Lockstep, Observer
from auv_torchrl.link.plant import Plant, Start
from auv_torchrl.link.schema import SimSchema, StartSchema
from auv_torchrl.link.server import Pace, open_socket, serve
from auv_torchrl.progress import Progress
from auv_torchrl.quantities import counted, duration
from auv_torchrl.scenario import read_scenario
from auv_torchrl.settings import check
from auv_torchrl.vehicle import load_vehicle

log = logging.getLogger("sim")

OUTPUTS = 32  # that ArduSub has at most


@dataclass(frozen=True)
class Asked:
    """What to simulate, and for whom."""

    plant: Plant
    outputs: tuple[int, ...]
    until_s: float | None
    show: bool | str
    folder: Path | None


def simulate_for_firmware(config: DictConfig, address: tuple[str, int], run: Run) -> None:
    """Answer ArduSub until Ctrl-C, SIGTERM or the time that was set; then write what is to be kept."""
    with checking_input():
        asked = read_asked(config, scenario_name(run.choices, run.overrides))
    with ExitStack() as open_until_the_end:
        with checking_input():
            listener = open_until_the_end.enter_context(open_socket(address))
        if asked.folder is not None:
            claim(asked.folder, config, run.overrides)
        observers = open_observers(asked, open_until_the_end)
        tally = Tally()
        lockstep = Lockstep(asked.plant, asked.outputs, config.paced, [*observers, tally])
        where = "{}:{}".format(*listener.getsockname())
        log.info("waiting for ArduSub at %s: ardusub --model JSON:127.0.0.1 --home 0,0,0,0 ...", where)
        fly(listener, lockstep, tally, asked.until_s)
    log.info("%s", summary(lockstep, tally))
    if asked.folder is not None:
        finish(asked.folder)
        kept = "truth.csv and run.rrd" if has_viewer() else "truth.csv"
        log.info("%s, %s are in %s", FLIGHT, kept, asked.folder)


def read_asked(config: DictConfig, scenario: str) -> Asked:
    """Check the settings, and place the vehicle.

    Raises:
        ValueError: for a value that cannot be, naming it and what to give.
    """
    content: Any = OmegaConf.to_container(config, resolve=True)
    checked = {entry.name for entry in fields(SimSchema)} - {"vehicle", "scenario", "start", "outputs", "rerun"}
    check(SimSchema, {name: content[name] for name in checked})
    check(StartSchema, content["start"], "start")
    vehicle = load_vehicle(content["vehicle"])
    acting = read_scenario(scenario, content["scenario"], vehicle)
    if not isinstance(content["rerun"], bool | str):
        raise ValueError(f"rerun is {content['rerun']!r}: give true, false, or the address of a viewer")
    return Asked(
        Plant(vehicle, acting, Start(**content["start"]), content["seed"]),
        read_outputs(content["outputs"], vehicle.thrusters),
        content["until_s"],
        content["rerun"],
        None if content["output"] is None else Path(content["output"]),
    )


def read_outputs(given: Any, thrusters: int) -> tuple[int, ...]:
    """For each thruster the output that drives it; null stands for output n of thruster n.

    Raises:
        ValueError: for anything but a list of outputs, one for each thruster, none of them twice.
    """
    if given is None:
        return tuple(range(1, thrusters + 1))
    right = isinstance(given, Sequence) and not isinstance(given, str) and len(given) == thrusters
    if not right or not all(type(n) is int and 1 <= n <= OUTPUTS for n in given) or len(set(given)) < thrusters:
        raise ValueError(
            f"outputs is {given!r}: give a list of length {thrusters}, from 1 to {OUTPUTS} and none twice, the output "
            "(SERVOn_FUNCTION 33 for motor 1) of each thruster"
        )
    return tuple(given)


def claim(folder: Path, config: DictConfig, overrides: Sequence[str]) -> None:
    """Take the output folder, as every command does; a broken-off flight in it is not gone on with.

    Raises:
        BadInput: for a folder that is used.
    """
    if (folder / FLIGHT).exists():
        raise BadInput(f"{folder} holds a flight already ({FLIGHT}): give another folder with output=DIR")
    claim_folder(folder, "sim", OmegaConf.to_yaml(config, resolve=True), list(overrides))


def open_observers(asked: Asked, stack: ExitStack) -> list[Observer]:
    """Whoever follows the flights; each is closed with the stack, whatever becomes of the others."""
    observers: list[Observer] = []
    if asked.folder is not None:
        observers.append(stack.enter_context(closing(Keeper(asked.folder))))
    if asked.show or (asked.folder is not None and has_viewer()):
        with checking_input():
            library("rerun", "to show flights needs", "rerun")
            from auv_torchrl.link.view import Viewer  # here, not above: rerun need not be installed

            viewer = Viewer(asked.plant.vehicle, asked.show, asked.folder)
        observers.append(stack.enter_context(closing(viewer)))
    elif asked.folder is not None:
        log.info("run.rrd is left out, rerun is not installed: %s", command("rerun"))
    return observers


def has_viewer() -> bool:
    """Whether rerun is installed, which then makes the recording."""
    return is_installed("rerun")


class Tally:
    """Simulated time of all flights, and of the one that goes on."""

    def __init__(self):
        self.flown_s = self.now_s = 0.0

    def begin(self, moment: Any) -> None:
        """A vehicle was placed."""
        self.now_s = moment.time_s

    def flown(self, command: Sequence[float], moment: Any) -> None:
        """A step was flown."""
        self.flown_s += moment.time_s - self.now_s
        self.now_s = moment.time_s


class _Line(Progress):
    """Says how far simulated time is, for nobody knows when it ends."""

    def line(self) -> str:
        return self.note


@threadpool_limits.wrap(limits=1)  # the arrays are small: a second thread only waits
def fly(listener: Any, lockstep: Lockstep, tally: Tally, until_s: float | None) -> None:
    """Answer packets until the end, and show simulated time, its pace and the last frame."""
    pace = Pace()
    with interruptible("ending, and saving what was flown") as stop, _Line() as progress:

        def ended() -> bool:
            return stop() is not None or (until_s is not None and tally.flown_s >= until_s)

        def after_packet() -> None:
            if pace.look(tally.flown_s):
                progress("flying", 0.0, position_line(tally, pace, lockstep))

        progress("waiting", 0.0, "waiting for ArduSub")
        serve(listener, lockstep, ended, after_packet)


def position_line(tally: Tally, pace: Pace, lockstep: Lockstep) -> str:
    """``12.3 s simulated, 8.1 x real time, frame 4920``."""
    if lockstep.frame < 0:
        return "waiting for ArduSub"
    return f"{tally.now_s:.1f} s simulated, {pace.times_real:.1f} x real time, frame {lockstep.frame}"


def summary(lockstep: Lockstep, tally: Tally) -> str:
    """What came, in one sentence."""
    counts: Mapping[str, int] = lockstep.counts
    if not counts["frame"]:
        return "no servo packet came: nothing was flown"
    words = {
        "repeated": "asked again", "restart": "restart of the firmware", "late": "late packet",
        "garbage": "packet that was none", "stranger": "packet of another sender",
    }  # fmt: skip
    odd = [f"{counts[name]} {word}" for name, word in words.items() if counts[name]]
    return f"flew {duration(tally.flown_s)} in {counted(counts['frame'], 'frame')}" + "".join(f", {o}" for o in odd)
