"""Telemetry of a ground station: the streams of the vehicle's own log, slower, and what a link does to them."""

import struct
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from auv_torchrl.flightlog import FlightLogError, read_flightlog
from auv_torchrl.flightlog.streams import ReadOptions, tabulate
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.dataflash_writer import ALL
from tests.flightlog.shared_data import EXCERPTS, shared
from tests.flightlog.vehicle_log import streams_of

EXCERPT = EXCERPTS / "ardusub.tlog"
dialect = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")


def sent(link, t: float, message) -> bytes:
    """A message as a ground station records it, at ``t`` s of the year 2023."""
    return struct.pack(">Q", round((1.7e9 + t) * 1e6)) + message.pack(link)


def heartbeat(armed: bool, mode: int = 19, autopilot: int = 3):
    return dialect.MAVLink_heartbeat_message(12, autopilot, 128 * armed, mode, 4, 3)


def attitude(t: float, roll: float = 0.1):
    return dialect.MAVLink_attitude_message(round(t * 1e3), roll, 0.0, 1.0, 0.0, 0.0, 0.0)


def telemetry(system: int = 1, seconds: int = 20, late: float = 0.0) -> bytes:
    """Armed from 5 s on, attitude at 10 Hz that the link delivers ``late`` s late every other time."""
    link = dialect.MAVLink(None, srcSystem=system, srcComponent=1)
    made = b""
    for k in range(seconds * 10):
        t = k / 10
        if k % 10 == 0:
            made += sent(link, t, heartbeat(t >= 5))
        made += sent(link, t + late * (k % 2), attitude(t + 100, roll=t / 100))
    return made


def written(tmp_path, data: bytes):
    path = tmp_path / "flight.tlog"
    path.write_bytes(data)
    return path


def test_the_excerpt_of_the_firmware_is_read():
    """Fourteen seconds of what ArduSub 4.7 sent of its simulated flight."""
    streams = streams_of(EXCERPT)
    assert streams.vehicle.frame == "vectored_6dof" and streams.streams["depth"].source == "SCALED_PRESSURE"
    log = read_flightlog(EXCERPT, load_vehicle("bluerov2_heavy"))
    assert {"x", "y", "z", "roll", "pitch", "yaw", "p", "q", "r", "ax", "ay", "az"} == set(log.axes)
    assert streams.streams["accelerometer"].source == "RAW_IMU" and log.duration > 13


def test_times_are_those_of_the_vehicle_and_not_of_the_link(tmp_path):
    """Every other packet 80 ms late leaves the attitude at even times, and roll where it was then."""
    told = streams_of(written(tmp_path, telemetry(late=0.08))).streams["attitude"]
    assert np.diff(told.t) == pytest.approx(0.1, abs=1e-6)
    assert np.diff(told.values[:, 0]) == pytest.approx(1e-3, abs=1e-6)


def test_arming_and_mode_are_those_of_the_heartbeats(tmp_path):
    """Disarmed at first, which is no end of having been armed."""
    streams = streams_of(written(tmp_path, telemetry()))
    assert streams.armed == ((pytest.approx(5.0), pytest.approx(19.9)),) and streams.modes[0][1] == "MANUAL"


def test_of_several_vehicles_one_is_chosen(tmp_path):
    """Without system= a sentence lists them; a companion computer is none."""
    link = dialect.MAVLink(None, srcSystem=9, srcComponent=1)
    data = telemetry(1) + telemetry(4) + sent(link, 30, heartbeat(False, autopilot=8))
    path = written(tmp_path, data)
    with pytest.raises(FlightLogError, match="several vehicles, 1, 4: choose one, such as system=1"):
        streams_of(path)
    with pytest.raises(FlightLogError, match="no vehicle 9: there are 1, 4"):
        streams_of(path, ReadOptions(system=9))
    assert len(streams_of(path, ReadOptions(system=4)).streams["attitude"]) == 200


def test_what_telemetry_lacks_is_asked_for_by_name(tmp_path):
    """Outputs without parameters, and a vehicle that was never armed."""
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    pulses = b"".join(
        sent(link, k / 10, dialect.MAVLink_servo_output_raw_message(round(1e8 + 1e5 * k), 0, *[1500 + k] * 8))
        for k in range(200)
    )
    path = written(tmp_path, telemetry() + pulses)
    with pytest.raises(FlightLogError, match=r"lacks FRAME_CONFIG, SERVO1_FUNCTION to SERVO8_FUNCTION, .*params="):
        tabulate(streams_of(path))
    still = b"".join(sent(link, k, heartbeat(False)) + sent(link, k, attitude(k + 100)) for k in range(20))
    path = written(tmp_path, still + pulses)
    with pytest.raises(FlightLogError, match="not armed while commands were logged"):
        tabulate(streams_of(path), ReadOptions(parameters=ALL))


def test_a_vehicle_that_starts_again_is_put_behind(tmp_path):
    """Its clock begins anew; the attitude goes on, where it was received."""
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    again = b"".join(sent(link, 60 + k / 10, attitude(k / 10)) for k in range(100))
    told = streams_of(written(tmp_path, telemetry() + again)).streams["attitude"]
    assert len(told) == 300 and told.gaps == ((pytest.approx(19.9), pytest.approx(60.0)),)


def test_a_missing_library_is_one_line(tmp_path, monkeypatch):
    """What to install."""
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20.ardupilotmega", None)
    with pytest.raises(FlightLogError, match=r"pymavlink, which is not installed: pip install 'auv_torchrl\[logs\]'"):
        streams_of(EXCERPT)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_damage_ends_in_a_traceback(tmp_path, data):
    """Cut anywhere, bytes changed anywhere behind the first packet: rows or a sentence."""
    content = bytearray(EXCERPT.read_bytes())
    end = data.draw(st.integers(20, len(content)))
    for place in data.draw(st.lists(st.integers(20, len(content) - 1), max_size=40)):
        content[place] = data.draw(st.integers(0, 255))
    path = written(tmp_path, bytes(content[:end]))
    try:
        tabulate(streams_of(path))
    except FlightLogError as error:
        assert "\n" not in str(error)


def test_the_real_telemetry_is_read():
    """A Heavy, armed for 16 s, with a companion, a camera and a ground station on the link."""
    streams = streams_of(shared("ardusub_real/small.tlog"))
    assert streams.streams["depth"].source == "SCALED_PRESSURE2"
    assert streams.armed is not None
    assert sum(end - begin for begin, end in streams.armed) == pytest.approx(16, abs=1)
    assert streams.vehicle.parameters["MOT_5_DIRECTION"] == -1


def test_telemetry_of_another_vehicle_is_named(tmp_path):
    """By the type in its heartbeats; where the text of the firmware says otherwise, a finding names both."""
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    copter = dialect.MAVLink_heartbeat_message(2, 3, 128, 0, 4, 3)
    beats = b"".join(sent(link, k, copter) + sent(link, k, attitude(k + 100)) for k in range(20))
    with pytest.raises(FlightLogError, match=r"a quadrotor \(HEARTBEAT.type\): no underwater vehicle"):
        tabulate(streams_of(written(tmp_path, beats)))
    text = sent(link, 0, dialect.MAVLink_statustext_message(6, b"ArduSub V4.1.1"))
    kinds = streams_of(written(tmp_path, text + beats)).vehicle.kinds
    assert [(kind.name, kind.underwater) for kind in kinds] == [("ArduSub", True), ("a quadrotor", False)]
