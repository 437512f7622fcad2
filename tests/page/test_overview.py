"""Curves for a screen: no peak is lost, times go on, errors of prediction stand where they belong."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from auv_torchrl.flightlog.tables.table import Table
from auv_torchrl.page.overview import (
    MOST_POINTS,
    Panel,
    drawn,
    in_time,
    prediction_panels,
    read_panels,
    times_of,
    write_panels,
)


def test_a_thinned_curve_keeps_every_peak():
    """One sample of 100,000 that stands out is drawn, and a stretch without samples is none."""
    values = np.zeros(100_000)
    values[77_777], values[50_000:60_000] = 5.0, np.nan
    (found,) = drawn([Panel("Depth", "m", np.arange(100_000) / 50, {"depth": values})])
    (series,) = found["series"]
    assert len(found["t"]) == len(series["values"]) <= MOST_POINTS
    told = [value for value in series["values"] if value is not None]
    assert max(told) == 5.0 and len(told) < len(series["values"])


def test_a_closer_look_has_all_samples():
    """Of the stretch that is asked for, and one on each side."""
    t = np.arange(100_000) / 50
    (found,) = drawn([Panel("Depth", "m", t, {"depth": t})], 100.0, 102.0)
    assert found["t"] == pytest.approx(np.arange(99.98, 102.03, 0.02).tolist(), abs=1e-3)


def test_curves_are_kept_as_numbers(tmp_path):
    """What is read is what was written."""
    written = Panel("Attitude", "°", np.arange(3.0), {"roll": np.ones(3), "pitch": np.full(3, np.nan)})
    write_panels(tmp_path / "overview.npz", [written])
    (read,) = read_panels(tmp_path / "overview.npz")
    assert (read.title, read.unit, list(read.series)) == ("Attitude", "°", ["roll", "pitch"])
    assert np.isnan(read.series["pitch"]).all() and np.array_equal(read.t, written.t)


def table(t, episode):
    """A table of such rows."""
    columns = {"t": np.array(t, float), "episode": np.array(episode, float)}
    return Table("x.csv", columns, np.arange(1, len(t) + 1), ())


def test_episodes_stand_one_behind_the_other():
    """With a second between them; rows without a time are left out."""
    t, added = times_of(table([0, 1, 2, 0, 1, np.nan], [4, 4, 4, 2, 2, 2]))
    assert t[:5].tolist() == [0, 1, 2, 3, 4] and added == {2: 3.0, 4: 0.0}
    ordered, times = in_time(table([0, 1, 2, 0, 1, np.nan], [4, 4, 4, 2, 2, 2]), t)
    assert times.tolist() == [0, 1, 2, 3, 4] and ordered.row.tolist() == [1, 2, 3, 4, 5]


def test_a_log_of_one_episode_keeps_its_times():
    """Also where it begins late."""
    assert times_of(table([5, 6], [0, 0]))[0].tolist() == [5, 6]


def test_errors_of_prediction_stand_at_the_times_of_the_dive(tmp_path):
    """Of each held-out stretch, over the axes that are measured, behind what its episode is shifted by."""
    columns = {"window": [0, 0, 1, 1], "episode": [1, 1, 1, 1], "t": [1.0, 1.1, 0.2, 0.3]}
    for axis in ("x", "y", "z", "yaw"):
        columns |= {f"measured_{axis}": [0.0] * 4, f"before_{axis}": [3.0] * 4, f"after_{axis}": [0.0] * 4}
    columns["measured_z"] = [np.nan] * 4
    pyarrow.parquet.write_table(pa.table(columns), tmp_path / "predictions.parquet")
    panels, spans = prediction_panels(tmp_path / "predictions.parquet", {0: 0.0, 1: 10.0})
    place, heading = panels
    assert place.t.tolist() == pytest.approx([10.2, 10.3, 10.301, 11.0, 11.1, 11.101])
    assert place.series["before"][[0, 1]].tolist() == pytest.approx([np.sqrt(18)] * 2)
    assert place.series["after"][0] == 0 and np.isnan(place.series["before"][2])
    assert heading.series["before"][0] == pytest.approx(np.rad2deg(3.0))
    assert np.array(spans) == pytest.approx(np.array([(11.0, 11.1), (10.2, 10.3)]))
