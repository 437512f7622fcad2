"""The command ``auv-export``: a trained policy leaves the simulator."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from auv_torchrl.command import CommandLine, Run, checking_input, command
from auv_torchrl.extras import require

if TYPE_CHECKING:
    from omegaconf import DictConfig

LINE = CommandLine("export", ("policy", "adapter", "output"), bare="policy")


def schemas() -> Mapping[str, type]:
    """The types of its settings."""
    from auv_torchrl.export.schema import SCHEMAS

    return SCHEMAS


@command(LINE, schemas)
def main(config: "DictConfig", run: Run) -> None:
    """Write the files and the contract of a policy."""
    with checking_input():
        require(["torch"], "auv-export needs", "train")
    from auv_torchrl.export.job import export  # here, not above: torch takes a second

    export(config, run)


if __name__ == "__main__":
    main()
