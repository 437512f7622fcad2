"""Damaged logs are found out when they are read, and sound ones are left alone."""

from dataclasses import replace

import numpy as np
import pytest
from simulate import simulated_logs

from auv_torchrl.flightlog import FlightLogError, raw_columns, read_flightlog, write_columns
from auv_torchrl.flightlog.checks.information import check_information
from auv_torchrl.flightlog.tables.table import Table, read_table
from auv_torchrl.paths import EXAMPLE_LOG
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.flights.damages import BOTH, DAMAGES, POSES, damaged

VEHICLE = load_vehicle("paper")
ENGINE = ("heading_backwards", "heading_quarter")  # told by the diagnosis, as an effect
CHANGES_UNITS = ("length_unit", "speed_unit", "one_sided_commands")


@pytest.fixture(scope="module")
def sound():
    """A log of the sound vehicle with pose and velocity, 2 mm, 0.004 rad, 5 mm/s and 0.01 rad/s of noise."""
    (log,) = simulated_logs("paper", [{}])
    rng = np.random.default_rng(3)
    noisy = []
    for e in log.episodes:
        pose = e.pose + rng.normal(size=e.pose.shape) * np.repeat((0.002, 0.004), 3)
        velocity = e.velocity + rng.normal(size=e.velocity.shape) * np.repeat((0.005, 0.01), 3)
        noisy.append(replace(e, pose=pose, velocity=velocity))
    return replace(log, episodes=tuple(noisy))


def read(columns, tmp_path):
    return read_flightlog(write_columns(columns, tmp_path / "log.csv"), VEHICLE)


@pytest.mark.parametrize("axes", [POSES, BOTH, ("u", "v", "w", "r")], ids=["pose", "both", "velocity"])
def test_a_sound_log_gives_no_finding(sound, axes, tmp_path):
    """Noise, waves and steps are no damage, whatever is measured."""
    log = read(raw_columns(replace(sound, axes=axes)), tmp_path)
    assert log.axes == axes and not log.findings
    assert all(episode.filled is None for episode in log.episodes)


@pytest.mark.parametrize("name", [name for name, d in DAMAGES.items() if name not in ENGINE and not d.healthy])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_damage_is_named_when_the_log_is_read(sound, name, seed, tmp_path):
    """One of the findings has a code of the damage and mentions the columns; what is worth nothing is refused."""
    damage = DAMAGES[name]
    columns, which = damaged(raw_columns(replace(sound, axes=damage.axes)), damage, np.random.default_rng(seed))
    try:
        log = read(columns, tmp_path)
    except FlightLogError as error:
        assert name == "all_constant" and all(column in str(error) for column in which)
        return
    named = [finding for finding in log.findings if finding.code in damage.codes]
    assert named
    if damage.mentions:
        assert set(which) <= {column for finding in named for column in finding.columns}
    for finding in named:
        assert finding.remedy and finding.sentence


@pytest.mark.parametrize("name", ["spikes", "depth_frozen", "held_samples", "slow_sensor"])
def test_doubtful_values_weigh_nothing_and_true_ones_stay(sound, name, tmp_path):
    """What the damage changed is marked as filled in, and what is not marked is as it was measured."""
    damage = DAMAGES[name]
    clean = raw_columns(replace(sound, axes=damage.axes))
    columns, which = damaged(clean, damage, np.random.default_rng(5))
    log = read(columns, tmp_path)
    marked = np.concatenate([np.zeros((len(e), 12)) if e.filled is None else e.filled for e in log.episodes])
    values = np.concatenate([np.concatenate([e.pose, e.velocity], 1) for e in log.episodes])
    order = ("x", "y", "z", "roll", "pitch", "yaw")
    for column in which:
        broken = np.abs(np.angle(np.exp(1j * (columns[column] - clean[column])))) > 1e-9
        mask = marked[:, order.index(column)] > 0
        assert mask[broken].mean() > 0.97
        assert mask[~broken].mean() < 0.02
        kept = values[~mask, order.index(column)]
        apart = np.angle(np.exp(1j * (kept - clean[column][~mask])))
        assert np.quantile(np.abs(apart), 0.99) < 1e-5


@pytest.mark.parametrize("name", ["feet", "centimetres", "knots", "commands_one_sided"])
def test_other_units_are_converted_to_within_five_per_cent(sound, name, tmp_path):
    """After reading, a log in other units is the log that was flown."""
    damage = DAMAGES[name]
    axes = replace(sound, axes=damage.axes)
    clean = read(raw_columns(axes), tmp_path)
    (tmp_path / "log.csv").unlink()
    log = read(damaged(raw_columns(axes), damage, np.random.default_rng(0))[0], tmp_path)
    assert {f.code for f in log.findings} & set(CHANGES_UNITS)
    for there, here in zip(clean.episodes, log.episodes, strict=True):
        np.testing.assert_allclose(here.commands, there.commands, atol=1e-5)
        for a, b in ((there.pose, here.pose), (there.velocity, here.velocity)):
            np.testing.assert_allclose(np.nan_to_num(b), np.nan_to_num(a), rtol=0.05, atol=1e-4)


def test_a_vehicle_at_rest_is_not_a_frozen_sensor():
    """Without thrust a coarse or noise-free column may stand still."""
    t = np.arange(0, 20, 0.05)
    moving = np.where(t > 10, t - 10, 0.0)
    push = np.repeat(np.where(t > 10, 0.5, 0.0)[:, None], 6, axis=1)
    table = Table("log.csv", {"t": t, "x": moving}, np.arange(1, len(t) + 1), ())
    checked = check_information(table, ("x",), push)
    assert not any(finding.code == "frozen" for finding in checked.findings)


def test_the_resolution_of_a_column_is_the_step_in_which_it_was_written(sound, tmp_path):
    """Rounding to 1 cm gives 1 cm, six decimals give a millionth."""
    columns = raw_columns(replace(sound, axes=POSES))
    columns["x"] = np.round(columns["x"], 2)
    log = read(columns, tmp_path)
    assert log.resolution["x"] == pytest.approx(0.01)
    assert log.resolution["y"] == pytest.approx(1e-6, rel=1e-3)


@pytest.mark.parametrize("off", [0.0, 0.3], ids=["fast", "off the path"])
def test_a_first_value_is_off_the_path_where_the_next_ones_do_not_go_on_from_it(off, tmp_path):
    """A vehicle that is fast when its log begins is believed; a first value of its own is left out."""
    columns = dict(read_table(EXAMPLE_LOG).columns)
    columns["y"][0] -= off
    log = read_flightlog(write_columns(columns, tmp_path / "log.csv"), load_vehicle("paper"))
    told = [finding.where for finding in log.findings if finding.code == "outliers"]
    assert told == (["row 1"] if off else [])
