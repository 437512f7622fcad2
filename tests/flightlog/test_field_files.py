"""Inputs that failed in the field: what ``auv-log info`` and the readers say of each, in its own words.

The files are not shipped; tests of the kinds of defects build their own (``test_hostile_*.py``, ``test_columns.py``).
"""

import subprocess
import sys
from pathlib import Path

import pytest

from auv_torchrl.flightlog import FlightLogError, read_flightlog
from auv_torchrl.flightlog.command import main
from auv_torchrl.text import printable
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.shared_data import shared
from tests.memory import PRINT_MOST_KIB

DAMAGED = "is left out. Copy the file from the vehicle again."
MOST_BYTES = 1.5e9  # of memory that a log below 100 MB may take


def place(name: str) -> Path:
    """The file, or the folder of a bag."""
    return shared(f"field/{name}/metadata.yaml").parent if name == "bag_lfs" else shared(f"field/{name}")


def said_of(path: Path, capsys, *more: str) -> str:
    """Output and errors of ``auv-log info`` as one text, which is safe to print and fits the width of a terminal."""
    try:
        main(["info", str(path), *more])
    except SystemExit as ended:
        assert ended.code == 2
    out, error = capsys.readouterr()
    assert error.count("\n") <= 1 and "Traceback" not in error
    lines = out.splitlines()
    assert all(printable(line, None) == line for line in (*lines, error.strip()))
    assert all(len(line) <= 80 for line in lines if "python diagnose.py" not in line)
    return " ".join((out + error).split())


@pytest.mark.parametrize(
    ("name", "right"),
    [
        ("one_bit_fmt_XKQ.BIN", ["message XKQ is damaged, it says that Q1 is text: XKQ " + DAMAGED, "attitude roll"]),
        (
            "fz2_1_251.BIN",
            ["message RCOU is damaged", "message XKF1 is damaged, it says that PN is text", "gyro"],
        ),
        ("one_bit_fmt_RCOU_name.BIN", ["message RCOU is damaged, its name is 'rCOU': RCOU " + DAMAGED, "not yet"]),
        ("v16_FRAME_CONFIG_nan.BIN", ["FRAME_CONFIG is nan", "parameters 1015", "diagnosis 559 rows"]),
        ("mc_big_mode.mcap", ["mc_big_mode.mcap holds no MAVLink message that can be read", "cut or damaged"]),
        ("p_big.csv", ["p_big.csv: what auv-log said of it is damaged (x is no number", "convert the log again"]),
        ("bomb.mcap", ["bomb.mcap holds no MAVLink", "left out because it is more than a log needs: chunks"]),
        ("s01_ansi.BIN", [r"firmware ArduSub\x1b[31mRED\x1b]0;pwned\x07", "diagnosis 359 rows"]),
        ("copter.BIN", ["ArduCopter (text of the firmware, MSG): no underwater vehicle", "diagnosis none"]),
        ("decimal_commas.log", ["decimal commas (817 lines)", "outputs C1 ... C8 [us], 20 Hz, 400 samples"]),
        ("bag_lfs", ["run_0.db3 is a pointer of git-lfs", "git lfs pull"]),
        (
            "c1_gym.csv",
            [
                "time t time in s",
                "error - what a controller wants",
                "x and y cannot be used without yaw",
                "diagnosis of z,",
            ],
        ),
        (
            "c2_depth_pid.csv",
            ["depth z depth in m", "setpoint - what a controller", "missing commands", "not yet"],
        ),
        (
            "c4_pwm_deg.csv",
            ["t time in s, given as a date", "pwm1 to pwm8 cmd_1 to cmd_8", "roll in rad, given in degrees"],
        ),
    ],
)
def test_each_file_is_read_or_named(name, right, capsys):
    """Damage, foreign vehicles, units and what is missing are said, without a traceback or a character that acts."""
    said = said_of(place(name), capsys)
    assert [part for part in right if part not in said] == []
    assert "did you mean" not in said


@pytest.mark.parametrize(
    ("name", "vehicle", "cause"),
    [
        ("copter.BIN", "bluerov2_heavy", "was written by ArduCopter .*no underwater vehicle"),
        ("mc_big_mode.mcap", "bluerov2_heavy", "no MAVLink message that can be read"),
        ("bag_lfs", "bluerov2_heavy", "pointer of git-lfs"),
        ("bomb.mcap", "bluerov2_heavy", "more than a log needs"),
        ("p_big.csv", "paper", "is damaged"),
        ("c2_depth_pid.csv", "paper", "no commands"),
        ("one_bit_fmt_RCOU_name.BIN", "bluerov2_heavy", "the description of the message RCOU is damaged"),
        ("fz2_1_251.BIN", "bluerov2_heavy", "the description of the message RCOU is damaged"),
    ],
)
def test_what_cannot_be_diagnosed_is_refused_in_a_line(name, vehicle, cause):
    """The error names the file, the cause and what to do."""
    path = place(name)
    with pytest.raises(FlightLogError, match=cause) as error:
        read_flightlog(path, load_vehicle(vehicle))
    said = str(error.value)
    assert path.name in said and "\n" not in said and len(said) <= 1000


@pytest.mark.parametrize("name", ["one_bit_fmt_XKQ.BIN", "v16_FRAME_CONFIG_nan.BIN", "s01_ansi.BIN", "s03.BIN"])
def test_the_rest_of_a_damaged_flight_is_read(name):
    """A message, a parameter or a text that cannot be used costs no other."""
    flight = read_flightlog(place(name), load_vehicle("bluerov2_heavy"))
    assert flight.duration > 15 and {"z", "yaw", "p"} <= set(flight.axes)


def test_parameters_that_are_no_numbers_give_no_advice(capsys):
    """Beside a sound flight whose parameters are NaN, nothing is to be set to nan."""
    said = said_of(place("s03.BIN"), capsys, f"healthy={place('s03_h_nan.BIN')}")
    assert "MOT_1_DIRECTION is nan" in said and "to nan" not in said


def test_a_packing_that_claims_gigabytes_takes_a_bounded_memory():
    """50 kB that unpack to gigabytes: ``auv-log info`` stays below 1.5 GB."""
    code = (
        "import sys; from auv_torchrl.flightlog.command import main\n"
        "try: main(['info', sys.argv[1]])\n"
        f"except SystemExit: {PRINT_MOST_KIB}"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(place("bomb.mcap"))], capture_output=True, text=True, check=True
    )
    assert 1024 * int(done.stdout) < MOST_BYTES
