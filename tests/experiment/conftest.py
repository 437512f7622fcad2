"""A whole run, so small that it takes seconds."""

import pytest
from hydra import compose, initialize_config_dir

from auv_torchrl.experiment import schema
from auv_torchrl.experiment.setup import Experiment, read_experiment
from auv_torchrl.paths import CONF

ANY_AGENT = (
    "starts=4", "task.episode_s=11", "backend=torch", "agent.hidden=[8,8]", "agent.num_envs=4",
    "agent.steps_per_batch=5", "agent.stretch_steps=20", "agent.total_frames=160",
    "agent.evaluation_starts=2", "agent.evaluation_box_m=1", "adapter.target_data_s=2",
    "flight.length_s=13", "flight.fault_s=[2,3]",
)  # fmt: skip
TINY = (*ANY_AGENT, "agent.batch_size=16", "agent.random_frames=40", "agent.buffer_size=200")


@pytest.fixture(scope="session")
def policies(tmp_path_factory):
    """A store that all tests share, so that the policy is trained once."""
    return tmp_path_factory.mktemp("policies")


@pytest.fixture(scope="session")
def experiment(policies):
    """Reads a tiny experiment with some scenario."""

    def read(scenario: str, *overrides: str) -> Experiment:
        schema.register()
        chosen = [] if scenario == "nominal" else [f"+scenario={scenario}"]
        with initialize_config_dir(version_base="1.3", config_dir=str(CONF)):
            tiny = ANY_AGENT if any(given.startswith("agent=") for given in overrides) else TINY
            config = compose("train", [*chosen, *tiny, f"policies={policies}", *overrides])
        return read_experiment(config, scenario)

    return read
