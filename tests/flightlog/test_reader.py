"""Reading and writing flight logs."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from auv_torchrl.flightlog import FlightLogError, Severity, join, read_flightlog, write_flightlog
from auv_torchrl.flightlog.tables.table import read_table
from auv_torchrl.vehicle import DEGREES_OF_FREEDOM, load_vehicle
from tests.flightlog.simulate import POSE_ONLY, simulated_logs


@pytest.fixture(scope="module")
def flown():
    """A pose-only log of the paper's vehicle."""
    return replace(simulated_logs("paper", [{}])[0], axes=POSE_ONLY)


@pytest.fixture(scope="module")
def paper():
    return load_vehicle("paper")


def rows_of(log, path):
    """The CSV text of a log as a list of lists of strings, header first."""
    return [line.replace('"', "").split(",") for line in write_flightlog(log, path).read_text().splitlines()]


def store(path, rows):
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    return path


def column(rows, name):
    return rows[0].index(name)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_log_comes_back_as_it_was_written(flown, paper, tmp_path, suffix):
    """Writing and reading a log changes no sample by more than the six digits of CSV."""
    again = read_flightlog(write_flightlog(flown, tmp_path / f"log.{suffix}"), paper)
    assert again.axes == POSE_ONLY
    assert not again.findings
    for there, here in zip(flown.episodes, again.episodes, strict=True):
        assert here.number == there.number
        np.testing.assert_allclose(here.t, there.t, atol=1e-6)
        np.testing.assert_allclose(here.pose[:, [0, 1, 2, 5]], there.pose[:, [0, 1, 2, 5]], atol=1e-6)
        np.testing.assert_allclose(here.commands, there.commands, atol=1e-6)
        assert np.isnan(here.pose[:, 3:5]).all()
        assert np.isnan(here.velocity).all()


def test_an_existing_file_is_not_overwritten(flown, tmp_path):
    """Writing over a log is refused."""
    path = write_flightlog(flown, tmp_path / "log.csv")
    with pytest.raises(FileExistsError, match=r"log\.csv"):
        write_flightlog(flown, path)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_log_that_cannot_be_written_leaves_nothing(flown, monkeypatch, tmp_path, suffix):
    """Half of it would take the room of the next attempt; a log that was there stays."""
    log = write_flightlog(flown, tmp_path / f"log.{suffix}")
    before = log.read_bytes()

    def broken_off(table, target):
        target.write(b"t,x")
        raise OSError("disk full")

    def broken_off_rows(columns):
        yield b"t,x"
        raise OSError("disk full")

    monkeypatch.setattr("auv_torchrl.flightlog.writer.csv_blocks", broken_off_rows)
    monkeypatch.setattr("pyarrow.parquet.write_table", broken_off)
    with pytest.raises(OSError, match="disk full"):
        write_flightlog(flown, log, replace=True)
    assert [path.name for path in tmp_path.iterdir()] == [log.name] and log.read_bytes() == before


def test_demands_go_through_the_mixer(flown, paper, tmp_path):
    """Commands per degree of freedom become thruster commands by the vehicle's mixer, clipped."""
    rng = np.random.default_rng(1)
    demand = rng.uniform(-1, 1, (400, 6))
    names = ["t", "x", "y", "z", "yaw", *(f"cmd_{name}" for name in DEGREES_OF_FREEDOM)]
    values = np.concatenate((np.arange(400)[:, None] * 0.05, flown.episodes[0].pose[:400][:, [0, 1, 2, 5]], demand), -1)
    path = store(tmp_path / "log.csv", [names, *([f"{v:.9f}" for v in row] for row in values)])
    log = read_flightlog(path, paper)
    np.testing.assert_allclose(log.episodes[0].commands, np.clip(demand @ paper.mixer.T, -1, 1), atol=1e-8)


def test_a_log_of_velocities_alone_is_read(paper, tmp_path):
    """Body velocities without a pose make a log."""
    flown = replace(simulated_logs("paper", [{}])[0], axes=("u", "v", "w", "r"))
    log = read_flightlog(write_flightlog(flown, tmp_path / "log.csv"), paper)
    assert log.axes == ("u", "v", "w", "r")
    assert np.isnan(log.episodes[0].pose).all()
    assert np.isfinite(log.episodes[0].velocity[:, [0, 1, 2, 5]]).all()


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ("t,x,y,z,heading,cmd_1", "heading"),
        ("t,x,cmd_saway,cmd_1", "did you mean cmd_sway"),
        ("x,y,cmd_1", "no column t"),
        ("t,x,y", "cmd_1 to cmd_6"),
        ("t,cmd_1,cmd_2,cmd_3,cmd_4,cmd_5,cmd_6", "measures nothing"),
        ("t,x,cmd_1,cmd_2,cmd_3,cmd_4", "the vehicle has 6 thrusters"),
        ("t,x,cmd_1,cmd_2,cmd_3,cmd_4,cmd_5,cmd_6,cmd_7,cmd_8", "the vehicle has 6 thrusters"),
        ("t,x,cmd_1,cmd_2,cmd_3,cmd_4,cmd_5,cmd_6,cmd_surge", "both"),
        ("t,x,x,cmd_1", "more than once"),
        ("t;x;y;cmd_1", "commas"),
    ],
)
def test_wrong_columns_are_refused_by_name(paper, tmp_path, names, message):
    """Missing, unknown, repeated and contradicting columns are errors that name them."""
    row = ",".join("0" for _ in names.split(","))
    (tmp_path / "log.csv").write_text(f"{names}\n{row}\n")
    with pytest.raises(FlightLogError, match=message):
        read_flightlog(tmp_path / "log.csv", paper)


def test_an_unknown_column_is_ignored_where_it_is_listed(flown, paper, tmp_path):
    """A column under extra does no harm, whatever it holds."""
    rows = rows_of(flown, tmp_path / "log.csv")
    rows = [[*row, "salinity" if i == 0 else "n/a"] for i, row in enumerate(rows)]
    store(tmp_path / "more.csv", rows)
    with pytest.raises(FlightLogError, match="salinity"):
        read_flightlog(tmp_path / "more.csv", paper)
    assert read_flightlog(tmp_path / "more.csv", paper, extra=["salinity"]).samples == flown.samples


def test_a_battery_is_ignored_where_it_is_listed(flown, paper, tmp_path):
    """A column that the format knows is ignored as others are."""
    rows = rows_of(flown, tmp_path / "log.csv")
    rows = [[*row, "battery" if i == 0 else "14.8"] for i, row in enumerate(rows)]
    log = store(tmp_path / "fed.csv", rows)
    fed, ignored = read_flightlog(log, paper), read_flightlog(log, paper, extra=["battery"])
    assert fed.episodes[0].battery is not None and ignored.episodes[0].battery is None


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty"),
        (b"\x7fELF\x02\x01\x01\x00\x00\x00", "binary"),
        (b"\xff\xfe\xfd\n\x80\x81\n", "CSV"),
        (b"PAR1 and then nothing of the kind", "Parquet"),
        (b"t,x,cmd_1,cmd_2,cmd_3,cmd_4,cmd_5,cmd_6\n", "no rows"),
    ],
)
def test_a_file_that_is_no_log_is_refused(paper, tmp_path, content, message):
    """Empty, binary and truncated files are errors of one sentence."""
    (tmp_path / "log.csv").write_bytes(content)
    with pytest.raises(FlightLogError, match=message) as error:
        read_flightlog(tmp_path / "log.csv", paper)
    assert "\n" not in str(error.value)


def test_a_missing_file_is_refused(paper, tmp_path):
    """A path without a file is an error that names it."""
    with pytest.raises(FlightLogError, match=r"nowhere\.csv"):
        read_flightlog(tmp_path / "nowhere.csv", paper)


def test_parquet_with_text_in_it_names_the_column(paper, tmp_path):
    """A Parquet column of text is reported, not guessed at."""
    n = 100
    columns = {f"cmd_{i + 1}": np.sin(np.arange(n) * 0.1 * (i + 1)) for i in range(6)}
    table = pa.table({"t": np.arange(n) * 0.05, "x": 0.1 * np.arange(n), "y": ["north"] * n, **columns})
    pyarrow.parquet.write_table(table, tmp_path / "log.parquet")
    log = read_flightlog(tmp_path / "log.parquet", paper)
    assert log.axes == ("x",)
    assert {"not_a_number", "sparse_axis"} <= {finding.code for finding in log.findings if finding.columns == ("y",)}


def test_joined_logs_keep_the_axes_in_common(flown, paper):
    """Two logs as one have all episodes, numbered anew, and say which axes got lost."""
    deeper = replace(flown, axes=("x", "y", "z"), name="other")
    both = join([flown, deeper])
    assert [episode.number for episode in both.episodes] == [0, 1, 2, 3]
    assert both.axes == ("x", "y", "z")
    assert all(np.isnan(episode.pose[:, 5]).all() for episode in both.episodes)
    assert [finding.columns for finding in both.findings if finding.severity is Severity.WARNING] == [("yaw",)]


def test_logs_of_different_vehicles_are_not_joined(flown):
    """Joining logs with different numbers of thrusters is refused."""
    with pytest.raises(FlightLogError, match="different numbers of thrusters"):
        join([flown, replace(simulated_logs("bluerov2_heavy", [{}], seconds=2.0)[0], name="heavy")])


def test_reading_takes_little_more_memory_than_the_numbers(tmp_path):
    """The blocks of a file and the columns that are made of them are never held both at once."""
    rows, names = 250_000, [f"column_{i}" for i in range(12)]
    path = tmp_path / "long.parquet"
    pyarrow.parquet.write_table(pa.table({name: np.arange(rows) + 0.5 for name in names}), path)
    tracemalloc.start()
    try:
        table = read_table(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 1.3 * sum(column.nbytes for column in (*table.columns.values(), table.row))
