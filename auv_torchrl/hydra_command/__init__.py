"""Commands that Hydra reads: ``train.py`` with its sweeps, and the sealed benchmark."""

from auv_torchrl.hydra_command.callback import OutputFolder
from auv_torchrl.hydra_command.entry import hydra_command

__all__ = ["OutputFolder", "hydra_command"]
