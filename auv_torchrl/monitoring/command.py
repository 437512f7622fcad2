"""The command ``auv-diagnose``, which is ``python diagnose.py`` in a checkout: one log, dives over time, repeated runs.

The command line decides which of the three is asked for, so it stands here, above the diagnosis of one log.
"""

from omegaconf import DictConfig

from auv_torchrl.command import checking_input, command
from auv_torchrl.diagnosis.logs import find_logs, is_series
from auv_torchrl.diagnosis.memory import keep_freed_memory
from auv_torchrl.diagnosis.schema import register

register()


@command(
    "diagnose", files=("log", "healthy", "test", "params", "mapping", "store", "output", "vehicle"), file_key="log"
)
def main(config: DictConfig) -> None:
    """Diagnose the logs that are named, once it is sure that they are there."""
    with checking_input():
        found = find_logs(config)
        if config.alike and not found["healthy"]:
            raise ValueError("alike=true holds runs against sound ones: give healthy=[...], logs of sound runs")
    keep_freed_memory()
    # here, not above: --help and a mistaken command line need neither physics nor scipy
    if config.alike:
        from auv_torchrl.monitoring.repeated_runs import answer_runs as answer
    elif is_series(config):
        from auv_torchrl.monitoring.dive_job import answer_dives as answer
    else:
        from auv_torchrl.diagnosis.job import answer

    answer(config)
