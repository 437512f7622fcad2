"""What every command of the project shares: its arguments, its output folder, its errors and its end."""

from auv_torchrl.command.callback import OutputFolder
from auv_torchrl.command.entry import command
from auv_torchrl.command.errors import BAD_INPUT, BadInput, checking_input
from auv_torchrl.command.folder import claim_folder
from auv_torchrl.command.terminal import Console, LogFile

__all__ = [
    "BAD_INPUT", "BadInput", "Console", "LogFile", "OutputFolder", "checking_input", "claim_folder", "command",
]  # fmt: skip
