"""The command ``auv-train``, ``python train.py`` in a checkout, once it is sure that what trains is installed."""

from auv_torchrl.command import checking_input
from auv_torchrl.command.ending import ending
from auv_torchrl.extras import require


def main() -> None:
    """Run the command; without the extra ``train`` it ends with one line that says how to get it."""
    with ending("train"), checking_input():
        require(("hydra", "torch"), "auv-train needs", "train")
    from auv_torchrl.experiment.entry import train_command  # here, not above: Hydra need not be installed

    train_command()


if __name__ == "__main__":
    main()
