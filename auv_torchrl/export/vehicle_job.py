"""What ``auv-export vehicle=...`` does: a vehicle for other simulators, and where each number comes from."""

import logging
from collections.abc import Callable

from omegaconf import DictConfig

from auv_torchrl.command import Run, checking_input
from auv_torchrl.export.ardusub import ardusub
from auv_torchrl.export.fossen import fossen
from auv_torchrl.export.marks import Described, read_described
from auv_torchrl.export.mjcf import mjcf
from auv_torchrl.export.sdf import sdf
from auv_torchrl.files import write_text

log = logging.getLogger("export")

FORMATS: dict[str, tuple[str, Callable[[Described], str]]] = {
    "mjcf": ("vehicle.xml", mjcf),
    "sdf": ("model.sdf", sdf),
    "ardusub": ("vehicle.parm", ardusub),
    "fossen": ("vehicle.md", fossen),
}
THRUSTERS_ALONE = ("mjcf", "sdf")


def export_vehicle(config: DictConfig, run: Run) -> None:
    """Write the file of the format."""
    with checking_input():
        if config.format not in FORMATS:
            raise ValueError(f"format={config.format} is none: give one of {', '.join(FORMATS)}")
        described = read_described(str(config.vehicle))
        if described.vehicle.servos and config.format in THRUSTERS_ALONE:
            what = "fins" if described.vehicle.fins else "azimuth thrusters"
            raise ValueError(
                f"vehicle={described.name} has {what}, which {config.format} has no force for: give format=fossen, or "
                "fly it with train.py"
            )
        name, write = FORMATS[config.format]
        text = write(described)
    path = run.folder / name
    write_text(path, text)
    log.info("%s of %s is in %s", config.format, described.name, path)
