"""Logs that are not shipped: from the folder that AUV_TORCHRL_DATA names, else ../shared/data; skipped where absent."""

import os
from pathlib import Path

import pytest

from auv_torchrl.paths import PROJECT

EXCERPTS = Path(__file__).parent / "data"  # cut from flights that ArduSub 4.7 wrote of its own simulated vehicle


def shared(name: str) -> Path:
    """The path of a log, such as ``ardusub_sitl/healthy_a.BIN``; skips the test without it."""
    folder = Path(os.environ.get("AUV_TORCHRL_DATA", PROJECT.parent / "shared" / "data"))
    for place in (folder, PROJECT.parent.parent / "shared" / "data"):
        if (place / name).is_file():
            return place / name
    pytest.skip(f"{name} is not in {folder}: name its folder in AUV_TORCHRL_DATA")
