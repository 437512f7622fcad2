"""The command ``auv-calibrate``, which is ``python calibrate.py`` in a checkout."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from auv_torchrl.command import CommandLine, Run, checking_input, command

if TYPE_CHECKING:
    from omegaconf import DictConfig

LINE = CommandLine("calibrate", ("healthy", "params", "mapping", "output", "vehicle"), bare="healthy")
NO_LOG = "no healthy log: give healthy=[a.csv,b.csv], flights of the vehicle while it was sound"


def schemas() -> Mapping[str, type]:
    """The types of its settings."""
    from auv_torchrl.diagnosis.command.schema import SCHEMAS

    return SCHEMAS


@command(LINE, schemas, has_folder=False)
def main(config: "DictConfig", run: Run) -> None:
    """Calibrate on the logs that are named, once it is sure that they are there and the file can be written."""
    with checking_input():
        logs, output = find_healthy(config), find_output(config)
    # here, not above: --help needs nothing of it
    from auv_torchrl.diagnosis.command.calibrate_job import calibrate_to_file

    calibrate_to_file(config, logs, output)


def find_healthy(config: "DictConfig") -> tuple[Path, ...]:
    """The logs that a config names.

    Raises:
        ValueError: if there is none, one twice, or one that cannot be read, is empty, or is not what its name says.
    """
    from auv_torchrl.diagnosis.command.logs import names  # here, not above: --help needs nothing of it
    from auv_torchrl.flightlog.readers import READERS, choose_reader

    found = tuple(Path(name) for name in names(config, "healthy"))
    if not found:
        raise ValueError(NO_LOG)
    for place, path in enumerate(found):
        choose_reader(path, READERS)
        if path.resolve() in [other.resolve() for other in found[:place]]:
            raise ValueError(f"{path} is given twice: give each flight once, they are held against each other")
    return found


def find_output(config: "DictConfig") -> Path:
    """The file to write.

    Raises:
        ValueError: if none is named, or it is no YAML, or there is no such folder.
        FileExistsError: if it is there and may not be replaced.
    """
    from omegaconf import OmegaConf

    if OmegaConf.is_missing(config, "output") or not config.output:
        raise ValueError("no output: give output=my_vehicle.yaml, the vehicle file to write")
    output = Path(config.output)
    if output.suffix not in (".yaml", ".yml"):
        raise ValueError(f"output={output} is no vehicle file: give a name that ends in .yaml")
    if not output.absolute().parent.is_dir():
        raise ValueError(f"there is no folder {output.parent}: make it, or give output=FILE elsewhere")
    if output.is_dir():
        raise ValueError(f"output={output} is a folder: give a file that ends in .yaml")
    if output.exists() and not config.replace:
        raise FileExistsError(f"{output} exists: give another output=FILE, or replace=true")
    if not os.access(output.absolute().parent, os.W_OK):
        raise ValueError(f"{output.absolute().parent} may not be written: give output=FILE elsewhere")
    return output


if __name__ == "__main__":
    main()
