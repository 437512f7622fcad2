"""The settings of the adapter and their files."""

from typing import Any, cast

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from auv_torchrl.ddr import AdapterConfig
from auv_torchrl.paths import CONF, config_names


@pytest.mark.parametrize("name", config_names("adapter"))
def test_every_file_is_a_complete_valid_config(name):
    """Each entry of conf/adapter gives every setting, and the affine one the defaults of the code."""
    with initialize_config_dir(str(CONF / "adapter"), version_base="1.3"):
        values = cast(dict[str, Any], OmegaConf.to_container(compose(name)))
    config = AdapterConfig(**values)
    assert set(values) == set(AdapterConfig.__dataclass_fields__)
    if name == "affine":
        assert config == AdapterConfig()
    assert config.map == name


@pytest.mark.parametrize(
    ("key", "value"),
    [("map", "spline"), ("composition", "both"), ("dither", 1.5), ("tolerance", 0.0), ("bag_cap", 3), ("bag_least", 0)],
)
def test_a_value_that_cannot_work_is_refused_by_name(key, value):
    """The error names the setting and what it may be."""
    with pytest.raises(ValueError, match=key):
        AdapterConfig(**{key: value})
