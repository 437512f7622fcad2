"""Whatever a log of any format holds, reading it gives a result or one printable line, in bounded memory and time."""

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity, quoted
from auv_torchrl.flightlog.streams.stream import Sampling, stream
from tests.flightlog.dataflash_writer import dive
from tests.flightlog.fuzz.contract import read_or_refuse, shows, written
from tests.flightlog.fuzz.damage import Log
from tests.flightlog.fuzz.formats import FORMATS
from tests.flightlog.fuzz.ros import sound_bag
from tests.flightlog.vehicle_log import streams_of


@pytest.mark.parametrize("name", FORMATS)
def test_any_log(pytestconfig, name):
    """Logs of a format with fields, records and bytes altered; ``--draws`` makes more of them."""

    @settings(
        max_examples=pytestconfig.getoption("--draws"),
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
    @given(st.data())
    def read(data):
        with TemporaryDirectory() as folder:
            read_or_refuse(written(data.draw(FORMATS[name]()), Path(folder)))

    read()


def test_a_bag_whose_name_is_no_utf_8_is_read(tmp_path):
    """The library takes the name as bytes."""
    folder = sound_bag("sqlite3")
    path = written(Log("\udcff\udcfe", folder), tmp_path)
    assert streams_of(path).streams


def test_a_database_whose_error_is_no_utf_8_is_refused_in_a_line(tmp_path):
    """The library quotes the damaged statement in what it says."""
    folder = sound_bag("sqlite3")
    damaged = folder["flight.db3"].replace(b"CREATE TABLE topics", b"CREATE TABL\xbf topics")
    assert read_or_refuse(written(Log("flight", {**folder, "flight.db3": damaged}), tmp_path)) == "refused, no rows"


def test_an_error_quotes_three_findings_of_many():
    """And counts the others."""
    findings = [Finding(Severity.WARNING, f"code_{n}", f"sentence {n}") for n in range(9)]
    assert quoted(findings).count("sentence") == 3 and quoted(findings).endswith("and 6 more findings")


@given(st.text(), st.integers(1, 3000))
def test_errors_and_findings_are_one_line_of_bounded_length(text, times):
    """Whatever a file holds, its error begins with its cause, ends in its remedy and fits half a screen."""
    said = f"log.csv has {text * times}: mend it"
    finding = Finding(Severity.WARNING, "code", said, said)
    for line in (str(FlightLogError(said)), finding.sentence, finding.remedy):
        assert line.startswith("log.csv has ") and line.endswith(": mend it") and len(line) <= 1000
        assert len(line.splitlines()) == 1 and shows(line)


def test_the_name_of_a_topic_is_shown_without_its_control_characters():
    """A stream says where it comes from."""
    made = stream("depth", "z", "m", [0.0], [[1.0]], Sampling.MEASURED, "/a\r\x1b[31m")
    assert made is not None and shows(made.source)


def test_half_floats_are_compared_with_what_is_larger_than_any(tmp_path):
    """A field of half precision, which the description of a message may have, says nothing of the others."""
    data = dive(seconds=3.0)
    described = data.replace(b"QBf\0", b"QBg\0", 1)
    records = described.replace(b"\xa3\x95\x80\x11" + bytes((16,)), b"\xa3\x95\x80\x11" + bytes((14,)), 1)
    assert read_or_refuse(written(Log("flight.BIN", records), tmp_path))


def test_times_that_go_back_often_and_repeat_now_and_then_still_rise(tmp_path):
    """Each start over is an episode, in which no time is twice."""
    times = [0.05 * k for _ in range(12) for k in range(12)]
    times[5] = times[4]
    names = ["t", "x", "y", "z", "yaw", *(f"cmd_{n}" for n in range(1, 9))]
    lines = [
        ",".join(names),
        *(",".join([f"{t:.5g}", *(f"{t * n / 10:.5g}" for n in range(1, len(names)))]) for t in times),
    ]
    path = written(Log("flight.csv", "\n".join(lines).encode()), tmp_path)
    assert read_or_refuse(path).endswith(", rows")
