"""The type of a scenario in the settings of every command that flies one."""

from dataclasses import dataclass, field
from typing import Any


@dataclass
class ScenarioSchema:
    """``conf/scenario/*.yaml``; the effects are checked by :func:`auv_torchrl.scenario.read_scenario`."""

    effects: dict[str, Any] = field(default_factory=dict)
