"""The averaged policy follows what is learnt."""

import pytest
import torch

from auv_torchrl.agents.config import load_agent_config
from auv_torchrl.agents.learning.learners import make_learner


@pytest.mark.parametrize("updates", [30, 300, 3000])
def test_the_average_lags_by_a_tenth_of_the_updates_at_most(updates):
    """Behind weights that grow by 1 with every update, however long its memory may become."""
    learner = make_learner(load_agent_config("sac", {"average": 0.999, "buffer_size": 2}), 3, 2, torch.device("cpu"))
    for weight in learner._actor:
        weight.zero_()
    for _ in range(updates):
        for weight in learner._actor:
            weight += 1
        learner._move_average(0.999)
    for average in learner.averaged.parameters():
        assert torch.all(average.data >= 0.9 * updates - 1) and torch.all(average.data < updates)
