"""The command ``auv-train`` as Hydra reads it."""

from omegaconf import DictConfig

from auv_torchrl.experiment import schema
from auv_torchrl.hydra_command import hydra_command


@hydra_command(
    "train",
    files=("diagnosis_file", "policies", "output", "vehicle", "scenario", "randomization"),
    groups=("scenario", "experiment"),
    register=schema.register,
    short={"diagnosis": "diagnosis_file"},  # Hydra would look for FILE in the folder conf/diagnosis
)
def train_command(config: DictConfig) -> None:
    """Run the experiment of a config that Hydra has checked."""
    from auv_torchrl.experiment.job import train  # here, not above: --help and a mistaken command line need no torch

    train(config)
