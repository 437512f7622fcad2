"""The source policies that the benches fly."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from auv_torchrl.agents.config import AgentConfig, load_agent_config
from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.agents.train_source import train_source
from auv_torchrl.paths import PROJECT
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import Vehicle

BACKEND = "mujoco"
STORE = PROJECT / "outputs" / "policies"


def source_policy(
    vehicle: Vehicle, store: Path, ranges: Mapping[str, Any] | None = None, agent: AgentConfig | None = None
) -> SourcePolicy:
    """A policy trained on this vehicle, from the store if it was trained before.

    Args:
        vehicle: one vehicle (empty batch).
        store: of policies.
        ranges: of the randomization; none without.
        agent: settings of the training; the default ones without.
    """
    return train_source(vehicle, StationKeeping(), agent or load_agent_config(), ranges or {}, 0, BACKEND, store)
