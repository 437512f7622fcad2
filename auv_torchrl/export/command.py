"""The command ``auv-export``: a trained policy, or a vehicle, leaves the simulator."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from auv_torchrl.command import BadInput, CommandLine, Run, checking_input, command
from auv_torchrl.extras import require

if TYPE_CHECKING:
    from omegaconf import DictConfig

LINE = CommandLine("export", ("policy", "adapter", "vehicle", "output"), bare="policy")


def schemas() -> Mapping[str, type]:
    """The types of its settings."""
    from auv_torchrl.export.schema import SCHEMAS

    return SCHEMAS


@command(LINE, schemas)
def main(config: "DictConfig", run: Run) -> None:
    """Write the files and the contract of a policy, or a vehicle in the format of another program."""
    if (config.policy is None) == (config.vehicle is None):
        raise BadInput("give policy=FOLDER, or vehicle=FILE with format=mjcf, sdf, ardusub or fossen")
    if config.vehicle is not None:
        from auv_torchrl.export.vehicle_job import export_vehicle  # here, not above: --help needs nothing of it

        export_vehicle(config, run)
        return
    with checking_input():
        require(["torch"], "auv-export needs", "train")
    from auv_torchrl.export.job import export  # here, not above: torch takes a second

    export(config, run)


if __name__ == "__main__":
    main()
