"""The command ``auv-sim``: the physics of this package behind ArduSub."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from auv_torchrl.command import CommandLine, Run, checking_input, command

if TYPE_CHECKING:
    from omegaconf import DictConfig

LINE = CommandLine("sim", ("output", "vehicle", "scenario"), groups=("scenario",))


def schemas() -> Mapping[str, type]:
    """The types of its settings."""
    from auv_torchrl.link.schema import SCHEMAS

    return SCHEMAS


@command(LINE, schemas, has_folder=False)
def main(config: "DictConfig", run: Run) -> None:
    """Fly what ArduSub sends, once it is sure where to listen."""
    from auv_torchrl.link.address import parse_address  # here, not above: --help needs nothing of it

    with checking_input():
        address = parse_address(config.bind, config.elsewhere)
    from auv_torchrl.link.job import simulate_for_firmware  # here: a mistaken command line needs nothing of it

    simulate_for_firmware(config, address, run)


if __name__ == "__main__":
    main()
