"""The command ``auv-export``: a trained policy leaves the simulator."""

from omegaconf import DictConfig

from auv_torchrl.command import command
from auv_torchrl.export.schema import register
from auv_torchrl.importing import importing

register()


@command("export", files=("policy", "adapter", "output"))
def main(config: DictConfig) -> None:
    """Write the files and the contract of a policy."""
    with importing():  # here, not above: torch takes a second
        from auv_torchrl.export.job import export

    export(config)


if __name__ == "__main__":
    main()
