"""The command auv-log, and what holds for every reader."""

import importlib.metadata
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl import registry
from auv_torchrl.flightlog import FlightLogError, read_flightlog
from auv_torchrl.flightlog.command import main
from auv_torchrl.flightlog.info import info_lines, table_lines
from auv_torchrl.flightlog.job import fitted
from auv_torchrl.flightlog.readers import READERS, Reader, choose_reader
from auv_torchrl.flightlog.streams.grid import row_times, sampled
from auv_torchrl.flightlog.streams.options import read_options
from auv_torchrl.flightlog.streams.stream import ReadOptions, Sampling, Streams, VehicleFacts, by_name, stream
from auv_torchrl.flightlog.tables.table import read_table
from auv_torchrl.paths import EXAMPLE_LOG, PROJECT
from auv_torchrl.text import printable
from auv_torchrl.vehicle import load_vehicle
from tests.few_thrusters import FEW
from tests.flightlog.dataflash_writer import dive, flown
from tests.flightlog.shared_data import EXCERPTS
from tests.flightlog.simulate import simulated_logs
from tests.flightlog.vehicle_log import streams_of

EXCERPT = EXCERPTS / "ardusub.BIN"


def refused(capsys, *arguments: str) -> str:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    said = capsys.readouterr().err
    assert ended.value.code == 2 and said.startswith("auv-log: ") and said.count("\n") == 1
    return said


def test_info_says_what_is_in_a_log(capsys):
    """Frame, motors, modes, arming, streams with their rates, and what could be diagnosed."""
    main(["info", str(EXCERPT), str(EXAMPLE_LOG)])
    said = capsys.readouterr().out
    for part in (
        "vectored_6dof, 8 motors", "MOT_n_DIRECTION -1: 1;", "MANUAL 0.0 to 93.1 s", "armed      218.4 s",
        "p q r [rad/s], 25 Hz, 300 samples, measured: IMU 0", "rows of x y z roll pitch yaw p q r", "flight.csv: table",
    ):  # fmt: skip
        assert part in said, part


@pytest.mark.parametrize(("share", "offered"), [(1.0, "rows of"), (0.05, "none: no thruster turns in it")])
def test_info_offers_a_diagnosis_where_thrusters_turn(share, offered, tmp_path):
    """Of a flight, and of the same with its outputs within the dead band of speed controllers."""
    log = simulated_logs("paper", [{}], episodes=1, seconds=20.0, seed=5)[0]
    (episode,) = log.episodes
    path = tmp_path / "dive.BIN"
    path.write_bytes(flown(replace(log, episodes=(replace(episode, commands=share * episode.commands),))))
    (line,) = (line for line in info_lines(streams_of(path)) if "diagnosis " in line)
    assert offered in line


@settings(deadline=None, max_examples=40)
@given(name=st.text(), samples=st.integers(1, 3), gaps=st.integers(0, 2), unit=st.sampled_from(("1", "m", "rad")))
def test_the_lines_of_a_stream_are_bounded_and_in_the_singular_of_one(name, samples, gaps, unit):
    """Whatever a source is called: no line acts on a terminal, none says "1 samples", and a unit of 1 is none."""
    t = np.concatenate([np.arange(20) * 0.1 + 100 * part for part in range(gaps + 1)])
    streams = by_name([
        stream("commands", ("1", "2"), unit, t, np.zeros((len(t), 2)), Sampling.HELD, name * 30),
        stream("depth", "z", "m", np.arange(samples), np.ones((samples, 1)), Sampling.MEASURED, name),
    ])  # fmt: skip
    lines = list(info_lines(Streams(name, "MCAP", streams, VehicleFacts(name, name, motors=1), modes=((0.0, name),))))
    for line in lines:
        assert all(len(row) <= 80 or " " not in row.strip() for row in fitted(line).split("\n"))
        assert not re.search(r"\b1 (samples|gaps|motors|rows)\b|\[1\]", line) and printable(line, None) == line


@settings(deadline=None, max_examples=15)
@given(
    ragged=st.integers(0, 2), empty=st.integers(0, 2), beyond=st.integers(0, 2), back=st.integers(0, 2),
    words=st.integers(0, 2), alone=st.integers(1, 3),
)  # fmt: skip
def test_findings_about_a_table_know_the_singular(tmp_path_factory, ragged, empty, beyond, back, words, alone):
    """Rows that are cut, empty, out of range, no numbers, too early or by themselves: of one there is a singular."""
    rows = [[f"{0.05 * i:.2f}", f"{np.sin(i / 30):.4f}", f"{np.cos(i / 20):.4f}"] for i in range(400)]
    rows += [[f"{50 + 0.05 * i:.2f}", "0", "0"] for i in range(alone)]
    lines = [row.copy() for row in rows]
    for i in range(2):
        lines[20 + i] = lines[20 + i][: 2 if i < ragged else 3]
        lines[50 + i][1] = "" if i < empty else lines[50 + i][1]
        lines[80 + i][2] = "7" if i < beyond else lines[80 + i][2]
        lines[110 + i][0] = lines[109][0] if i < back else lines[110 + i][0]
        lines[140 + i][1] = "wet" if i < words else lines[140 + i][1]
    path = tmp_path_factory.mktemp("rows") / "log.csv"
    path.write_text("t,z,cmd_1\n" + "".join(",".join(line) + "\n" for line in lines))
    said = [
        *map(str, read_flightlog(path, load_vehicle(FEW["torpedo"][0])).findings),
        *table_lines(read_table(path), path),
    ]
    assert not [line for line in said if re.search(r"\b1 (rows|entries|values|columns|episodes|times)\b", line)]
    assert sum("row lacks" in line for line in said) == (empty + words == 1)


def test_convert_writes_what_the_diagnosis_reads(tmp_path, capsys):
    """The table reads back as the log itself does, in both formats; what is there is not overwritten."""
    vehicle = load_vehicle("bluerov2_heavy")
    direct = read_flightlog(EXCERPT, vehicle).episodes[0]
    for suffix in ("csv", "parquet"):
        path = tmp_path / f"log.{suffix}"
        main(["convert", str(EXCERPT), f"output={path}"])
        again = read_flightlog(path, vehicle).episodes[0]
        assert again.pose == pytest.approx(direct.pose, abs=1e-5)
        assert again.commands == pytest.approx(direct.commands, abs=1e-5)
    capsys.readouterr()
    assert "exists" in refused(capsys, "convert", str(EXCERPT), f"output={tmp_path / 'log.csv'}")


def test_convert_keeps_what_the_log_says_of_its_samples(tmp_path, capsys):
    """Snapshots of commands, drift of estimates, rows without a sample and parameters: without them a log is wrong."""
    vehicle = load_vehicle("bluerov2_heavy")
    direct = read_flightlog(EXCERPT, vehicle)
    assert direct.errors.snapshot_s > 0 and direct.autopilot
    for suffix in ("csv", "parquet"):
        path = tmp_path / f"log.{suffix}"
        main(["convert", str(EXCERPT), f"output={path}"])
        again = read_flightlog(path, vehicle)
        assert (again.errors, again.autopilot) == (direct.errors, direct.autopilot)
        for one, other in zip(again.episodes, direct.episodes, strict=True):
            assert one.filled == pytest.approx(other.filled)


def test_a_remark_of_convert_that_is_damaged_is_refused(tmp_path):
    """What it says of the samples is not left out in silence."""
    path = tmp_path / "log.csv"
    main(["convert", str(EXCERPT), f"output={path}"])
    path.write_text(path.read_text().replace('"drift"', '"drfit"', 1))
    with pytest.raises(FlightLogError, match="convert the log again"):
        read_flightlog(path, load_vehicle("bluerov2_heavy"))


def test_what_the_command_cannot_do_is_one_line(tmp_path, capsys):
    """No file, no format, no such action, no such key."""
    assert "none of info, convert" in refused(capsys, "show", str(EXCERPT))
    assert "give a log" in refused(capsys, "info")
    assert "says no format" in refused(capsys, "convert", str(EXCERPT), "output=log")
    assert "no key 'outpt'" in refused(capsys, "convert", str(EXCERPT), "outpt=log.csv")
    missing = refused(capsys, "info", str(tmp_path / "none.BIN"))
    assert missing.endswith("none.BIN: No such file or directory: give the path of a log\n")
    (tmp_path / "none.BIN").touch()
    assert "is empty: give a log that holds samples" in refused(capsys, "info", str(tmp_path / "none.BIN"))


@pytest.mark.parametrize("arguments", ["", "help", "--help", "info --help", "convert dive.BIN -h"])
def test_help_is_given_wherever_it_is_asked_for(capsys, arguments):
    """Before an action and behind one."""
    main(arguments.split())
    assert capsys.readouterr().out.startswith("What is in a log of a vehicle")


@pytest.mark.parametrize(
    "text", ["MOT_1_DIRECTION,-1\n", "# saved\nMOT_1_DIRECTION -1.0\n", "# x\n1\t1\tMOT_1_DIRECTION\t-1\t6\n"]
)
def test_parameters_are_read_as_ground_stations_save_them(tmp_path, text):
    """Mission Planner, MAVProxy, QGroundControl; and as a mapping on the command line."""
    path = tmp_path / "vehicle.param"
    path.write_text(text)
    for given_ in (str(path), "{MOT_1_DIRECTION: -1}", {"MOT_1_DIRECTION": -1}):
        assert read_options(params=given_).parameters == {"MOT_1_DIRECTION": -1.0}
    with pytest.raises(FlightLogError, match="which is no number"):
        read_options(params="{MOT_1_DIRECTION: left}")


def test_every_reader_stands_in_the_documents_and_takes_other_files_for_none():
    """docs/reference/log-formats.md names the suffixes; no reader recognizes a table or nothing at all."""
    page = (PROJECT / "docs" / "reference" / "log-formats.md").read_text()
    table = Path(EXAMPLE_LOG).read_bytes()[:4096]
    for reader in READERS.values():
        assert all(f"`{suffix}`" in page for suffix in reader.suffixes if suffix != ".bin"), reader.name
        assert not reader.recognizes(table) and not reader.recognizes(b"") and not reader.recognizes(b"PAR1")


def test_a_package_brings_a_reader_by_an_entry_point(monkeypatch, tmp_path):
    """It takes the files that it recognizes; one whose name is taken is refused."""

    def read(path: Path, options: ReadOptions) -> Streams:
        raise AssertionError("it is chosen, and not read")

    mine = Reader("my log", (".mine",), lambda head: head.startswith(b"MINE"), read)
    entry = importlib.metadata.EntryPoint("mine", "tests.nowhere:READER", READERS.group)
    monkeypatch.setattr(type(entry), "load", lambda self: mine)
    monkeypatch.setattr(registry, "entry_points", lambda group: [entry])
    known = registry.Registry("readers", Reader, READERS.values(), name=".+")
    (tmp_path / "a.log").write_bytes(b"MINE")
    assert choose_reader(tmp_path / "a.log", known) is mine
    with pytest.raises(ValueError, match="there is one of that name already"):
        list(registry.Registry("readers", Reader, [mine], name=".+"))


times = st.lists(st.floats(0.02, 0.2), min_size=3, max_size=60).map(lambda steps: np.cumsum([0.0, *steps]))


@given(times, times, st.floats(-2, 2), st.floats(-2, 2))
def test_a_straight_line_stays_one_at_any_times(taken, rows, offset, slope):
    """Interpolated or not, whatever the clocks; nothing is told outside of what was measured."""
    line = stream("depth", "z", "m", taken, (offset + slope * taken)[:, None], Sampling.MEASURED, "")
    assert line is not None
    told = sampled(line, "z", rows, 1e-9)  # rows closer than any samples: no averages
    inside = np.isfinite(told)
    assert told[inside] == pytest.approx((offset + slope * rows)[inside], abs=1e-9)
    assert not inside[rows > taken[-1]].any()


@given(times, st.floats(0.01, 0.3))
def test_rows_follow_the_commands(taken, interval):
    """Every command acts, in order; snapshots from before their time on, held ones from their time on."""
    for sampling in (Sampling.HELD, Sampling.SNAPSHOT):
        sent = stream("commands", ["cmd_1"], "1", taken, np.arange(len(taken))[:, None], sampling, "")
        assert sent is not None
        t, row = row_times(sent, interval)
        assert (np.diff(t) > 0).all() and set(row) == set(range(len(taken))) and (np.diff(row) >= 0).all()
        first = t[np.searchsorted(row, np.arange(len(taken)))]
        assert (first <= taken).all() if sampling is Sampling.SNAPSHOT else first == pytest.approx(taken)


def test_a_pause_is_not_filled(tmp_path):
    """Between samples that are seconds apart nothing was measured."""
    t = np.concatenate((np.arange(0, 2, 0.1), np.arange(6, 8, 0.1)))
    told = stream("depth", "z", "m", t, t[:, None], Sampling.MEASURED, "")
    assert told is not None and len(told.gaps) == 1
    assert np.isnan(sampled(told, "z", np.arange(2.0, 5.9, 0.1), 0.1)).all()


def test_the_heading_is_not_averaged_across_north():
    """Between 359 and 1 degrees lies 0."""
    yaw = np.deg2rad(np.tile([359.0, 1.0], 20))[:, None]
    told = stream("attitude", ["yaw"], "rad", np.arange(40) / 20, yaw, Sampling.ESTIMATED, "")
    assert told is not None
    assert np.abs(sampled(told, "yaw", np.arange(0.1, 1.8, 0.2), 0.2)).max() < np.deg2rad(1.1)


def test_diagnose_takes_the_options_of_a_log():
    """modes, params and system stand in its configuration and its help."""
    text = (PROJECT / "conf" / "diagnose.yaml").read_text()
    assert all(re.search(rf"^{key}:", text, re.M) for key in ("modes", "params", "system"))


def test_other_units_are_not_looked_for_where_the_format_says_them(tmp_path):
    """Thrusters that are three times too strong in the vehicle file make no feet of a vehicle's metres."""
    path = tmp_path / "00000001.BIN"
    path.write_bytes(dive())
    codes = {finding.code for finding in read_flightlog(path, load_vehicle("bluerov2_heavy")).findings}
    assert not codes & {"length_unit", "speed_unit", "time_unit", "degrees", "sample_numbers"}
