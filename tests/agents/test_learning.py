"""Soft actor-critic learns the task."""

import pytest

from auv_torchrl.agents.config import load_agent_config
from auv_torchrl.agents.train_source import train_source
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle


@pytest.mark.slow
def test_source_policy_regulates_within_two_centimetres(tmp_path):
    """Some seconds of training bring the mean error from held-out starts in +-1 m below 0.02 m."""
    config = load_agent_config("sac", {"stop_below_m": 0.02})
    policy = train_source(
        load_vehicle("paper"), StationKeeping(box_m=1.0), config, None, seed=3, backend="mujoco", folder=tmp_path
    )
    assert policy.metadata["result"]["best_m"] < 0.02
    assert policy.metadata["curve"][-1]["frames"] <= 2 * config.stretch_frames
