"""What a diagnosis holds in memory has a bound, and what is left out for it is said."""

import json
import subprocess
import sys
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl.diagnosis.identify.hypotheses import batch, load_settings
from auv_torchrl.diagnosis.lengths import MOST_COMMANDS, share_findings, stretches_of
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.windows import FEWEST, MOST, affordable
from auv_torchrl.diagnosis.thresholds import MAX_WINDOWS
from auv_torchrl.diagnosis.validate.predict import colour_of
from auv_torchrl.flightlog import Episode, FlightLog, raw_columns, write_columns
from auv_torchrl.flightlog.log import AXES, SampleErrors
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.simulate import simulated_logs
from tests.memory import PRINT_MOST_KIB

SETTINGS = load_settings()
LIMIT = 1_500_000_000  # bytes that a diagnosis of any file below 100 MB may take
LIGHT = 450 << 20  # bytes for two minutes of 15 channels with a fault that sets in: of these, libraries take 130 MB
POSE_ALONE = ("x", "y", "z", "yaw")


def swaying(seconds, rate_hz, axes=AXES, number=0) -> Episode:
    """An episode whose channels all sway, sampled at a rate."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    sway = 0.5 * np.sin(t[:, None] * np.linspace(0.3, 0.9, len(AXES)))
    values = np.where([axis in axes for axis in AXES], sway, np.nan)
    return Episode(number, t, values[:, :6], values[:, 6:12], sway[:, :8], acceleration=values[:, 12:])


def log_of(*episodes, axes=AXES, **more) -> FlightLog:
    return FlightLog("synthetic", tuple(episodes), axes, **more)


def cut(log):
    return cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s)


@pytest.mark.parametrize("errors", [SampleErrors(), SampleErrors(snapshot_s=0.1)], ids=["white", "coloured"])
def test_windows_of_a_long_log_of_many_channels_fit_the_memory(errors):
    """Their slopes, and what whitens them, stay within the bound; they are spread evenly, and a finding says so."""
    log = log_of(swaying(900.0, 25.0), errors=errors)
    windows = cut(log)
    numbers, bins = windows.trust[0].size, SETTINGS.window_s / SETTINGS.bin_s
    assert FEWEST < len(windows) < MAX_WINDOWS
    assert 8 * len(windows) * numbers * (12 + 2 * 6 * bins) <= MOST
    begins = windows.time
    assert begins[0] < 3 and begins[-1] > 890
    np.testing.assert_allclose(np.diff(begins), np.diff(begins).mean(), atol=SETTINGS.window_s)
    (finding,) = share_findings(windows, log)
    share = len(windows) * SETTINGS.window_s / log.duration
    assert (
        finding.code == "looked_at" and f"of 15 min that are learnt from, {share:.0%} are looked at" in finding.sentence
    )


def test_windows_whose_errors_are_coloured_are_fewer():
    """What whitens the numbers of a window takes memory, too."""
    assert affordable(500, 132, coloured=True) < affordable(500, 132, coloured=False)
    assert affordable(10**6, 10**4, coloured=True) == FEWEST


@pytest.mark.parametrize(
    ("seconds", "rate_hz", "axes"), [(180.0, 20.0, AXES), (180.0, 25.0, AXES), (360.0, 20.0, POSE_ALONE)]
)
def test_of_an_ordinary_log_all_windows_are_kept(seconds, rate_hz, axes):
    """Three minutes of all channels, or six of a pose, are looked at as a whole, and nothing is said."""
    log = log_of(swaying(seconds, rate_hz, axes), axes=axes)
    windows = cut(log)
    assert len(windows) == int((seconds - SETTINGS.lead_s) / SETTINGS.window_s)
    assert windows.share == 1 and not share_findings(windows, log)


def test_a_long_log_says_what_part_of_it_is_looked_at():
    """Of a quarter of an hour of a pose, six minutes are looked at."""
    log = log_of(swaying(900.0, 20.0, POSE_ALONE), axes=POSE_ALONE)
    windows = cut(log)
    assert len(windows) == MAX_WINDOWS
    assert "40% are looked at" in share_findings(windows, log)[0].sentence


def test_one_long_episode_among_many_short_ones_is_cut():
    """Commands of all episodes lie side by side, each as long as the longest: that has a bound, and a finding."""
    log = log_of(swaying(2000.0, 5.0), *(swaying(10.0, 5.0, number=1 + k) for k in range(100)))
    whole = stretches_of(log)
    assert [finding.code for finding in whole.findings] == ["stretches"]
    windows = cut(whole)
    assert windows.commands.nbytes <= MOST_COMMANDS
    assert sum(episode.duration > 100 for episode in whole.episodes) == 17
    assert stretches_of(log_of(swaying(2000.0, 5.0))).findings == ()


def test_thousands_of_short_episodes_are_not_all_looked_at():
    """Of more episodes than fit the memory the longest are taken, in their order."""
    log = log_of(*(swaying(20.0 + k % 2, 5.0, number=k) for k in range(1000)))
    whole = stretches_of(log)
    assert cut(whole).commands.nbytes <= MOST_COMMANDS
    assert 20 < len(whole.episodes) < 500 and all(episode.duration > 20 for episode in whole.episodes)
    assert [episode.number for episode in whole.episodes] == list(range(len(whole.episodes)))


def test_the_variance_of_many_stretches_takes_the_memory_of_a_few_covariances():
    """Of the covariance of a stretch its diagonal alone is kept, before the next one is worked out."""
    log = log_of(swaying(120.0, 20.0), errors=SampleErrors(snapshot_s=0.1))
    windows = cut_windows(log, 4.0, SETTINGS.lead_s)
    vehicle = batch(load_vehicle("bluerov2_heavy"), [{}])
    tracemalloc.start()
    try:
        variance = colour_of(windows, vehicle, SETTINGS, windows.guess)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(windows) > 25 and (variance >= 0).all() and variance.any()
    assert most < len(windows) / 2 * 8 * windows.trust[0].size ** 2


ALONE = f"""
import sys

sys.modules |= dict.fromkeys(("mujoco", "dm_control", "rerun", "pyarrow"))  # as if they were not installed
sys.argv[0] = "auv-diagnose"
from auv_torchrl.monitoring.command import main

main()
{PRINT_MOST_KIB}
"""


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="counts memory as Linux does")
def test_a_fault_that_sets_in_takes_little_more_memory(tmp_path):
    """The whole log is let go while a part of it is searched, and responses are worked out piece by piece."""
    faults = [{}, {"thruster_gain": {"gain_4": 0.3}}]
    sound, faulty = simulated_logs("paper", faults, episodes=2, seconds=30.0, felt=0.03)
    episodes = (replace(e, number=k) for k, e in enumerate((*sound.episodes, *faulty.episodes)))
    log = replace(sound, episodes=tuple(episodes))
    note = json.dumps({"drift": {}, "snapshot_s": 0.1, "autopilot": {}})
    write_columns(raw_columns(log), tmp_path / "dive.csv", note=note)
    out = tmp_path / "out"
    words = [f"log={tmp_path / 'dive.csv'}", "vehicle=paper", f"output={out}"]
    done = subprocess.run([sys.executable, "-c", ALONE, *words], capture_output=True, text=True, check=True)
    diagnosis = json.loads((out / "diagnosis.json").read_text())
    assert diagnosis["where"]["onset_episode"] == 2 and diagnosis["effects"][0]["thrusters"] == [4]
    took = 1024 * int(done.stdout.splitlines()[-1])
    assert took < LIGHT


@pytest.mark.thorough
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="counts memory as Linux does")
@pytest.mark.parametrize("snapshot_s", [0.0, 0.1], ids=["white", "coloured"])
def test_a_diagnosis_of_all_channels_stays_below_the_limit(tmp_path, snapshot_s):
    """A quarter of an hour of 15 channels with a fault, from file to report, in a process of its own."""
    log = simulated_logs("paper", [{"thruster_gain": {"gain_4": 0.55}}], episodes=1, seconds=900.0, felt=0.03)[0]
    note = json.dumps({"drift": {}, "snapshot_s": snapshot_s, "autopilot": {}})
    write_columns(raw_columns(log), tmp_path / "long.csv", note=note)
    code = (
        "import resource, subprocess, sys; subprocess.run([sys.executable, *sys.argv[1:]], check=True)\n"
        "print(1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    command = ["diagnose.py", f"log={tmp_path / 'long.csv'}", "vehicle=paper", f"output={tmp_path / 'out'}"]
    done = subprocess.run([sys.executable, "-c", code, *command], capture_output=True, text=True, check=True)
    assert int(done.stdout.splitlines()[-1]) < LIMIT
    assert "are looked at" in (tmp_path / "out" / "diagnosis.json").read_text()
