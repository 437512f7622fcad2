"""PX4 logs, ROS bags and MCAP that firmware and vehicles wrote, out of the tests of other public projects.

They are not shipped: each is looked for below ``readers/`` of the folder of ``shared_data``, and its test
is skipped where it is not there. From which repository, commit and place each comes stands in ``SOURCES``.
"""

import numpy as np
import pytest

from auv_torchrl.flightlog import FlightLogError
from auv_torchrl.flightlog.readers import read_streams
from auv_torchrl.flightlog.streams import tabulate
from tests.flightlog.shared_data import shared
from tests.flightlog.vehicle_log import streams_of

PYULOG = "github.com/PX4/pyulog 3cf17793f14709713ab297d3743314c658874068 test/"
EVO = "github.com/MichaelGrupp/evo 26d0953d4da0f0cb56f90ba6269a15e72f69d3ad test/data/"
LOCALIZATION = "github.com/cra-ros-pkg/robot_localization 1cb953379378d13b3e0935ed73d0c7407bd80543 test/"
SOURCES = {  # below readers/: where it comes from
    "ulog/sample.ulg": PYULOG,  # a board on a desk, before PX4 1.6
    "ulog/sample_appended_multiple.ulg": PYULOG,  # PX4 1.6
    "ulog/sample_log_small.ulg": PYULOG,  # PX4 1.11, a tailsitter that is carried about
    "ulog/sample_logging_tagged_and_default_params.ulg": PYULOG,  # PX4 1.13, simulated
    "ulog/sample_px4_events.ulg": PYULOG,  # PX4 1.15, a simulated quadrotor takes off
    "rosbag/test1.bag": LOCALIZATION,  # a Husky whose IMU lies on its side
    "rosbag/test2.bag": LOCALIZATION,  # a Jackal
    "rosbag/ROS_example.bag": EVO,  # motion capture and two estimates
    "rosbag/tf_example.bag": EVO,  # transforms alone
    "rosbag2_mcap/nav2_turtlebot.mcap": EVO,  # a simulated TurtleBot, recorded by ros2 bag
    "rosbag2_sqlite3/tf_example/tf_example.db3": EVO,  # transforms alone, recorded by ros2 bag
    "blueos_mcap/recorder_20260826_181307_no_video.mcap": (
        "github.com/clydemcqueen/ardusub_log_tools d023c1941217c8ee9c7eecac89366644cf6a0f8d testing/"
    ),
}


def real(name: str):
    """The path of a recording, below ``readers/``; skips the test without it."""
    assert name in SOURCES
    return shared(f"readers/{name}")


def sampled(stream, channel: str, t):
    """A channel at other times, angles without their leaps."""
    values = stream.values[:, stream.channels.index(channel)]
    return np.interp(t, stream.t, np.unwrap(values) if channel in ("roll", "pitch", "yaw") else values)


def moments(*streams):
    """Times every 0.5 s that all of them cover."""
    return np.arange(max(s.t[0] for s in streams) + 0.5, min(s.t[-1] for s in streams) - 0.5, 0.5)


@pytest.mark.parametrize(
    ("name", "firmware", "seconds"),
    [
        ("sample.ulg", "PX4", 68.9),
        ("sample_appended_multiple.ulg", "PX4 1.6.0", 9.6),
        ("sample_log_small.ulg", "PX4 1.11.2", 6.5),
        ("sample_logging_tagged_and_default_params.ulg", "PX4 1.13.0", 10.8),
        ("sample_px4_events.ulg", "PX4 1.15.0", 31.1),
    ],
)
def test_each_release_of_px4_is_read(name, firmware, seconds):
    """Motion, firmware and parameters; what is felt at rest or in hover is the weight, upwards out of a level body."""
    streams = streams_of(real(f"ulog/{name}"))
    assert streams.vehicle.firmware == firmware and len(streams.vehicle.parameters) > 400
    assert streams.end - streams.start == pytest.approx(seconds, abs=1.0)
    assert {"attitude", "gyro", "accelerometer", "position"} <= streams.streams.keys()
    felt = streams.streams["accelerometer"].values
    attitude = streams.streams["attitude"]
    pitch, roll = sampled(attitude, "pitch", attitude.t), sampled(attitude, "roll", attitude.t)
    up = -np.array(
        [-np.sin(pitch).mean(), (np.sin(roll) * np.cos(pitch)).mean(), (np.cos(roll) * np.cos(pitch)).mean()]
    )
    assert np.linalg.norm(felt, axis=1).mean() == pytest.approx(9.8, abs=0.3)
    assert felt.mean(0) == pytest.approx(9.8 * up, abs=0.8)


def test_a_flight_of_px4_is_read_with_its_commands():
    """Four motors, armed and disarmed again, modes by name; where it went is what its velocity adds up to.

    It is a quadrotor, and no diagnosis begins with it.
    """
    streams = streams_of(real("ulog/sample_px4_events.ulg"))
    commands = streams.streams["commands"]
    assert commands.channels == ("cmd_1", "cmd_2", "cmd_3", "cmd_4") and 0.5 < commands.values.max() < 0.6
    assert streams.armed is not None and len(streams.armed) == 1
    assert streams.armed[0] == (pytest.approx(14.9, abs=0.1), pytest.approx(30.1, abs=0.1))
    assert [mode for _, mode in streams.modes][1:4] == ["AUTO_TAKEOFF", "AUTO_LOITER", "AUTO_RTL"]
    position, velocity = streams.streams["position"], streams.streams["velocity"]
    t = moments(position, velocity)
    fallen = np.diff(sampled(position, "z", t)) / 0.5
    assert np.corrcoef(fallen, sampled(velocity, "down", (t[1:] + t[:-1]) / 2))[0, 1] > 0.9
    with pytest.raises(FlightLogError, match="a quadrotor .*: no underwater vehicle"):
        tabulate(streams)


@pytest.mark.parametrize("name", ["rosbag/test1.bag", "rosbag/test2.bag", "rosbag2_mcap/nav2_turtlebot.mcap"])
def test_a_robot_goes_where_its_bow_points(name):
    """Odometry of ROS in ENU and FLU: the way in NED, turned by the heading, is the speed ahead in FRD."""
    streams = streams_of(real(name))
    position, attitude, speed = (streams.streams[key] for key in ("position", "attitude", "body_velocity"))
    t = moments(position, attitude, speed)
    middle = (t[1:] + t[:-1]) / 2
    north, east = (np.diff(sampled(position, axis, t)) / 0.5 for axis in "xy")
    yaw, ahead = sampled(attitude, "yaw", middle), sampled(speed, "u", middle)
    gone = north * np.cos(yaw) + east * np.sin(yaw)
    assert np.corrcoef(gone, ahead)[0, 1] > 0.95
    assert np.polyfit(ahead, gone, 1)[0] == pytest.approx(1.0, abs=0.06)
    assert np.std(east * np.cos(yaw) - north * np.sin(yaw)) < 0.05 * np.std(ahead)


def test_an_imu_that_is_mounted_otherwise_is_told():
    """On its side, in a frame of its own: what it feels is no weight out of a level body, and a finding says why."""
    told = {finding.code: finding for finding in streams_of(real("rosbag/test1.bag")).findings}
    assert "imu_link" in told["imu_frame"].sentence
    level = streams_of(real("rosbag/test2.bag"))
    assert "imu_frame" not in {finding.code for finding in level.findings}
    assert level.streams["accelerometer"].values.mean(0) == pytest.approx((0, 0, -9.8), abs=0.3)


def test_of_several_estimates_one_is_taken_whole():
    """Motion capture has the most samples; place and heading come from it alone."""
    streams = streams_of(real("rosbag/ROS_example.bag"))
    assert {streams.streams[key].source for key in ("position", "attitude")} == {"groundtruth"}
    assert len(streams.streams["position"]) == 12765


@pytest.mark.parametrize("name", ["rosbag/tf_example.bag", "rosbag2_sqlite3/tf_example/tf_example.db3"])
def test_a_bag_of_transforms_alone_is_refused(name):
    """What it holds, and what to record instead."""
    path = real(name)
    with pytest.raises(FlightLogError, match="has no topic that is known .*tf2_msgs/TFMessage.*: record"):
        read_streams(path.parent if path.suffix == ".db3" else path)


def test_a_recording_of_blueos_is_read():
    """What the recorder of BlueOS writes while the vehicle is armed: outputs, attitude, depth."""
    streams = streams_of(real("blueos_mcap/recorder_20260826_181307_no_video.mcap"))
    assert {"outputs", "attitude"} <= streams.streams.keys()
