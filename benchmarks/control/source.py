"""What the benches fly: source policies, and scenarios and randomizations as they are shipped."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from auv_torchrl.agents.config import AgentConfig, load_agent_config
from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.agents.train_source import train_source
from auv_torchrl.paths import PROJECT, config_path
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import Vehicle
from auv_torchrl.yaml_file import read_yaml

BACKEND = "mujoco"
STORE = PROJECT / "outputs" / "policies"


def shipped_scenario(name: str, vehicle: Vehicle) -> Scenario:
    """What ``conf/scenario`` says."""
    return read_scenario(name, read_yaml(config_path("scenario", name), "scenario"), vehicle)


def ranges(name: str) -> dict[str, Any]:
    """What ``conf/randomization`` says."""
    return read_yaml(config_path("randomization", name), "randomization")


def training_s(policy: SourcePolicy) -> float:
    """CPU seconds that its training took, whenever that was."""
    return policy.metadata["curve"][-1]["cpu_s"]


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
