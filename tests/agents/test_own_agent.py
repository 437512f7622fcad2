"""An agent of one's own, as docs/how-to/add-an-agent-or-task.md shows it."""

import re
from dataclasses import asdict
from typing import Any, cast

import pytest
import torch
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from tiny_training import train_tiny

from auv_torchrl.agents.config import AGENTS, load_agent_config, read_agent
from auv_torchrl.experiment import schema
from auv_torchrl.hydra_command.config_source import check_config_files
from auv_torchrl.paths import CONF, OWN, PROJECT


@pytest.fixture
def gentle(tmp_path, monkeypatch):
    """The agent of the document, in a folder of one's own that is in use."""
    document = (PROJECT / "docs" / "how-to" / "add-an-agent-or-task.md").read_text()
    code = next(block for block in re.findall(r"```python\n(.*?)```", document, re.S) if "AGENTS =" in block)
    settings = (CONF / "agent" / "sac.yaml").read_text()
    for folder in ("agents", "agent"):
        (tmp_path / folder).mkdir()
    (tmp_path / "agents" / "gentle.py").write_text(code)
    settings = settings.replace("sac_schema", "gentle_schema").replace("name: sac", "name: gentle")
    (tmp_path / "agent" / "gentle.yaml").write_text(settings)
    monkeypatch.setenv(OWN, str(tmp_path))
    return AGENTS["gentle"]


def test_a_loss_of_ones_own_is_learnt_with(gentle, tmp_path):
    """Its actor learns another policy than SAC's from the same seed, and a second training finds it again."""
    policy = train_tiny(tmp_path / "policies", agent="gentle")
    usual = train_tiny(tmp_path / "policies")
    weights, others = (list(each.module.parameters()) for each in (policy, usual))
    assert not all(torch.equal(one, other) for one, other in zip(weights, others, strict=True))
    assert train_tiny(tmp_path / "policies", agent="gentle").metadata["curve"] == policy.metadata["curve"]


def test_an_agent_of_ones_own_is_chosen_on_the_command_line(gentle):
    """By its name, with single settings changed."""
    schema.register()
    check_config_files()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        config = compose("train", ["agent=gentle", "agent.gamma=0.8"])
    agent = read_agent(cast(Any, OmegaConf.to_container(config.agent)))
    assert isinstance(agent, gentle) and asdict(agent)["gamma"] == 0.8
    assert asdict(load_agent_config("gentle"))["gamma"] == asdict(load_agent_config("sac"))["gamma"]
