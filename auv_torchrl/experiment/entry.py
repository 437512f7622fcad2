"""The command ``auv-train`` as Hydra reads it."""

from omegaconf import DictConfig

from auv_torchrl.experiment import schema
from auv_torchrl.hydra_command import hydra_command
from auv_torchrl.importing import importing


@hydra_command(
    "train",
    files=("diagnosis_file", "policies", "output", "vehicle", "scenario", "randomization"),
    groups=("scenario", "experiment"),
    register=schema.register,
    short={"diagnosis": "diagnosis_file"},  # Hydra would look for FILE in the folder conf/diagnosis
)
def train_command(config: DictConfig) -> None:
    """Run the experiment of a config that Hydra has checked."""
    with importing():  # here, not above: --help and a mistaken command line need nothing of it
        from auv_torchrl.experiment.job import train

    train(config)
