"""A training is logged by TorchRL's loggers."""

import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tiny_training import train_tiny

from auv_torchrl.agents import loggers
from auv_torchrl.agents.loggers import LOGGERS, LoggerConfig, TrainingLog
from auv_torchrl.paths import config_names, config_path
from auv_torchrl.yaml_file import read_yaml


def test_every_logger_has_a_file():
    """``logger=NAME`` chooses what the name says, without a video."""
    assert set(config_names("logger")) == set(LOGGERS)
    for name in LOGGERS:
        assert read_yaml(config_path("logger", name), "logger") == {"name": name, "video": False}


def test_the_curve_is_in_tensorboard(tmp_path):
    """Each value of each stretch stands at its number of transitions."""
    policy = train_tiny(tmp_path, logger=LoggerConfig("tensorboard"))
    curve = policy.metadata["curve"]
    events = EventAccumulator(str(tmp_path / policy.metadata["hash"] / "tensorboard"))
    events.Reload()
    for name in set(curve[0]) - {"frames"}:
        logged = [(event.step, event.value) for event in events.Scalars(f"train/{name}")]
        expected = [(point["frames"], point[name]) for point in curve]
        torch.testing.assert_close(torch.tensor(logged), torch.tensor(expected), rtol=1e-5, atol=0, equal_nan=True)


def test_the_curve_is_in_csv(tmp_path):
    """``logger=csv`` writes a file for each value, of pairs of transitions and value."""
    logged = TrainingLog(LoggerConfig("csv"), tmp_path, "key")
    for frames, error in ((100, 0.5), (200, 0.25)):
        logged.point({"frames": frames, "error_m": error})
    logged.close()
    assert (tmp_path / "csv" / "scalars" / "train" / "error_m.csv").read_text().split() == ["100,0.5", "200,0.25"]


@pytest.mark.parametrize("name", ["tensorboard", "wandb", "mlflow"])
def test_what_is_not_installed_is_named_before_the_training(name, monkeypatch):
    """With the command that brings it."""
    monkeypatch.setattr(loggers, "is_there", lambda module: False)
    with pytest.raises(ValueError, match=f"logger={name} needs {name}, .*pip install {name}"):
        LoggerConfig(name)
    monkeypatch.setattr(loggers, "is_there", lambda module: module == name)
    with pytest.raises(ValueError, match=f"logger.video=true with logger={name} needs (moviepy|torchcodec)"):
        LoggerConfig(name, video=True)


def test_a_part_of_a_package_that_is_not_there_is_not_there():
    """Neither is the package itself."""
    assert loggers.is_there("json.decoder") and not loggers.is_there("no_such_package.part")


def test_a_video_needs_a_logger():
    """There is nowhere to put one."""
    with pytest.raises(ValueError, match="logger=none keeps no video"):
        LoggerConfig("none", video=True)


def test_the_trained_policy_is_filmed(tmp_path, monkeypatch):
    """One episode of 1 s is ten pictures of the vehicle, in colour, and they are logged once, at the end."""
    logged = []

    class Camera:
        experiment = None

        def log_scalar(self, name, value, step): ...

        def log_video(self, name, video, step, fps):
            logged.append((name, video, step, fps))

        def close(self): ...

    monkeypatch.setattr(loggers, "is_there", lambda module: True)
    monkeypatch.setattr(loggers, "_make", lambda name, folder, key: Camera())
    policy = train_tiny(tmp_path, logger=LoggerConfig("tensorboard", video=True))
    ((name, video, step, fps),) = logged
    assert (name, step, fps) == ("flight", policy.metadata["curve"][-1]["frames"], 10)
    assert video.shape[:3] == (1, 10, 3) and video.dtype == torch.uint8
    assert (video[0, 0] != video[0, -1]).any()
