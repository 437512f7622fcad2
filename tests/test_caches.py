"""Folders in which work is kept that can be done again: where nothing can be kept, that costs time and nothing else."""

import errno
import logging
from pathlib import Path

import pytest

from auv_torchrl import files, paths
from auv_torchrl.monitoring import dive_work
from auv_torchrl.monitoring.dive_record import Dive


def test_a_user_without_a_home_has_no_cache_folder_but_one_that_is_named(monkeypatch, tmp_path):
    """An OSError, as of any folder that cannot be used; XDG_CACHE_HOME needs no home."""

    def nobody():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", nobody)
    monkeypatch.setattr(paths.sys, "platform", "linux")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    with pytest.raises(OSError, match="no home folder"):
        paths.cache_folder()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert paths.cache_folder() == tmp_path / "auv_torchrl"


def test_a_full_store_of_dives_is_said_once_and_stops_nothing(monkeypatch, caplog, tmp_path):
    """The dives that follow are worked out all the same."""

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    files.say_not_kept.cache_clear()
    monkeypatch.setattr(dive_work, "write_text", full)
    monkeypatch.setattr(dive_work, "plain", lambda _: {})
    with caplog.at_level(logging.WARNING):
        for key in ("a", "b"):
            dive_work.write_record(tmp_path, key, object.__new__(Dive))
    assert [record.getMessage() for record in caplog.records] == [
        "nothing can be kept for the next start (No space left on device): "
        "what takes long is worked out again each time"
    ]
