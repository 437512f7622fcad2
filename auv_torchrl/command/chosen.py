"""What a command line chose, in words."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from auv_torchrl.command.overrides import read_override

NOMINAL = "nominal"  # the name of no scenario


def scenario_name(choices: Mapping[str, Any], overrides: Sequence[str]) -> str:
    """What to call the scenario that a command line asked for, e.g. ``thruster_gain+swap``.

    Args:
        choices: the entry per config group; Hydra has none for a list.
        overrides: of the command line.
    """
    taken = choices.get("scenario") or []
    names = list(taken) if isinstance(taken, list) else [taken]
    for override in map(read_override, overrides):
        key, value = override.key, override.value
        if key == "scenario" and isinstance(value, list):
            names = [str(name) for name in value]
        if key.startswith("scenario.effects") and "custom" not in names:
            names.append("custom")
    return "+".join(Path(name).name.removesuffix(".yaml") for name in names) or NOMINAL
