"""What every command of the project shares: its words, its settings, its output folder, its errors and its end.

In the order of reading: ``entry`` (what a command does), ``options`` and ``overrides`` (its words), ``arguments`` and
``compose`` (its settings), ``folder`` and ``run`` (where it works), ``errors`` and ``ending`` (how it ends),
``terminal`` and ``completion``. Commands that train are read by Hydra: :mod:`auv_torchrl.hydra_command`.
"""

from typing import TYPE_CHECKING

from auv_torchrl.command.entry import command
from auv_torchrl.command.errors import BAD_INPUT, BadInput, checking_input
from auv_torchrl.command.options import CommandLine
from auv_torchrl.command.run import Run
from auv_torchrl.late import late

if TYPE_CHECKING:
    from auv_torchrl.command.folder import claim_folder
    from auv_torchrl.command.terminal import Console, LogFile

__all__ = [
    "BAD_INPUT", "BadInput", "CommandLine", "Console", "LogFile", "Run", "checking_input", "claim_folder", "command",
]  # fmt: skip

__getattr__ = late(__name__, {"terminal": "Console LogFile", "folder": "claim_folder"})
