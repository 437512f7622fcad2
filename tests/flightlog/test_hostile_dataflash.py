"""ArduPilot's logs with damaged descriptions, numbers that are none, texts that act, and other vehicles."""

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from auv_torchrl.effects.advice import thruster_gain
from auv_torchrl.flightlog import FlightLogError, read_flightlog
from auv_torchrl.flightlog.command import main
from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.info import info_lines
from auv_torchrl.flightlog.readers.ardupilot import ardupilot, dataflash_text
from auv_torchrl.flightlog.streams import ReadOptions, tabulate
from auv_torchrl.flightlog.streams.configuration import compare_configuration, to_set
from auv_torchrl.flightlog.streams.drift import ANGLE_DRIFT, drift_of
from auv_torchrl.flightlog.streams.options import read_options
from auv_torchrl.flightlog.streams.parameters import PARAMETERS, known, parameter
from auv_torchrl.flightlog.streams.stream import Kind, Sampling, Streams, VehicleFacts, stream
from auv_torchrl.flightlog.streams.vehicle_kind import check_kind, kind_of_text, kind_of_type
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.dataflash_writer import ALL, FORMS, described, dive, record
from tests.flightlog.vehicle_log import streams_of
from tests.memory import PRINT_MOST_KIB

HEAVY = load_vehicle("bluerov2_heavy")
TYPE, LENGTH, NAME, FORMAT, COLUMNS = 3, 4, 5, 9, 25  # bytes of a FMT record


def written(tmp_path, data: bytes, name: str = "00000001.BIN"):
    path = tmp_path / name
    path.write_bytes(data)
    return path


def with_byte(name: str, place: int, value: int | bytes, log: bytes | None = None) -> bytes:
    """A dive in whose description of a message one byte, or several, are others."""
    sound = described(name)
    put = bytes([value]) if isinstance(value, int) else value
    return (dive() if log is None else log).replace(sound, sound[:place] + put + sound[place + len(put) :], 1)


def sentences(findings) -> str:
    return "\n".join(map(str, findings))


@pytest.mark.parametrize(
    ("name", "place", "value", "damage"),
    [
        ("ATT", FORMAT + 1, ord("n"), "it says that a record has 17 bytes"),
        ("XKF1", FORMAT + 5, ord("n"), "it says that PN is text"),
        ("IMU", FORMAT + 2, ord("n"), "it says that GyrX is text"),
        ("BARO", FORMAT + 2, ord("\x06"), r"nothing has the type '\x06'"),
        ("ATT", COLUMNS + 6, ord("k"), "it has 3 columns and types for 4"),
        ("ATT", COLUMNS + 7, ord("S"), "it has a column Soll in place of Roll"),
        ("BARO", COLUMNS, ord("D"), "it has a column DimeUS in place of TimeUS"),
        ("XKF1", COLUMNS + 7, ord("A"), "it has a column A in place of C"),
        ("IMU", COLUMNS + 12, ord("Y"), "two of its columns have one name"),
        ("CTUN", LENGTH, 16, "it says that a record has 16 bytes, its columns have 15"),
        ("RCOU", NAME, ord("r"), "its name is 'rCOU'"),
        ("RCOU", NAME + 1, 0x83, r"its name is 'R\x83OU'"),
        ("RCOU", NAME + 2, 0x1B, r"its name is 'RC\x1bU'"),
        ("RCOU", TYPE, 77, "it gives it the type 77, and 200 records of its length have the type 13"),
        ("MSG", FORMAT + 1, ord("a"), "it says that Message is an array"),
    ],
)
def test_a_message_whose_description_is_damaged_is_left_out_and_named(tmp_path, name, place, value, damage):
    """One byte of a FMT record: the message and the damage are named, the others are read."""
    streams = streams_of(written(tmp_path, with_byte(name, place, value)))
    found = [finding for finding in streams.findings if finding.code == "damaged_description"]
    assert [f"message {name} is damaged, {damage}" in f.sentence for f in found] == [True], sentences(streams.findings)
    assert "depth" in streams.streams or name in ("BARO", "CTUN")
    if name == "RCOU":
        with pytest.raises(FlightLogError, match="no outputs of thrusters that can be read.* RCOU is damaged"):
            tabulate(streams)


@pytest.mark.parametrize("names", [("NKF1", "XKF1"), ("RCI2", "RCO2"), ("BAR2", "BARO"), ("XKQ1", "XKQ")])
def test_names_that_firmware_gives_are_no_damage(tmp_path, names):
    """A log without a message, but with one of nearly its name and fields, which other firmware writes."""
    given, meant = names
    kind, types, columns = FORMS.get(meant, (90, "QHH", "TimeUS,C15,C16"))
    form = described("ATT")[:TYPE] + bytes([kind]) + described("ATT")[LENGTH:]
    form = form[:LENGTH] + bytes([15]) + given.encode().ljust(4, b"\0")
    form += b"QHH".ljust(16, b"\0") + columns.encode().ljust(64, b"\0")
    log = with_byte(meant, 0, form, dive()) if meant in FORMS else form + dive()
    assert "damaged, its name" not in sentences(streams_of(written(tmp_path, log)).findings)


def test_a_damaged_repetition_of_a_description_changes_nothing(tmp_path):
    """What was described soundly before is read by that."""
    again = with_byte("RCOU", FORMAT + 3, ord("n"), described("RCOU"))
    streams = streams_of(written(tmp_path, dive(also={15.0: again})))
    assert len(streams.streams["outputs"]) == 200
    assert "RCOU is read as it is described elsewhere" in sentences(streams.findings)


def test_a_type_that_is_described_anew_is_read_by_each_description(tmp_path):
    """Two firmwares in one file: RCOU with 14 outputs, then one of 8 outputs under the same number."""
    size = 3 + 8 + 16
    columns = "TimeUS," + ",".join(f"C{n}" for n in range(1, 9))
    form = (
        bytes([0xA3, 0x95, 128, 13, size]) + b"RCOU" + b"QHHHHHHHH".ljust(16, b"\0") + columns.encode().ljust(64, b"\0")
    )
    later = b"".join(
        bytes([0xA3, 0x95, 13]) + int((25.0 + k / 10) * 1e6).to_bytes(8, "little") + (1600).to_bytes(2, "little") * 8
        for k in range(50)
    )
    outputs = streams_of(written(tmp_path, dive() + form + later)).streams["outputs"]
    assert len(outputs) == 250 and outputs.channels == tuple(f"C{n}" for n in range(1, 9))
    assert (outputs.values[-50:] == 1600).all() and (outputs.values[:200, 3] == 1500).all()


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_description_ends_in_a_traceback(tmp_path, data):
    """Any byte of any description: rows or a sentence."""
    log = dive(seconds=3.0)
    for _ in range(data.draw(st.integers(1, 3))):
        name = data.draw(st.sampled_from(sorted(FORMS)))
        place = data.draw(st.integers(TYPE, 88))
        log = with_byte(name, place, data.draw(st.integers(0, 255) | st.sampled_from(b"aBbfdNnZQq,")), log)
    path = written(tmp_path, log)
    try:
        assert list(info_lines(streams_of(path)))
        tabulate(streams_of(path))
    except FlightLogError as error:
        assert str(error)


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
@pytest.mark.filterwarnings("error")
def test_any_number_in_any_field_of_a_text_log_is_read_or_left_out(tmp_path, data):
    """Not finite, of 400 digits, in other digits, or missing: rows or a sentence, and no warning of numpy."""
    odd = ["nan", "inf", "-inf", "9" * 400, "1e300", "-1", "0.5", "", "١٢", "1_0", "x", "\x1b[31m", "1,5"]
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines += [f"FMT, {kind}, 9, {name}, {types}, {columns}" for name, (kind, types, columns) in FORMS.items()]
    for k in range(60):
        for name, (_, types, _) in FORMS.items():
            row = [str(100_000 * k), *(data.draw(st.sampled_from(odd)) if k % 7 == 0 else "1" for _ in types[1:])]
            if k % 13 == 5:
                row[0] = data.draw(st.sampled_from(odd))
            lines.append(", ".join([name, *row]))
    path = written(tmp_path, "\n".join(lines).encode(), "flight.log")
    assert list(info_lines(streams_of(path), ReadOptions(parameters=ALL)))


def test_values_that_nothing_measures_are_left_out_and_counted(tmp_path):
    """An infinite angle is no angle; NaN is one that was not given."""
    also = {10.0: record("IMU", 10.0, 0, math.inf, 0.02, 0.05, 3e38, 0.0, -9.8)}
    streams = streams_of(written(tmp_path, dive(also=also)))
    assert "IMU has values that are infinite or beyond 1e+12; they are left out: 1 of GyrX, 1 of AccX" in sentences(
        streams.findings
    )
    assert np.nanmax(np.abs(streams.streams["accelerometer"].values)) < 10


def test_parameters_that_are_no_numbers_are_named_and_the_rest_is_used(tmp_path):
    """The frame is not known, the motors are."""
    path = written(tmp_path, dive(given={**ALL, "FRAME_CONFIG": math.nan, "STAT_RUNTIME": math.inf}))
    log = read_flightlog(path, HEAVY)
    assert f"parameters in {path.name} are no finite numbers and are left out: FRAME_CONFIG is nan, STAT_RUNTIME" in (
        sentences(log.findings)
    )
    assert "FRAME_CONFIG" not in log.autopilot and log.autopilot["MOT_1_DIRECTION"] == 1


def test_a_parameter_that_is_no_number_can_be_given(tmp_path):
    """The value of params takes its place."""
    path = written(tmp_path, dive(given={**ALL, "MOT_1_DIRECTION": math.nan}))
    with pytest.raises(FlightLogError, match="lacks MOT_1_DIRECTION"):
        read_flightlog(path, HEAVY)
    assert read_flightlog(path, HEAVY, options=ReadOptions(parameters={"MOT_1_DIRECTION": 1})).episodes


def test_an_attitude_of_one_sample_says_nothing_of_its_drift():
    """It is taken for what filters usually do."""
    angles = stream("attitude", ("roll", "pitch", "yaw"), "rad", [1.0], np.ones((1, 3)), Sampling.ESTIMATED, "ATT")
    gyro = stream("gyro", ("p", "q", "r"), "rad/s", [0.0, 1.0, 2.0], np.ones((3, 3)), Sampling.MEASURED, "IMU")
    assert angles is not None and drift_of(angles, gyro) == ANGLE_DRIFT


def test_nothing_is_compared_with_or_advised_from_what_is_no_number():
    """NaN on either side, in a finding and in what an effect says of a thruster."""
    odd = {**ALL, "MOT_1_DIRECTION": math.nan, "SERVO1_FUNCTION": math.nan}
    assert compare_configuration(ALL, [odd]) == [] == compare_configuration(odd, [ALL])
    finding = Finding(
        Severity.WARNING, "x", "x", param=(("MOT_1_DIRECTION", math.nan), ("A\nB", 1.0), ("RC3_MIN", 1100.0))
    )
    assert to_set([finding]) == {"RC3_MIN": 1100.0}
    for direction in (math.nan, 0.0, math.inf):
        (advice,) = thruster_gain({"gain_1": -1.0}, {"MOT_1_DIRECTION": direction})
        assert not advice.param and "nan" not in advice.do and "inf" not in advice.do
    assert known({"A": math.nan, "B": 1, "b\n": 2, "C" * 17: 3}) == {"B": 1.0}


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("MOT_3_DIRECTION", 1, None), ("FRAME_CONFIG", 8, "a whole number from 0 to 7"),
        ("SERVO12_FUNCTION", 33.5, "a whole number from -1 to 255"), ("SERVO2_TRIM", 0, "500 to 2200 us"),
        ("SERVO2_REVERSED", 2, "0 or 1"), ("RC3_MAX", 65535, "800 to 2200 us"), ("COMPASS_USE2", 1, None),
        ("MOT_PWM_MIN", 0, None), ("AHRS_ORIENTATION", 101, None), ("COMPASS_MOTCT", 7, "0 or 1 or 2"),
    ],
)  # fmt: skip
def test_a_parameter_outside_its_documented_range_is_named(tmp_path, name, value, allowed):
    """With its value and what it may be; those inside are not."""
    given = {**ALL, "RC3_MIN": 1100, "RC3_MAX": 1900, name: value}
    log = read_flightlog(written(tmp_path, dive(given=given)), HEAVY)
    said = sentences(finding for finding in log.findings if finding.code == "parameter_out_of_range")
    assert said == "" if allowed is None else f"{name} is {value:g} ({allowed})" in said


def test_every_entry_of_the_table_of_parameters_is_reached():
    """No row stands behind one that takes all of its names; samples of each row find it."""
    sample = {entry.names: entry for entry in PARAMETERS}
    assert len(sample) == len(PARAMETERS)
    names = ["FRAME_CONFIG", "MOT_12_DIRECTION", "MOT_PWM_MAX", "MOT_PWM_TYPE", "SERVO9_FUNCTION", "SERVO1_MIN",
             "SERVO1_REVERSED", "RC3_MIN", "AHRS_ORIENTATION", "AHRS_TRIM_X", "COMPASS_USE", "VISO_ORIENT",
             "VISO_POS_X", "BARO_PRIMARY", "INS_GYRO_FILTER", "BARO_SPEC_GRAV", "COMPASS_MOTCT", "COMPASS_MOT2_Y",
             "COMPASS_OFS_X", "BARO1_GND_PRESS", "STAT_RUNTIME"]  # fmt: skip
    assert {parameter(name) for name in names} == set(PARAMETERS)


@pytest.mark.parametrize("name", ["A\nMOT_1_DIRECT", "lower", "\x1b[31m", "SERVO١_MIN"])
def test_a_parameter_of_no_name_is_left_out_and_named(tmp_path, name):
    """A line break in a name makes no line of a file of parameters."""
    streams = streams_of(written(tmp_path, dive(given={**ALL, name: 1.0})))
    assert "have names that no parameter has and are left out" in sentences(streams.findings)
    assert set(streams.vehicle.parameters) == set(ALL)


@pytest.mark.parametrize("text", ["MOT_1_DIRECTION ١", "MOT_1_DIRECTION 1_0", "MOT_1_DIRECTION 0x1"])
def test_parameters_are_given_in_ascii_digits(tmp_path, text):
    """Other digits, underscores and hexadecimals are named; numbers that are none are left out with a finding."""
    with pytest.raises(FlightLogError, match="MOT_1_DIRECTION is .* no number"):
        read_options(params=str(written(tmp_path, text.encode(), "my.param")))
    with pytest.raises(FlightLogError, match="no number of a vehicle"):
        read_options(system="²")
    options = read_options(params=str(written(tmp_path, b"MOT_1_DIRECTION nan\nRC3_MIN 1100", "my.param")))
    assert options.parameters == {"RC3_MIN": 1100.0} and "my.param" in options.findings[0].sentence


def test_texts_of_a_file_do_nothing_to_a_terminal(tmp_path, capsys):
    """Firmware, parameter names, and the name of the file itself."""
    log = dive(given={**ALL, "\x1b[2J": 1.0}).replace(b"ArduSub V4.5.0", b"ArduSub\x1b[31mRED\x07")
    path = written(tmp_path, log, "dive\x1b[31m\u202e.BIN")
    main(["info", str(path)])
    with pytest.raises(SystemExit):
        main(["info", str(written(tmp_path, b"no log", "none\x1b[31m.BIN"))])
    told = capsys.readouterr()
    assert r"ArduSub\x1b[31mRED\x07" in told.out and r"none\x1b[31m.BIN" in told.err
    assert all(c.isprintable() or c == "\n" for c in told.out + told.err)


@pytest.mark.parametrize(
    "firmware",
    ["ArduCopter V4.5.7", "ArduPlane V4.1", "ArduRover V4.2", "APM:Copter V3.4", "AntennaTracker V1", "Blimp V0"],
)
def test_a_log_of_another_vehicle_is_named(tmp_path, firmware):
    """In info, which asks for no parameters of a submarine, and where it is to be diagnosed."""
    log = dive(given={}).replace(b"ArduSub V4.5.0".ljust(64, b"\0"), firmware.encode().ljust(64, b"\0"))
    path = written(tmp_path, log)
    kind = firmware.split()[0]
    said = "\n".join(info_lines(streams_of(path)))
    assert f"{kind} (text of the firmware, MSG): no underwater vehicle" in said and "MOT_" not in said
    with pytest.raises(FlightLogError, match=f"was written by {kind} .*: no underwater vehicle"):
        read_flightlog(path, HEAVY)


@pytest.mark.parametrize(
    "firmware", ["ArduSub V3.5.2", "ArduSub V4.7.0-dev (90700977)", "APM:Sub V3", "ROV [ArduSub V4.1]"]
)
def test_old_and_own_builds_of_the_firmware_are_read(firmware):
    """A name and a version, wherever it stands in the text."""
    kind = kind_of_text(firmware, "MSG")
    assert kind is not None and kind.underwater
    assert kind_of_text("Frame: VECTORED", "MSG") is None and kind_of_text("My ArduCopter notes", "MSG") is None


def test_kinds_that_disagree_are_a_finding_and_the_file_is_read(tmp_path):
    """The build says ArduSub, the text ArduCopter; two kinds in the air are refused with both."""
    form = bytes([0xA3, 0x95, 128, 99, 12]) + b"VER\0" + b"QB".ljust(16, b"\0") + b"TimeUS,BU".ljust(64, b"\0")
    version = bytes([0xA3, 0x95, 99]) + (5_000_000).to_bytes(8, "little") + b"\x07"
    log = dive(also={5.0: form + version}).replace(b"ArduSub V4.5.0\0\0\0", b"ArduCopter V4.5.0")
    findings = read_flightlog(written(tmp_path, log), HEAVY).findings
    assert "more than one kind of vehicle, ArduCopter (text of the firmware, MSG) and ArduSub (build" in sentences(
        findings
    )
    flying = kind_of_type(2, "heartbeat")
    assert flying is not None
    air = (Kind("text", "ArduCopter", False), flying)
    with pytest.raises(FlightLogError, match="ArduCopter \\(text\\) and a quadrotor \\(heartbeat\\)"):
        check_kind(Streams("x", "y", {}, VehicleFacts(kinds=air)))


DECIMAL = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 1, 9, ATT, Qfff, TimeUS,Roll,Pitch,Yaw\n"


def test_decimal_commas_are_read_where_fields_are_told_apart(tmp_path):
    """A space behind each field; the finding says so."""
    rows = "".join(f"ATT, {k}00000, 1,5, -0,25, {k}\n" for k in range(1, 30))
    messages = dataflash_text.read_messages(written(tmp_path, (DECIMAL + rows).encode(), "a.log"), ardupilot.WANTED)
    attitude = messages.types["ATT"]
    assert len(attitude["t"]) == 29 and set(attitude["Roll"]) == {1.5} and set(attitude["Pitch"]) == {-0.25}
    assert "decimal commas (29 lines)" in sentences(messages.findings)


def test_decimal_commas_that_cannot_be_told_apart_are_named(tmp_path):
    """Without the space: more fields than there are, in most lines."""
    rows = "".join(f"ATT,{k}00000,1,5,-0,25,{k},0\n" for k in range(1, 30)) + "ATT,1,2,3,4\n"
    messages = dataflash_text.read_messages(written(tmp_path, (DECIMAL + rows).encode(), "a.log"), ardupilot.WANTED)
    assert "29 without what their type has: left out: most of them have more fields" in sentences(messages.findings)
    assert "decimal points" in sentences(messages.findings)


def _full_of_descriptions(size: int) -> bytes:
    """Records of FMT that all differ."""
    made = []
    for k in range(size // 89):
        columns = f"TimeUS,B{k}".encode().ljust(64, b"\0")
        made.append(bytes([0xA3, 0x95, 128, k % 256, 15]) + b"A%03d" % (k % 1000) + b"Qf".ljust(16, b"\0") + columns)
    return dive(2.0) + b"".join(made)


def test_files_made_to_fill_the_memory_do_not(tmp_path):
    """4 MB of each thing that there can be most of add at most 150 MB to what a dive takes."""
    size = 4_000_000
    files = {
        "events.BIN": dive(2.0) + record("EV", 9.0, 10) * (size // 12),
        "parameters.BIN": dive(2.0) + record("PARM", 9.0, "A", 1.0) * (size // 31),
        "descriptions.BIN": _full_of_descriptions(size),
        "heads.BIN": dive(2.0) + b"\xa3\x95" * (size // 2),
        "line.log": (DECIMAL + "ATT, 1, " + "1," * (size // 2)).encode(),
        "rows.log": (DECIMAL + "ATT,1,2,3,4\n" * (size // 12)).encode(),
    }
    paths = [str(written(tmp_path, content, name)) for name, content in {"dive.BIN": dive(), **files}.items()]
    code = (
        "import sys\nfrom auv_torchrl.flightlog.readers import read_streams\n"
        "for path in sys.argv[1:]:\n"
        "    try: read_streams(path)\n"
        "    except ValueError: pass\n"
        f"    {PRINT_MOST_KIB}\n"
    )
    done = subprocess.run([sys.executable, "-c", code, *paths], capture_output=True, text=True, check=True)
    first, *others = map(int, done.stdout.split())
    assert len(others) == len(files) and max(others) - first < 150 * 1024
