"""Columns are taken for what they can only mean; others are named with what they would have to be."""

import os
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from auv_torchrl.flightlog import FlightLogError, read_flightlog
from auv_torchrl.flightlog.command import main
from auv_torchrl.flightlog.tables.columns import KNOWN
from auv_torchrl.flightlog.tables.synonyms import NOT_KNOWN, described, match, near, unclear
from auv_torchrl.flightlog.tables.table import read_table
from auv_torchrl.flightlog.understand import understand
from auv_torchrl.paths import PROJECT
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")
T = np.arange(400) * 0.05
FLOWN = {
    "t": T, "x": 0.2 * np.sin(T / 3), "y": 0.2 * np.cos(T / 4), "z": 1 + 0.3 * np.sin(T / 2), "yaw": np.sin(T / 5),
    **{f"cmd_{i}": 0.5 * np.sin(T / 2 + i) for i in range(1, 7)},
}  # fmt: skip
FOREIGN = [
    "time", "timestamp", "depth", "depth_m", "heading", "hdg", "roll_deg", "qw", "qx", "qy", "qz", "q0",
    "pwm1", "pwm_1", "servo1_raw", "altitude", "alt", "height", "lat", "lon", "vx", "vy", "vz", "speed",
    "surge", "sway", "heave", "surge_speed", "depth_rate", "climb_rate", "yaw_rate", "roll_rate", "gyro_x",
    "gyro_z", "acc_x", "accel_z", "mag_x", "pressure", "temp", "temperature", "tide", "tie", "lime", "timer",
    "salinity", "oxygen", "current", "voltage", "power", "energy", "error", "setpoint", "target_depth",
    "desired_yaw", "mode", "armed", "status", "state", "rpm", "rpm_1", "thruster_1", "thrust", "force",
    "throttle", "index", "frame", "frames", "step", "steps", "reward", "done", "reading", "leading",
    "heaving", "itch", "pith", "role", "polls", "troll", "mass", "path", "depot", "dept", "paw", "jaw", "raw",
    "saw", "law", "epoch", "batter", "T", "X", "Y", "Z", "U", "V", "W", "P", "Q", "R",
]  # fmt: skip


def stored(tmp_path, columns, name="log.csv"):
    path = tmp_path / name
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]) + "\n", encoding="utf-8")
    return path


def renamed(names, **changes):
    """The flown columns with other names and values."""
    return {names.get(key, key): changes.get(key, values) for key, values in FLOWN.items()}


def quaternion(angle):
    return {"qw": np.cos(angle / 2), "qx": 0 * angle, "qy": 0 * angle, "qz": np.sin(angle / 2)}


DATES = np.datetime64("2025-09-03T22:29:00.000") + (1000 * T).astype("timedelta64[ms]")
PULSES = {f"cmd_{i}": 1500 + 400 * FLOWN[f"cmd_{i}"] for i in range(1, 7)}
DEGREES = np.rad2deg(FLOWN["yaw"])
TAKEN = {
    "time": renamed({"t": "time"}),
    "date": renamed({"t": "timestamp"}, t=DATES),
    "date with a blank": renamed({"t": "timestamp"}, t=[str(d).replace("T", " ") for d in DATES]),
    "date with a zone": renamed({"t": "Time"}, t=[f"{d}+02:00" for d in DATES]),
    "clock": renamed({"t": "time"}, t=[str(d)[11:] for d in DATES]),
    "epoch in s": renamed({"t": "timestamp"}, t=[f"{1.7e9 + t:.3f}" for t in T]),
    "epoch in ms": renamed({"t": "timestamp"}, t=[f"{1.7e12 + 1e3 * t:.0f}" for t in T]),
    "epoch in us": renamed({"t": "t"}, t=[f"{1.7e15 + 1e6 * t:.0f}" for t in T]),
    "epoch in ns": renamed({"t": "timestamp"}, t=[f"{1700000000 * 10**9 + round(1e9 * t)}" for t in T]),
    "ms": renamed({"t": "t_ms"}, t=1e3 * T),
    "depth": renamed({"z": "Depth [m]"}),
    "feet": renamed({"z": "depth_ft"}, z=FLOWN["z"] / 0.3048),
    "yaw_deg": renamed({"yaw": "yaw_deg"}, yaw=DEGREES),
    "heading of a compass": renamed({"yaw": "Heading (°)"}, yaw=DEGREES % 360),
    "pwm": renamed({f"cmd_{i}": f"pwm{i}" for i in range(1, 7)}, **PULSES),
    "servo": renamed({f"cmd_{i}": f"servo{i}_raw" for i in range(1, 7)}, **PULSES),
    "commands": renamed({f"cmd_{i}": f"Thruster_{i}_command" for i in range(1, 7)}),
    "north": renamed({"x": "north", "y": "east_m", "z": "down"}),
    "quaternion": {**renamed({"yaw": "qw"}), **quaternion(FLOWN["yaw"])},
}  # fmt: skip


@pytest.mark.parametrize("case", TAKEN)
def test_a_name_that_can_mean_one_thing_is_read(tmp_path, case):
    """Time, depth, degrees, headings, quaternions and pulses give the log that the format's own names give."""
    log = read_flightlog(stored(tmp_path, TAKEN[case]), PAPER)
    own = read_flightlog(stored(tmp_path, FLOWN, "own.csv"), PAPER)
    assert any(finding.code == "column_taken" for finding in log.findings)
    np.testing.assert_allclose(log.episodes[0].t, own.episodes[0].t, atol=2e-6)
    np.testing.assert_allclose(log.episodes[0].pose[:, [0, 1, 2, 5]], own.episodes[0].pose[:, [0, 1, 2, 5]], atol=1e-6)
    np.testing.assert_allclose(log.episodes[0].commands, own.episodes[0].commands, atol=1e-9)


@pytest.mark.parametrize(
    ("columns", "why"),
    [
        ({**FLOWN, "depth": 10 - FLOWN["z"]}, "'depth' .z too, beside z, and says otherwise: keep one"),
        ({**renamed({"z": "altitude"})}, "'altitude' .counts upwards.*z would have to be the depth"),
        (renamed({"z": "depth"}, z=-FLOWN["z"]), "'depth' .is below 0 as a height is"),
        (renamed({"yaw": "heading"}), "'heading' .degrees or radians cannot be told: name it heading_deg"),
        (renamed({f"cmd_{i}": f"pwm{i}" for i in range(1, 7)}), "'pwm1' .lies in .*commands in .* are called cmd_n"),
        (renamed({"cmd_1": "thruster_1"}), "'thruster_1' .a command, a pulse, a force or a speed"),
        ({**FLOWN, "qw": 1 + 0 * T, "qx": 0 * T}, "a quaternion needs four columns"),
        ({**FLOWN, "vx": 0 * T}, "'vx' .body or earth is not said"),
        ({**FLOWN, "X": 0 * T}, "'X' .one capital letter may be a force"),
    ],
)  # fmt: skip
def test_a_name_that_is_not_clear_says_what_it_would_have_to_be(tmp_path, columns, why):
    """Two columns of one channel, up or down, degrees or radians, forces and frames are not guessed."""
    with pytest.raises(FlightLogError, match=why):
        read_flightlog(stored(tmp_path, columns), PAPER)


def test_a_column_that_says_the_same_twice_is_left_out_and_named(tmp_path):
    """Depth beside an equal z, an epoch beside t."""
    path = stored(tmp_path, {**FLOWN, "depth": FLOWN["z"], "timestamp": [f"{1.7e9 + t:.3f}" for t in T]})
    said = [finding.sentence for finding in read_flightlog(path, PAPER).findings if finding.code == "column_taken"]
    assert said == ["depth is left out: says the same as z", "timestamp is left out: says the same as t"]


def typos(name):
    yield from (name[:i] + name[i + 1 :] for i in range(len(name)))
    yield from (name[:i] + letter + name[i:] for i in range(len(name) + 1) for letter in "aesx_")
    yield from (name[:i] + letter + name[i + 1 :] for i in range(len(name)) for letter in "aehv")


def test_no_hint_changes_the_meaning_or_the_unit_of_a_name():
    """Over the names of the format, their slips and names that people use, a hint is a slip of the same name."""
    assert not [(name, near(name)) for name in FOREIGN if match(name) is None and near(name)]
    for known in (*KNOWN, "time", "depth", "heading"):
        for slip in typos(known):
            assert near(slip) in ("", known), slip
    assert (near("battrey"), near("rolls"), near("cmd_saway"), near("timestmp")) == (
        "battery", "roll", "cmd_sway", "timestamp",
    )  # fmt: skip


def test_every_name_is_known_or_explained_in_words():
    """A synonym leads to a channel of the format; what is not clear has a reason."""
    for name in FOREIGN:
        meant = match(name)
        if meant is not None and not meant.channel.startswith("quaternion"):
            assert described(meant.channel)
    assert unclear("salinity") == NOT_KNOWN and unclear("vx") != NOT_KNOWN


def told(capsys, *arguments):
    main(["info", *map(str, arguments)])
    return capsys.readouterr().out


def test_info_says_what_is_missing_and_offers_no_diagnosis(tmp_path, capsys):
    """A table of a depth controller: no commands; what each column is stands beside its name."""
    columns = {"t": T, "setpoint": 0 * T, "depth": FLOWN["z"], "u": 0.1 * np.sin(T), "status": ["OK"] * len(T)}
    said = told(capsys, stored(tmp_path, columns))
    assert "missing    commands" in said and "not yet" in said and "diagnose.py" not in said
    assert "velocity forward in m/s" in said and "depth in m, positive down" in said
    assert max(map(len, said.splitlines())) <= 80


@pytest.mark.parametrize("change", ["no time", "short", "frozen", "seconds apart"])
def test_info_offers_a_diagnosis_only_where_one_begins(tmp_path, capsys, change):
    """As diagnose decides, with a vehicle and without, for Parquet too."""
    columns = {
        "no time": {key: values for key, values in FLOWN.items() if key != "t"},
        "short": {key: values[:174] for key, values in FLOWN.items()},
        "frozen": {key: values if key[0] in "tc" else 0 * values for key, values in FLOWN.items()},
        "seconds apart": {**FLOWN, "t": 100 * T},
    }[change]
    path = tmp_path / "log.parquet"
    pyarrow.parquet.write_table(pa.table(columns), path)
    for vehicle in ((), ("vehicle=paper",)):
        assert "diagnose.py" not in told(capsys, path, *vehicle)
    pyarrow.parquet.write_table(pa.table(FLOWN), path)
    assert f"diagnose.py log={path} vehicle=paper" in told(capsys, path, "vehicle=paper")


def test_the_duration_is_that_of_all_episodes(tmp_path, capsys):
    """A clock that starts over in each of three episodes."""
    columns = {"episode": np.repeat([0, 1, 2], len(T)), **{key: np.tile(v, 3) for key, v in FLOWN.items()}}
    assert "3 episodes, 59.9 s" in told(capsys, stored(tmp_path, columns))


HOSTILE = {
    "400 digits in a remark": b'# auv-log: {"drift":{"x":1' + b"0" * 400 + b'},"snapshot_s":0}\nt,x\n0,0\n',
    "a deep remark": b"# auv-log: " + b"[" * 100_000 + b"\nt,x\n0,0\n",
    "400 digits": b"t,x\n0," + b"9" * 400 + b"\n1,1\n",
    "1e400": b"t,x\n1e400,1_000\n0x10," + "١٢".encode() + b"\n",
    "a long field": b"t,x\n0," + b"7" * 2_000_000 + b"\n",
    "a million columns": b"a," * 500_000 + b"b\n",
    "a header only": b"t,x,cmd_1\n",
    "NUL bytes": b"t,x\n0,\0\n",
    "mixed line ends": b"t,x\r\n0,1\n1,2\r2,3\n",
    "carriage returns alone": b"t,x\r0,1\r1,2\r",
    "a byte order mark": b"\xef\xbb\xbft,x\n0,1\n",
    "a line break in quotes": b't,x\n0,"1\n2"\n',
    "a line break in the header": b't,"x\ny"\n0,1\n',
    "UTF-16": "t,x\n0,1\n".encode("utf-16"),
    "control characters": b"t,\x1b[31mred,x\n0,1,2\n",
}  # fmt: skip


@pytest.mark.parametrize("case", HOSTILE)
def test_a_hostile_table_is_read_or_refused_in_one_line(tmp_path, capsys, case):
    """No traceback, and no control character on the terminal."""
    path = tmp_path / "log.csv"
    path.write_bytes(HOSTILE[case])
    with pytest.raises(FlightLogError) as error:
        read_flightlog(path, PAPER)
    assert "\n" not in str(error.value) and str(error.value).isprintable() and len(str(error.value)) < 2000
    try:
        said = told(capsys, path)
    except SystemExit:
        said = capsys.readouterr().err
    assert "Traceback" not in said and "\x1b" not in said


def test_digits_of_other_scripts_and_underscores_are_no_numbers(tmp_path):
    """1_000, ١٢ and 0x10 are named as entries that are no number."""
    path = tmp_path / "log.csv"
    path.write_text("t,x\n0,1_000\n1,١٢\n2,0x10\n3,4\n", encoding="utf-8")
    table = read_table(path)
    assert np.isnan(table.columns["x"][:3]).all() and table.columns["x"][3] == 4
    assert "3 entries that are no number" in table.findings[0].sentence


def test_a_file_that_would_unpack_to_gigabytes_is_refused(tmp_path):
    """Zeros that Parquet holds in a few kilobytes, and a text of a megabyte in every row."""
    zeros = pa.DictionaryArray.from_arrays(pa.array(np.zeros(2_000_000, "i4")), pa.array([0.0]))
    path = tmp_path / "zeros.parquet"
    pyarrow.parquet.write_table(pa.table({f"c{i}": zeros for i in range(12)}), path)
    with pytest.raises(FlightLogError, match="has more than .* rows of 12 columns"):
        read_table(path)
    long = pa.DictionaryArray.from_arrays(pa.array(np.zeros(100_000, "i4")), pa.array(["x" * 1_000_000]))
    pyarrow.parquet.write_table(pa.table({"t": np.arange(100_000.0), "x": long}), path)
    before = pa.total_allocated_bytes()
    assert np.isnan(read_table(path).columns["x"]).all()
    assert pa.total_allocated_bytes() - before < 50e6


def test_columns_of_lists_are_left_out_by_name(tmp_path):
    """A list in every row is no number."""
    path = tmp_path / "log.parquet"
    pyarrow.parquet.write_table(pa.table({"t": [0.0, 1.0], "points": [[1.0], [2.0, 3.0]]}), path)
    table = read_table(path)
    assert list(table.columns) == ["t"] and "points" in table.findings[0].sentence
    assert understand(table).refused == {}


def test_names_that_are_no_utf_8_are_read_and_shown_in_the_c_locale(tmp_path):
    """Info and convert with a name of odd bytes, a column in another script, and a terminal of ASCII."""
    path = os.fsencode(tmp_path) + b"/b\xff\xe9d.csv"
    with open(path, "wb") as file:
        file.write(stored(tmp_path, {**FLOWN, "über": T}).read_bytes())
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii", "PYTHONPATH": str(PROJECT)}
    for words in ([b"info", path], [b"convert", path, b"output=" + path + b".parquet"]):
        command = [sys.executable, "-m", "auv_torchrl.flightlog.command", *words]
        done = subprocess.run(command, env={**os.environ, **plain}, capture_output=True, text=True, errors="replace")
        assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
        assert r"b\xff\xe9d.csv" in done.stdout
