"""ArduPilot's own logs: what is read from them, and what is said of those that are cut, damaged or incomplete."""

import subprocess
import sys
import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from auv_torchrl.flightlog import FlightLogError, read_flightlog
from auv_torchrl.flightlog.readers import read_streams
from auv_torchrl.flightlog.readers.ardupilot import ardupilot, dataflash
from auv_torchrl.flightlog.streams import ReadOptions, tabulate
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.dataflash_writer import ALL, described, dive, parameters, record
from tests.flightlog.shared_data import EXCERPTS, shared
from tests.flightlog.vehicle_log import streams_of
from tests.memory import PRINT_MOST_KIB

HEAVY = load_vehicle("bluerov2_heavy")
EXCERPT = EXCERPTS / "ardusub.BIN"


def written(tmp_path, data: bytes, name: str = "00000001.BIN"):
    path = tmp_path / name
    path.write_bytes(data)
    return path


def codes(findings):
    return {finding.code for finding in findings}


def test_a_dive_becomes_rows_of_commands_pose_and_rates(tmp_path):
    """Pulses by the motor map, depth from the barometer outside, radians, rates less the bias of the filter."""
    table = tabulate(streams_of(written(tmp_path, dive())))
    columns = table.columns
    assert set(columns) >= {"x", "y", "z", "roll", "pitch", "yaw", "p", "q", "r", *(f"cmd_{n}" for n in range(1, 9))}
    assert np.ptp(np.diff(columns["t"])) < 1e-6 and len(columns["t"]) == 399
    assert table.measured is not None and table.measured.sum() == 200
    tenths = columns["t"][table.measured] * 10
    assert np.abs(tenths - np.round(tenths)).max() < 1e-6
    assert set(np.round(columns["cmd_3"], 6)) == {0.0, 0.5} and not columns["cmd_4"].any()
    assert columns["z"][0] == pytest.approx(1.0, abs=1e-3)
    assert columns["roll"] == pytest.approx(np.deg2rad(1.0)) and np.abs(columns["yaw"]).max() <= np.pi
    assert columns["p"] == pytest.approx(0.01 - np.deg2rad(1.0), abs=1e-6)
    assert columns["r"] == pytest.approx(0.05 + np.deg2rad(1.0), abs=1e-6)


def test_a_snapshot_acts_from_half_a_step_before_it(tmp_path):
    """The command that RCOU shows at 10.1 s since boot is taken to act from 5.05 s after the first record."""
    columns = tabulate(streams_of(written(tmp_path, dive()))).columns
    first = np.flatnonzero(columns["cmd_3"])[0]
    assert columns["t"][first] == pytest.approx(10.05, abs=1e-6)


def test_a_gyro_is_read_for_the_moment_at_which_it_felt(tmp_path):
    """A low pass of 20 Hz tells of a change 11 ms later; one that is off does not."""
    off, low = (
        streams_of(written(tmp_path, dive(given={**ALL, "INS_GYRO_FILTER": corner}))).streams["gyro"].t[0]
        for corner in (0, 20)
    )
    assert off - low == pytest.approx(0.01125, abs=1e-5)


def test_an_accelerometer_is_read_less_the_bias_that_the_filter_found(tmp_path):
    """Specific force of the unit in use in m/s^2, (0, 0, -9.8) at rest, as columns of the table."""
    found = record("XKF2", 5.0, 0, 0.1, -0.2, 0.05)
    streams = streams_of(written(tmp_path, dive(also={5.0: found})))
    assert streams.streams["accelerometer"].source == "IMU 0 less the bias of XKF2"
    columns = tabulate(streams).columns
    np.testing.assert_allclose([columns[axis].mean() for axis in ("ax", "ay", "az")], [-0.1, 0.2, -9.85], atol=1e-5)


def test_a_reversed_motor_direction_turns_the_command(tmp_path):
    """What the vehicle wanted of the motor is the command, whichever way its pulses go."""
    path = written(tmp_path, dive(given={**ALL, "MOT_3_DIRECTION": -1}))
    assert tabulate(streams_of(path)).columns["cmd_3"].min() == pytest.approx(-0.5)
    assert read_flightlog(path, HEAVY).autopilot["MOT_3_DIRECTION"] == -1


def test_motors_are_found_on_the_outputs_that_the_functions_say(tmp_path):
    """Motor 5 on output 3, motor 3 on output 5."""
    path = written(tmp_path, dive(given={**ALL, "SERVO3_FUNCTION": 37, "SERVO5_FUNCTION": 35}))
    columns = tabulate(streams_of(path)).columns
    assert columns["cmd_5"].max() == pytest.approx(0.5) and not columns["cmd_3"].any()


def test_what_a_log_lacks_is_asked_for_by_name_and_can_be_given(tmp_path):
    """Without parameters a sentence names them; with params the same file is read."""
    path = written(tmp_path, dive(given={"FRAME_CONFIG": 2, "MOT_PWM_MIN": 1100, "MOT_PWM_MAX": 1900}))
    with pytest.raises(FlightLogError, match=r"lacks SERVO1_FUNCTION to SERVO8_FUNCTION, MOT_1_DIRECTION to .*params="):
        read_flightlog(path, HEAVY)
    assert len(read_flightlog(path, HEAVY, options=ReadOptions(parameters=ALL)).episodes) == 1


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({**ALL, **{f"SERVO{n}_FUNCTION": 0 for n in range(1, 9)}}, "no motor is on any output"),
        ({**ALL, "MOT_2_DIRECTION": 0}, "MOT_n_DIRECTION are .* each is 1 or -1"),
        ({**ALL, "MOT_PWM_MAX": 1400}, "do not enclose 1500"),
        ({**ALL, "SERVO3_FUNCTION": 0, "SERVO30_FUNCTION": 35}, "a motor is on output 30: log that one too"),
    ],
)
def test_a_wrong_configuration_is_a_sentence(tmp_path, given, sentence):
    """Parameters that cannot be are named before anything is concluded from them."""
    with pytest.raises(FlightLogError, match=sentence):
        read_flightlog(written(tmp_path, dive(given=given)), HEAVY)


def test_another_number_of_motors_names_the_vehicles_that_fit(tmp_path):
    """A Heavy's log with the six thrusters of a BlueROV2."""
    with pytest.raises(FlightLogError, match="frame vectored_6dof, 8 motors, the vehicle file has 6 .*bluerov2_heavy"):
        read_flightlog(written(tmp_path, dive()), load_vehicle("bluerov2"))


def test_an_unarmed_log_is_refused_and_told(tmp_path):
    """Nothing was commanded, so nothing can be diagnosed; the streams are there all the same."""
    path = written(tmp_path, dive(armed=False))
    assert "depth" in streams_of(path).streams
    with pytest.raises(FlightLogError, match="not armed while commands were logged"):
        read_flightlog(path, HEAVY)


def test_a_first_event_that_disarms_means_armed_before(tmp_path):
    """A log that begins in flight."""
    streams = streams_of(written(tmp_path, dive(armed=None, also={15.0: record("EV", 15.0, 11)})))
    assert streams.armed == ((0.0, pytest.approx(10.0)),)


def test_modes_choose_their_stretches(tmp_path):
    """Ten seconds of STABILIZE out of a dive in MANUAL; a mode that was not flown is refused with those that were."""
    changes = {10.0: record("MODE", 10.0, 0, 0, 1), 20.0: record("MODE", 20.0, 19, 19, 1)}
    path = written(tmp_path, dive(also=changes))
    t = tabulate(streams_of(path), ReadOptions(modes=("STABILIZE",))).columns["t"]
    assert t[0] == pytest.approx(5.0) and t[-1] == pytest.approx(14.95)
    with pytest.raises(FlightLogError, match="not flown in AUTO: give modes out of MANUAL, STABILIZE"):
        tabulate(streams_of(path), ReadOptions(modes=("AUTO",)))


def test_a_clock_that_starts_over_is_put_in_order(tmp_path):
    """Two starts in one file: times rise, and the finding says so."""
    streams = streams_of(written(tmp_path, dive() + dive()))
    assert codes(streams.findings) == {"clock_reset"} and streams.armed is not None and len(streams.armed) == 2
    assert len(streams.streams["outputs"]) == 400 and np.diff(streams.streams["outputs"].t).min() > 0


def test_other_data_in_a_file_is_skipped_and_counted(tmp_path):
    """A kilobyte of something else between two records costs no record."""
    data = dive()
    middle = data.index(record("EV", 5.0, 10))
    rng = np.random.default_rng(0)
    streams = streams_of(written(tmp_path, data[:middle] + rng.bytes(1000) + data[middle:]))
    assert codes(streams.findings) == {"damaged_file"} and len(streams.streams["outputs"]) == 200
    assert "1,000 of" in streams.findings[0].sentence


def test_the_lane_in_use_is_followed(tmp_path):
    """Where the filter goes over to lane 1, its position is taken, and the moment is named."""
    data = described("XKF1", "XKF4") + parameters({}, 0)
    for k in range(100):
        t, lane = 1 + k / 10, int(k >= 50)
        for c in (0, 1):
            data += record("XKF4", t, c, 0b11111, lane)
            data += record("XKF1", t, c, 0, 0, 0, 10.0 * c, 0, 0, 0, 0, 0)
    streams = streams_of(written(tmp_path, data))
    assert streams.streams["position"].values[:, 0].tolist() == [0.0] * 50 + [10.0] * 50
    assert "5.0 s" in next(f for f in streams.findings if f.code == "lane_switch").sentence


def test_a_filter_that_stands_still_gives_no_position(tmp_path):
    """Constant position mode: zeros that are none, so that only depth is left."""
    data = described("XKF1", "XKF4")
    for k in range(20):
        data += record("XKF4", k / 10, 0, 0b10011111, 0) + record("XKF1", k / 10, 0, 0, 0, 0, 0, 0, 3.0, 0, 0, 0)
    place = streams_of(written(tmp_path, data)).streams["position"].values
    assert np.isnan(place[:, :2]).all() and (place[:, 2] == 3.0).all()


def test_a_filter_without_lanes_tells_which_barometer_is_outside(tmp_path):
    """As text, from a firmware whose XKF1 names no lane, and that writes no CTUN."""
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines += ["FMT, 129, 20, BARO, QBf, TimeUS,I,Alt", "FMT, 130, 20, XKF1, Qf, TimeUS,PD"]
    for k in range(50):
        lines += [f"BARO, {k}00000, 0, 0.5", f"BARO, {k}00000, 1, {-0.1 * k}", f"XKF1, {k}00000, {0.1 * k}"]
    path = written(tmp_path, "\n".join(lines).encode(), "flight.log")
    assert streams_of(path).streams["depth"].source == "BARO 1"


def test_doppler_steps_become_velocities_at_the_middle_of_their_time(tmp_path):
    """0.1 m in 0.2 s is 0.5 m/s, 0.1 s before it was told."""
    data = described("VISO") + b"".join(record("VISO", 1 + k / 5, 0.2, 0.1, 0.0, -0.05) for k in range(9))
    dvl = streams_of(written(tmp_path, data)).streams["dvl"]
    assert dvl.values[3] == pytest.approx([0.5, 0.0, -0.25]) and dvl.t[1] - dvl.t[0] == pytest.approx(0.2)


@pytest.mark.parametrize("suffix", ["BIN", "log", "tlog", "ulg", "mcap", "bag", "db3", "csv", "parquet"])
def test_a_pointer_is_no_log(tmp_path, suffix):
    """What git leaves where the file itself was not fetched, whatever it is called."""
    pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 3\n"
    for text, by in ((pointer, "git-lfs"), (b"/annex/objects/SHA256E-s3--0.BIN\n", "git-annex")):
        with pytest.raises(FlightLogError, match=f"a pointer of {by} and not the log itself: fetch it"):
            read_flightlog(written(tmp_path, text, f"flight.{suffix}"), HEAVY)


def test_a_log_that_was_cut_is_read_to_its_end(tmp_path):
    """Two thirds of a dive, cut within a record."""
    data = dive()
    path = written(tmp_path, data[: len(data) * 2 // 3 + 5])
    log = read_flightlog(path, HEAVY)
    assert 11 < log.duration < 14


def test_two_logs_in_one_another_are_told_apart_by_their_clocks(tmp_path):
    """Pieces of two dives in turn: rows of both, and findings that say what the file is."""
    one, other = dive(), dive(begin=900.0)
    size = len(one) // 8
    pieces = (data[k * size : (k + 1) * size] for k in range(9) for data in (one, other))
    log = read_flightlog(written(tmp_path, b"".join(pieces)), HEAVY)
    assert {"clock_reset", "damaged_file"} <= codes(log.findings) and log.duration > 5


def test_a_file_that_is_named_like_a_log_and_is_none_is_refused(tmp_path):
    """By its first bytes."""
    with pytest.raises(FlightLogError, match="no ArduPilot DataFlash log although it is named so"):
        read_flightlog(written(tmp_path, b"hello" * 10), HEAVY)


def test_columns_are_those_of_pymavlink(tmp_path):
    """Every record and value of the excerpt, against the reference implementation."""
    reader = pytest.importorskip("pymavlink.DFReader").DFReader_binary(str(EXCERPT))
    theirs: dict[str, list] = {}
    while (message := reader.recv_msg()) is not None:
        theirs.setdefault(message.get_type(), []).append(message)
    reader.filehandle.close()
    ours = dataflash.read_messages(EXCERPT, ardupilot.WANTED)
    for name, fields in ardupilot.WANTED.items():
        assert len(ours.types.get(name, {"t": ()})["t"]) == len(theirs.get(name, ())), name
        for field in set(fields) & set(ours.types.get(name, {})):
            mine = [v.decode() if isinstance(v, bytes) else v for v in ours.types[name][field].tolist()]
            assert mine == [getattr(message, field) for message in theirs[name]], (name, field)


def test_the_excerpt_of_the_firmware_is_read():
    """Twelve seconds that ArduSub 4.7 wrote of its own simulated flight, with motor 1 set to turn backwards."""
    streams = streams_of(EXCERPT)
    assert streams.vehicle.frame == "vectored_6dof" and streams.vehicle.parameters["MOT_1_DIRECTION"] == -1
    log = read_flightlog(EXCERPT, HEAVY)
    assert log.axes == ("x", "y", "z", "roll", "pitch", "yaw", "p", "q", "r", "ax", "ay", "az") and log.duration > 11
    assert np.abs(log.episodes[0].commands).max() > 0.2


def test_text_and_binary_logs_say_the_same(tmp_path):
    """The excerpt as mavlogdump would write it."""
    binary = dataflash.read_messages(EXCERPT, ardupilot.WANTED)
    lines = [(-1, f"FMT, 1, 1, {name}, x, {','.join(_fields(name, c))}") for name, c in binary.types.items()]
    lines.insert(0, (-1, "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"))
    for name, columns in binary.types.items():
        fields = _fields(name, columns)
        texts = [
            np.char.decode(columns[f]) if columns[f].dtype.kind == "S" else columns[f].astype(str) for f in fields[1:]
        ]
        times = (columns["t"] * 1e6).round().astype(int).astype(str)
        lines += zip(columns["t"], (", ".join([name, *row]) for row in zip(times, *texts, strict=True)), strict=True)
    lines.sort(key=lambda line: line[0])
    path = tmp_path / "flight.log"
    path.write_text("\n".join(line for _, line in lines) + "\n")
    one, other = (tabulate(streams_of(file)).columns for file in (EXCERPT, path))
    assert set(one) == set(other)
    for name in one:
        assert other[name] == pytest.approx(one[name], abs=1e-5, nan_ok=True), name


def _fields(name, columns):
    return ["TimeUS", *(field for field in ardupilot.WANTED[name] if field in columns)]


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_damage_ends_in_a_traceback(tmp_path, data):
    """Cut anywhere, bytes changed anywhere: rows or a sentence, never another error."""
    content = bytearray(EXCERPT.read_bytes())
    begin = data.draw(st.integers(0, 3000) | st.just(0))
    end = data.draw(st.integers(begin, len(content)))
    for place in data.draw(st.lists(st.integers(0, len(content) - 1), max_size=40)):
        content[place] = data.draw(st.integers(0, 255))
    path = written(tmp_path, bytes(content[begin:end]))
    try:
        streams = read_streams(path)
        if streams is not None:  # without its first bytes it is no log of a vehicle's own
            tabulate(streams)
    except FlightLogError as error:
        assert path.name in str(error) or "MOT_" in str(error) or "motor" in str(error)


def test_a_hundred_megabytes_are_read_in_little_memory(tmp_path):
    """A fourteenth of the required speed is asked for here, since other work shares the machine; 0.4 GB at most."""
    whole = shared("ardusub_sitl/healthy_a.BIN").read_bytes()
    path = written(tmp_path, whole * 3)
    tracemalloc.start()
    begin = time.perf_counter()
    streams_of(path)
    assert time.perf_counter() - begin < 30
    assert tracemalloc.get_traced_memory()[1] < 0.4e9
    tracemalloc.stop()


@pytest.mark.thorough
def test_two_gigabytes_are_read_in_less_memory(tmp_path):
    """By a process of its own, which holds nothing else."""
    whole = shared("ardusub_sitl/healthy_a.BIN").read_bytes()
    path = tmp_path / "long.BIN"
    with path.open("wb") as file:
        for _ in range(2_000_000_000 // len(whole)):
            file.write(whole)
    read = (
        "import sys; from auv_torchrl.flightlog.readers import read_streams; read_streams(sys.argv[1])\n"
        + PRINT_MOST_KIB
    )
    try:
        done = subprocess.run([sys.executable, "-c", read, str(path)], capture_output=True, text=True, check=True)
    finally:
        path.unlink()
    assert int(done.stdout) * 1024 < 2e9


def test_the_real_dive_asks_for_its_parameters_and_is_read_with_them():
    """A BlueROV2 Heavy in the sea, whose owner filtered the log down to two parameters."""
    path = shared("ardusub_real/guided_00000029_filtered.BIN")
    streams = streams_of(path)
    assert streams.streams["depth"].source == "BARO 1" and streams.armed is None
    with pytest.raises(FlightLogError, match="lacks FRAME_CONFIG, SERVO1_FUNCTION"):
        tabulate(streams)
    signs = dict(zip(range(1, 9), (-1, -1, 1, 1, -1, 1, 1, -1), strict=True))
    given = {**ALL, **{f"MOT_{n}_DIRECTION": sign for n, sign in signs.items()}}
    log = read_flightlog(path, HEAVY, options=ReadOptions(parameters=given))
    assert {"x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w"} <= set(log.axes) and log.duration > 190
    felt = np.concatenate([e.acceleration for e in log.episodes if e.acceleration is not None])
    assert {"ax", "ay", "az"} <= set(log.axes) and np.abs(felt.mean(0) - [0.0, 0.0, -9.81]).max() < 0.2
