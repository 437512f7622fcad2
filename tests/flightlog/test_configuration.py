"""What an owner has set wrong, found from the parameters alone."""

import pytest

from auv_torchrl.flightlog import FlightLogError, read_flightlog
from auv_torchrl.flightlog.command import main
from auv_torchrl.flightlog.streams import tabulate
from auv_torchrl.flightlog.streams.configuration import check_configuration, compare_configuration, to_set
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.dataflash_writer import ALL, dive, record
from tests.flightlog.shared_data import shared
from tests.flightlog.vehicle_log import streams_of

HEAVY = load_vehicle("bluerov2_heavy")
PULSES = {f"SERVO{n}_{way}": us for n in range(1, 9) for way, us in (("MIN", 1100), ("MAX", 1900), ("TRIM", 1500))}


def written(tmp_path, given, **dived):
    path = tmp_path / "00000001.BIN"
    path.write_bytes(dive(given=given, **dived))
    return path


def found(tmp_path, **changed):
    given = {**ALL, **PULSES, **changed}
    streams = streams_of(written(tmp_path, given))
    return {finding.code: finding for finding in check_configuration(streams, streams.vehicle.parameters)}


def test_a_vehicle_that_is_set_right_is_not_blamed(tmp_path):
    """Nothing is found in the parameters of a Heavy as it comes."""
    assert not found(tmp_path)


def test_a_motor_on_no_output_gets_no_command_and_its_parameter_is_named(tmp_path):
    """The rest of the vehicle can still be diagnosed."""
    finding = found(tmp_path, SERVO3_FUNCTION=0)["motor_on_no_output"]
    assert "motor 3 is on no output (no SERVOn_FUNCTION is 35)" in finding.sentence
    assert "Set SERVO3_FUNCTION to 35 (it is 0)" in finding.remedy and finding.param == (("SERVO3_FUNCTION", 35.0),)
    log = read_flightlog(tmp_path / "00000001.BIN", HEAVY)
    assert not log.episodes[0].commands[:, 2].any()
    assert "motor_on_no_output" in {f.code for f in log.findings}


def test_one_motor_on_two_outputs_leaves_another_on_none(tmp_path):
    """A digit mistyped: both motors are named, and the output that is to be set."""
    several = found(tmp_path, SERVO5_FUNCTION=35)
    assert "motor 3 is on outputs 3 and 5" in several["motor_on_two_outputs"].sentence
    assert several["motor_on_no_output"].param == (("SERVO5_FUNCTION", 37.0),)
    columns = tabulate(streams_of(tmp_path / "00000001.BIN")).columns
    assert columns["cmd_3"].max() == pytest.approx(0.5) and not columns["cmd_5"].any()


def test_motors_in_another_order_are_told_and_not_blamed(tmp_path):
    """Plugs may have been exchanged as well."""
    finding = found(tmp_path, SERVO3_FUNCTION=37, SERVO5_FUNCTION=35)["motors_not_in_order"]
    assert "motors 3, 5 are on outputs 5, 3" in finding.sentence and not finding.param


def test_pulses_of_one_motor_that_differ_are_named(tmp_path):
    """A trim and a limit; where all have the same, there is nothing to say but for limits that take thrust from all."""
    finding = found(tmp_path, SERVO2_TRIM=1480)["uneven_pulses"]
    assert "SERVO2_TRIM, of motor 2, is 1480, and 1500 for the other motors" in finding.sentence
    assert finding.param == (("SERVO2_TRIM", 1500),)
    assert not found(tmp_path, **{f"SERVO{n}_TRIM": 1490 for n in range(1, 9)})
    assert "MOT_PWM_MAX 1700" in found(tmp_path, MOT_PWM_MAX=1700)["pulse_limits"].sentence


def test_a_vehicle_that_seems_to_lie_on_its_back_has_its_autopilot_turned(tmp_path):
    """Its attitude says so all along, which no owner flies."""
    data = dive(given={**ALL, "AHRS_ORIENTATION": 0}).replace(
        record("ATT", 0, 1.0, -2.0, 0.0)[11:15], record("ATT", 0, 179.0, -2.0, 0.0)[11:15]
    )
    path = tmp_path / "00000001.BIN"
    path.write_bytes(data)
    streams = streams_of(path)
    (finding,) = check_configuration(streams, streams.vehicle.parameters)
    assert finding.code == "upside_down" and finding.limits and "AHRS_ORIENTATION" in finding.remedy


def test_what_differs_from_a_healthy_flight_is_set_back():
    """Direction, exchanged outputs, orientation and limits by name; what counts up by itself is not told."""
    sound = {**ALL, "AHRS_ORIENTATION": 0, "STAT_RUNTIME": 10, "PILOT_SPEED": 50}
    now = {
        **sound, "MOT_3_DIRECTION": -1, "SERVO3_FUNCTION": 37, "SERVO5_FUNCTION": 35, "AHRS_ORIENTATION": 8,
        "MOT_PWM_MAX": 1700, "STAT_RUNTIME": 90, "PILOT_SPEED": 80,
    }  # fmt: skip
    findings = compare_configuration(now, [sound])
    assert to_set(findings) == {
        "MOT_3_DIRECTION": 1, "SERVO3_FUNCTION": 35, "SERVO5_FUNCTION": 37, "AHRS_ORIENTATION": 0, "MOT_PWM_MAX": 1900,
    }  # fmt: skip
    sentences = " ".join(map(str, findings))
    assert "motors 3 and 5 have exchanged their outputs" in sentences
    assert "Set MOT_3_DIRECTION to 1" in sentences and "PILOT_SPEED 80 (was 50)" in sentences
    assert "STAT_RUNTIME" not in sentences
    assert not compare_configuration(sound, [sound]) and not compare_configuration(now, [{}])
    assert not compare_configuration(now, [sound, now])


def test_a_parameter_that_is_set_in_flight_is_told_with_its_moment(tmp_path):
    """One value is read for all of the log, so that what it says is in doubt."""
    path = written(tmp_path, ALL, also={15.0: record("PARM", 15.0, "MOT_3_DIRECTION", -1.0)})
    (finding,) = (f for f in streams_of(path).findings if f.code == "set_in_flight")
    assert finding.limits and "MOT_3_DIRECTION was set from 1 to -1 at 10.0 s" in finding.sentence


def test_auv_log_compares_with_a_healthy_log(tmp_path, capsys):
    """A motor direction that differs, and a healthy log without parameters."""
    (tmp_path / "sound").mkdir()
    sound, now = written(tmp_path / "sound", ALL), written(tmp_path, {**ALL, "MOT_3_DIRECTION": -1})
    main(["info", str(now), f"healthy={sound}"])
    assert "warning: MOT_3_DIRECTION, the direction of motor 3, is -1, and was 1" in capsys.readouterr().out
    empty = written(tmp_path / "sound", {})
    with pytest.raises(SystemExit):
        main(["info", str(now), f"healthy={empty}"])
    assert "holds no parameters of an autopilot" in capsys.readouterr().err


def test_functions_that_a_telemetry_link_lost_are_asked_for(tmp_path):
    """A parameter that was not heard is no motor on no output."""
    given = {name: value for name, value in ALL.items() if name != "SERVO3_FUNCTION"}
    with pytest.raises(FlightLogError, match="lacks SERVO3_FUNCTION: save all"):
        read_flightlog(written(tmp_path, given), HEAVY)


def test_the_firmwares_own_flight_with_a_wrong_direction_is_named():
    """Beside a flight of the same simulated vehicle with the direction right."""
    wrong, sound = (streams_of(shared(f"ardusub_sitl/{name}.BIN")) for name in ("motdir1_minus", "healthy_a"))
    (finding,) = compare_configuration(wrong.vehicle.parameters, [sound.vehicle.parameters])
    assert finding.param == (("MOT_1_DIRECTION", 1.0),)
    assert not check_configuration(sound, sound.vehicle.parameters)
