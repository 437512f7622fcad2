"""The command ``auv-diagnose``, which is ``python diagnose.py`` in a checkout: one log, dives over time, repeated runs.

The command line decides which of the three is asked for, so it stands here, above the diagnosis of one log.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from auv_torchrl.command import CommandLine, Run, checking_input, command

if TYPE_CHECKING:
    from omegaconf import DictConfig

FILES = ("log", "healthy", "test", "params", "mapping", "store", "output", "vehicle")
LINE = CommandLine("diagnose", FILES, bare="log", words=("example",))


def schemas() -> Mapping[str, type]:
    """The types of its settings."""
    from auv_torchrl.diagnosis.command.schema import SCHEMAS

    return SCHEMAS


@command(LINE, schemas)
def main(config: "DictConfig", run: Run) -> None:
    """Diagnose the logs that are named, once it is sure that they are there."""
    # here, not above: --help needs none of these, and a mistaken command line neither physics nor scipy
    from auv_torchrl.diagnosis.command.logs import find_logs, is_series

    with checking_input():
        found = find_logs(config)
        if config.alike and not found["healthy"]:
            raise ValueError("alike=true holds runs against sound ones: give healthy=[...], logs of sound runs")
    if config.alike:
        from auv_torchrl.monitoring.repeated_runs import answer_runs as answer
    elif is_series(config):
        from auv_torchrl.monitoring.dive_job import answer_dives as answer
    else:
        from auv_torchrl.diagnosis.command.diagnose_job import answer

    answer(config, run)


if __name__ == "__main__":
    main()
