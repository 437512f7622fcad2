"""The command ``auv-sim``: the physics of this package behind ArduSub."""

from omegaconf import DictConfig

from auv_torchrl.command import checking_input, command
from auv_torchrl.link.address import parse_address
from auv_torchrl.link.schema import register

register()


@command("sim", files=("output", "vehicle", "scenario"), groups=("scenario",), has_folder=False)
def main(config: DictConfig) -> None:
    """Fly what ArduSub sends, once it is sure where to listen."""
    with checking_input():
        address = parse_address(config.bind, config.elsewhere)
    from auv_torchrl.link.job import simulate_for_firmware  # here, not above: --help needs nothing of it

    simulate_for_firmware(config, address)


if __name__ == "__main__":
    main()
