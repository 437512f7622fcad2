"""What a command line chose, in words."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser

NOMINAL = "nominal"  # the name of no scenario


def scenario_name(choices: Mapping[str, Any], overrides: Sequence[str]) -> str:
    """What to call the scenario that a command line asked for, e.g. ``thruster_gain+swap``.

    Args:
        choices: Hydra's choice per config group; it has no entry for a list.
        overrides: of the command line.
    """
    names = [choices["scenario"]] if choices.get("scenario") else []
    for override in OverridesParser.create().parse_overrides(list(overrides)):
        key, value = override.key_or_group, override.value()
        if key == "scenario" and isinstance(value, list):
            names = [str(name) for name in value]
        if key.startswith("scenario.effects") and "custom" not in names:
            names.append("custom")
    return "+".join(Path(name).name.removesuffix(".yaml") for name in names) or NOMINAL
