"""What ``auv-fly`` does once its command line is read."""

import logging
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from dataclasses import fields
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from auv_torchrl.agents.interrupt import interruptible
from auv_torchrl.command import Run, checking_input, claim_folder
from auv_torchrl.command.folder import finish
from auv_torchrl.fly.channels import Interface
from auv_torchrl.fly.connection import Connection, parse_place
from auv_torchrl.fly.flyer import Flyer
from auv_torchrl.fly.keep import FLIGHT, REPORT, Keeper
from auv_torchrl.fly.motion import Source
from auv_torchrl.fly.pilot import Pilot, Settings
from auv_torchrl.fly.safety import End, Limits, Phase
from auv_torchrl.fly.schema import FlySchema, LimitsSchema
from auv_torchrl.fly.watch import Watcher
from auv_torchrl.quantities import duration
from auv_torchrl.settings import check

log = logging.getLogger("fly")

SETTLED_S = 10.0  # s after which the distance from the reference counts, as in the tables of training


def fly(config: DictConfig, run: Run) -> None:
    """Fly until Ctrl-C, SIGTERM, the time that was set or a limit; then leave the vehicle as it was."""
    content: Any = OmegaConf.to_container(config, resolve=True)
    with checking_input():
        settings = read_settings(content)
        place = parse_place(content["connection"], content["elsewhere"])
        flyer = Flyer(Path(content["policy"]).expanduser(), content["task"], content["adapted"])
    with ExitStack() as stack:
        with checking_input():
            link = stack.enter_context(closing(Connection(place)))
        folder = None if content["output"] is None else Path(content["output"])
        keeper = None
        if folder is not None:
            claim_folder(folder, "fly", OmegaConf.to_yaml(config, resolve=True), list(run.overrides))
            keeper = Keeper(folder)
        log.info("%s, %s", flyer.says, "dry run" if settings.dry_run else content["connection"])
        stop = stack.enter_context(interruptible("ending: neutral, and the vehicle as it was found"))
        pilot = Pilot(link, flyer, settings, stop, keeper=keeper)
        try:
            with checking_input():
                end = fly_watched(pilot, link, stop)
            log.info("%s", summary(pilot, end))
        finally:
            if keeper is not None:
                keeper.close(report(pilot, content))
        if folder is not None:
            finish(folder)
            log.info("%s and %s are in %s", FLIGHT, REPORT, folder)


def fly_watched(pilot: Pilot, link: Connection, stop: Callable[[], Any]) -> End:
    """The flight, with a second process that watches it unless nothing is sent."""
    if pilot.settings.dry_run:
        return pilot.fly()
    pilot.hear_first()  # whoever watches has to know to whom neutral goes
    pilot.helm.guard = watcher = Watcher(link.socket, link.peer)
    try:
        return pilot.fly()
    finally:
        watcher.close(done=pilot.has_left)


def read_settings(content: Mapping[str, Any]) -> Settings:
    """Check the settings.

    Raises:
        ValueError: for a value that cannot be, naming it and what to give.
    """
    checked = {entry.name for entry in fields(FlySchema)} - {"limits", "task"}
    check(FlySchema, {name: content[name] for name in checked})
    check(LimitsSchema, content["limits"], "limits")
    limits = Limits(**content["limits"])
    if not limits.shallowest_m < limits.deepest_m:
        raise ValueError(
            f"limits.shallowest_m is {limits.shallowest_m:g} and limits.deepest_m {limits.deepest_m:g} m: depths grow "
            "downwards, give the smaller one first"
        )
    return Settings(
        limits,
        Interface(content["interface"]),
        Source(content["source"]),
        content["system"],
        content["arm"],
        content["dry_run"],
        content["until_s"],
        content["firmware"],
    )


def report(pilot: Pilot, content: Mapping[str, Any]) -> dict[str, Any]:
    """What became of the flight, for programs."""
    talk, tally, ended = pilot.talk, pilot.tally, pilot.safety.ended
    settled = tally.off_m[round(SETTLED_S / pilot.flyer.control_dt) :]
    return {
        "ended": None if ended is None else {"why": ended.name.lower(), "sentence": ended.value},
        "flown_s": tally.flown_s,
        "steps": {phase.name.lower(): tally.phases[phase] for phase in Phase},
        "wild_measurements": tally.wild,
        "mean_distance_after_10_s_m": sum(settled) / len(settled) if settled else None,
        "sent_packets": talk.sent,
        "policy": pilot.flyer.policy.contract["policy"],
        "task": pilot.flyer.policy.task.name,
        "vehicle": {
            "system": talk.vehicle,
            "version": talk.version,
            "frame": talk.parameters.get("FRAME_CONFIG"),
            "mode_found": pilot.helm.found_mode,
            "armed_by_this_flight": pilot.helm.has_armed,
        },
        "settings": dict(content),
    }


def summary(pilot: Pilot, end: End) -> str:
    """What became of the flight, in one sentence."""
    tally = pilot.tally
    idle = tally.phases[Phase.STALE] + tally.phases[Phase.WILD]
    neutral = f", {duration(idle * pilot.flyer.control_dt)} of it neutral for want of measurements" if idle else ""
    flown = f"flew {duration(tally.flown_s)}{neutral}" if pilot.safety.begun is not None else "did not begin to fly"
    return f"{flown}; {end.value}"
