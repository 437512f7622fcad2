"""The command ``auv-fly``: an exported policy in front of ArduSub."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from auv_torchrl.command import CommandLine, Run, command

if TYPE_CHECKING:
    from omegaconf import DictConfig

LINE = CommandLine("fly", ("policy", "output"), bare="policy")


def schemas() -> Mapping[str, type]:
    """The types of its settings."""
    from auv_torchrl.fly.schema import SCHEMAS

    return SCHEMAS


@command(LINE, schemas, has_folder=False)
def main(config: "DictConfig", run: Run) -> None:
    """Fly the vehicle, and leave it as it was."""
    from auv_torchrl.fly.job import fly  # here, not above: --help needs nothing of it

    fly(config, run)


if __name__ == "__main__":
    main()
