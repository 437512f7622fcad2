"""Files that are no logs, or logs written otherwise: the right cause is named at once, with the remedy."""

import os
import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from auv_torchrl.flightlog import FlightLogError, Severity, read_flightlog, write_flightlog
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.simulate import POSE_ONLY, simulated_logs
from tests.flightlog.test_reader import column, rows_of, store

PAPER = load_vehicle("paper")
MANY = 20_000


@pytest.fixture(scope="module")
def flown():
    """Two flights with pose and velocity."""
    return simulated_logs("paper", [{}])[0]


@pytest.fixture
def rows(flown, tmp_path):
    """The CSV text of a sound log of poses."""
    return rows_of(replace(flown, axes=POSE_ONLY), tmp_path / "sound.csv")


def text_of(rows, comma=",", point="."):
    return "\n".join(comma.join(entry.replace(".", point) for entry in row) for row in rows) + "\n"


def refusal(path):
    with pytest.raises(FlightLogError) as error:
        read_flightlog(path, PAPER)
    assert path.name in str(error.value) and "\n" not in str(error.value)
    return str(error.value)


def test_what_is_no_regular_file_is_named_at_once(tmp_path):
    """A pipe that nobody writes to, a device without end, a directory."""
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "zero.csv").symlink_to("/dev/zero")
    (tmp_path / "folder.csv").mkdir()
    for name, cause in {"pipe": "a pipe or device", "zero": "a pipe or device", "folder": "a directory"}.items():
        assert f"is {cause}: give the path of a log" in refusal(tmp_path / f"{name}.csv")


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_thousands_of_columns_are_counted_before_they_are_read(tmp_path, suffix):
    """20,000 of them cost no more memory than their names."""
    path = tmp_path / f"wide.{suffix}"
    if suffix == "csv":
        line = ",".join(f"value_{i}" for i in range(MANY))
        path.write_text(line + "\n" + (",".join(["0.0"] * MANY) + "\n") * 20)
    else:
        pyarrow.parquet.write_table(pa.table({f"value_{i}": [0.0] for i in range(MANY)}), path)
    tracemalloc.start()
    message = refusal(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert "20,000 columns, a log has 1,000 at most: give one row per sample" in message
    assert peak < 50e6


@pytest.mark.parametrize(
    ("write", "cause"),
    [
        (lambda rows: text_of(rows).encode("utf-16"), "text in UTF-16.*: save the CSV as UTF-8"),
        (lambda rows: text_of(rows).encode("utf-16-le"), "text in UTF-16.*: save the CSV as UTF-8"),
        (
            lambda rows: ("# caf\xe9\n" + text_of(rows)).encode("latin-1"),
            "not in UTF-8 .*0xe9.*: save the CSV as UTF-8",
        ),
        (lambda rows: text_of(rows, ";").encode(), "columns by semicolons, not commas: export it with commas$"),
        (lambda rows: text_of(rows, ";", ",").encode(), "semicolons.*decimal commas: .*commas and decimal points"),
        (lambda rows: text_of(rows, "\t").encode(), "columns by tabs"),
        (lambda rows: text_of(rows, "  ").encode(), "columns by blanks"),
        (
            lambda rows: (text_of(rows[:1]) + text_of(rows[1:], ",", ",")).encode(),
            r"12 columns and none of the [\d,]+ rows .* as many values, the first has \d+: .*decimal points",
        ),
        (lambda rows: text_of(rows[1:]).encode(), "has no header, its first line holds numbers: give the names"),
        (lambda rows: ("# " + text_of(rows)).encode(), "no header.*: remove the # before 'episode,t,x,y"),
        (lambda rows: b"# nothing\n\n", "nothing but remarks"),
        (lambda rows: b"PK\x03\x04" + bytes(50), "an Excel or ZIP file.*: export the log"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_another_way_of_writing_is_named(rows, tmp_path, write, cause):
    """What was expected, what came, what to do."""
    path = tmp_path / "log.csv"
    path.write_bytes(write(rows))
    message = refusal(path)
    assert re.search(cause, message), message


def test_remarks_above_the_header_are_skipped(rows, tmp_path):
    """Remarks, blank lines and Excel's line about its separator change nothing, nor do they shift the rows."""
    path = tmp_path / "log.csv"
    rows[5][column(rows, "x")] = "lost"
    rows[9] = rows[9][:-1]
    store(path, rows)
    plain = read_flightlog(path, PAPER)
    path.write_text("\n# flown on a Tuesday, by me\n   \nsep=,\n" + path.read_text())
    remarked = read_flightlog(path, PAPER)
    assert remarked.samples == plain.samples
    assert [f.rows for f in remarked.findings] == [f.rows for f in plain.findings]
    assert {"not_a_number", "ragged_rows"} <= {f.code for f in plain.findings}


@pytest.mark.parametrize("episodes", [True, False])
def test_reversed_rows_are_sorted_and_said(flown, tmp_path, episodes):
    """A file with the latest row first is the same log, with a finding that says so."""
    table = rows_of(replace(flown, axes=POSE_ONLY), tmp_path / "sound.csv")
    if not episodes:
        n = len(flown.episodes[0])
        table = [row[1:] for row in table[: n + 1]]
    store(tmp_path / "forwards.csv", table)
    there = read_flightlog(tmp_path / "forwards.csv", PAPER)
    back = read_flightlog(store(tmp_path / "backwards.csv", [table[0], *table[:0:-1]]), PAPER)
    (finding,) = [f for f in back.findings if f.code == "reversed_rows"]
    assert "time runs backwards" in finding.sentence and "Sort the rows by t" in finding.remedy
    for one, other in zip(there.episodes, back.episodes, strict=True):
        assert one.number == other.number
        np.testing.assert_array_equal(one.t, other.t)
        np.testing.assert_array_equal(one.pose, other.pose)
        np.testing.assert_array_equal(one.commands, other.commands)


def counted(log, axes, every, tmp_path):
    """The log at 20 Hz over ``every``, t counting its samples; ``every`` 20 makes a true log at 1 Hz."""
    episodes = []
    for e in log.episodes:
        n = len(e) // every * every
        commands = e.commands[:n].reshape(-1, every, e.commands.shape[1]).mean(1)
        t = np.arange(n // every) * 1.0
        episodes.append(replace(e, t=t, pose=e.pose[:n:every], velocity=e.velocity[:n:every], commands=commands))
    path = write_flightlog(replace(log, episodes=tuple(episodes), axes=axes), tmp_path / "log.csv")
    return {finding.code: finding for finding in read_flightlog(path, PAPER).findings}


@pytest.mark.parametrize("axes", [POSE_ONLY, (*POSE_ONLY, "u", "v", "w", "r")], ids=len)
@pytest.mark.parametrize("every", [1, 2])
def test_sample_numbers_as_time_are_found_out(flown, tmp_path, axes, every):
    """At 20 and 10 Hz the vehicle would move far too slowly: an error, and no other finding about units or frames."""
    findings = counted(flown, axes, every, tmp_path)
    assert findings["sample_numbers"].severity is Severity.ERROR
    assert "t counts samples, not seconds" in findings["sample_numbers"].sentence
    assert not {"degrees", "wrong_frame", "pose_velocity_disagree", "z_up"} & set(findings)


@pytest.mark.parametrize(
    "axes",
    [
        pytest.param(POSE_ONLY, marks=pytest.mark.thorough),
        (*POSE_ONLY, "u", "v", "w", "r"),
        pytest.param(("u", "v", "w", "r"), marks=pytest.mark.thorough),
    ],
    ids=str,
)
def test_a_true_log_at_one_hertz_is_no_error(tmp_path, axes):
    """Its seconds are told from sample numbers, or said to be open."""
    changes = [{}, {"thruster_gain": {f"gain_{i}": 0.2 for i in range(1, 7)}}, {"thruster_gain": {"gain_1": -1.0}}]
    for number, log in enumerate(simulated_logs("paper", changes, episodes=1, seconds=90.0)):
        (tmp_path / str(number)).mkdir()
        findings = counted(log, axes, 20, tmp_path / str(number))
        assert "sample_numbers" not in findings
        assert "whole_seconds" in findings or len(axes) > 4
