"""What ``diagnose.py alike=true`` does once its command line is read."""

import logging
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig
from threadpoolctl import threadpool_limits

from auv_torchrl.command import checking_input
from auv_torchrl.diagnosis.alike.answer import Answer
from auv_torchrl.diagnosis.alike.judge import Alike, judge_runs, learn_sound
from auv_torchrl.diagnosis.plain import plain, write_json
from auv_torchrl.diagnosis.request import read_request
from auv_torchrl.flightlog import FlightLogError
from auv_torchrl.progress import Progress
from auv_torchrl.quantities import counted, words

log = logging.getLogger("diagnose")
VERSION = 1
SHOWN = 30  # lines of single runs on the console; all are in the file


def answer_alike(config: DictConfig) -> None:
    """Read the runs, hold them against the sound ones, say what differs, write the file."""
    with checking_input():
        if config.test:
            raise ValueError("test=... goes with one log: leave it out")
        request = read_request(config)
    with checking_input((FlightLogError,)), Progress() as progress, threadpool_limits(1):
        progress("what sound runs look like", 0.1)
        sound = learn_sound(request.healthy, request.vehicle)
        progress("what each effect would do", 0.3)
        told = judge_runs(request.logs, sound, request.vehicle, request.settings, request.vehicle_name)
        progress("done", 1.0)
    folder = Path(HydraConfig.get().runtime.output_dir)
    log.info("\n%s\n", "\n".join(lines(told)))
    write_json(folder / "alike.json", to_json(told))
    log.info("alike.json is in %s", folder)


def lines(told: Alike) -> Iterator[str]:
    """For the console."""
    yield (
        f"{counted(len(told.runs), 'run')} of {told.seconds:g} s against {counted(told.healthy, 'sound one')}, in "
        f"{', '.join(told.channels)}"
    )
    for name in told.left_out:
        yield f"left out: {name} (too short, or a second without samples)"
    for answer in told.runs[:SHOWN]:
        yield f"  {answer.runs[0]}: {answer.sentence}"
    if len(told.runs) > SHOWN:
        counts = Counter(answer.causes[0].name if answer.causes else answer.verdict.key for answer in told.runs)
        of_all = ", ".join(f"{count} {words(name)}" for name, count in counts.items())
        yield f"  and {len(told.runs) - SHOWN} more; of all: {of_all}"
    if len(told.runs) > 1:
        yield f"all together: {told.together.sentence}"
    if told.cannot_tell:
        yield f"these runs cannot show: {', '.join(words(name) for name in told.cannot_tell)}"


def to_json(told: Alike) -> dict[str, Any]:
    """The content of ``alike.json``, of plain types alone."""
    runs, together = [_plain(answer) for answer in told.runs], _plain(told.together)
    return {"version": VERSION, **plain(told), "runs": runs, "together": together}


def _plain(answer: Answer) -> dict[str, Any]:
    return {**plain(answer), "sentence": answer.sentence}
