"""What ``diagnose.py`` does once its command line is read."""

import logging

from omegaconf import DictConfig

from auv_torchrl.command import Run, checking_input
from auv_torchrl.diagnosis.command.request import read_request
from auv_torchrl.diagnosis.pipeline import diagnose
from auv_torchrl.diagnosis.report import decision_table, named_files, summary_table, write_files
from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.progress import Progress

log = logging.getLogger("diagnose")


def answer(config: DictConfig, run: Run) -> None:
    """Read the logs, diagnose them, print the verdict, write the files."""
    with checking_input():
        request = read_request(config)
    with checking_input((FlightLogError,)), Progress() as progress:
        diagnosis = diagnose(
            request.log,
            request.vehicle,
            healthy=request.healthy,
            test=request.test,
            progress=progress,
            vehicle_name=request.vehicle_name,
            settings=request.settings,
            uncertainty=request.uncertainty,
            kept=request.kept,
        )
    folder = run.folder
    log.info(
        "\n%s\n", summary_table(diagnosis, request.printed)
    )  # before the files, so that a full disk does not keep it
    if config.explain:
        log.info("%s\n", decision_table(diagnosis))
    written = write_files(diagnosis, request.vehicle, folder, replace=True)  # of an unfinished run; others are refused
    log.info("%s are in %s", named_files(written), folder)
