"""``mapping=FILE``: columns and messages that only their owner knows are read as streams."""

import numpy as np
import pytest

from auv_torchrl.flightlog import FlightLogError, read_flightlog
from auv_torchrl.flightlog.command import main
from auv_torchrl.flightlog.readers import read_streams
from auv_torchrl.flightlog.streams import tabulate
from auv_torchrl.flightlog.streams.options import read_options
from auv_torchrl.vehicle import load_vehicle

TABLE = """
commands: {values: [pwm_1, pwm_2, -pwm_3], unit: us, sampling: held}
attitude: {values: {roll: phi, pitch: theta, yaw: psi}, unit: deg}
gyro: {values: {r: wz}, unit: deg/s}
depth: {values: {z: pressure}, scale: 1.0e-4, offset: -10.0}
"""
BAG = """
commands: {topic: /own/pulses, values: [data.0, data.1], unit: us}
gyro: {topic: own/imu, values: [data.1, data.2, data.3]}
"""
HOSTILE = {  # what is wrong: the mapping, what the answer names
    "nothing": ("{}", "give commands"),
    "no commands": ("gyro: {values: [a, b, c]}", "commands is missing"),
    "unknown stream": ("comands: {values: [a]}", "did you mean commands"),
    "unknown entry": ("commands: {value: [a]}", "did you mean values"),
    "unknown unit": ("commands: {values: [pwm_1], unit: ms}", "unit"),
    "unknown sampling": ("commands: {values: [pwm_1], sampling: hold}", "did you mean held"),
    "no numbers": ("commands: {values: 3}", "one for each thruster"),
    "an empty name": ("commands: {values: ['-']}", "such as data.0 or -depth"),
    "too few values": ("{commands: {values: [pwm_1]}, gyro: {values: [wz]}}", "by name"),
    "no such axis": ("{commands: {values: [pwm_1]}, gyro: {values: {x: wz}}}", "p, q, r"),
    "no finite scale": ("commands: {values: [pwm_1], scale: .inf}", "scale"),
    "no such column": ("commands: {values: [pwm_4]}", "no column pwm_4"),
    "topics of a table": ("commands: {topic: /a, values: [data.0]}", "leave topic out"),
    "half with topics": ("{commands: {topic: /a, values: [d]}, depth: {values: [d]}}", "a topic to all"),
    "a list": ("[1, 2]", "mapping"),
    "no YAML": ("commands: [", "no YAML"),
}


def mapping(tmp_path, text):
    """A mapping as options."""
    path = tmp_path / "mapping.yaml"
    path.write_text(text)
    return read_options(mapping=str(path))


@pytest.fixture
def table(tmp_path):
    """Pulses at each change, angles at 20 Hz, rates at 100 Hz: a row for each time at which anything came."""
    t = np.arange(0, 10, 0.01)
    lines = ["t,pwm_1,pwm_2,pwm_3,phi,theta,psi,wz,pressure"]
    for k, now in enumerate(t):
        pulses = f"{1700 if k % 40 else 1300},1500,1700" if k % 20 == 0 else ",,"
        angles = f"{10 * np.cos(now):.4f},{5 * np.sin(now):.4f},{9 * now:.4f}" if k % 5 == 0 else ",,"
        lines.append(f"{now:.2f},{pulses},{angles},{9 + np.sin(3 * now):.4f},{120000 + 100 * np.sin(now):.2f}")
    path = tmp_path / "own.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_table_is_read_as_its_owner_says(tmp_path, table):
    """Pulses become commands, degrees radians, a sign turns, a pressure is a depth; each stream keeps its own rate."""
    streams = read_streams(table, mapping(tmp_path, TABLE))
    assert streams is not None
    commands, attitude, gyro = (streams.streams[name] for name in ("commands", "attitude", "gyro"))
    assert commands.values[0].tolist() == [-0.5, 0.0, -0.5] and commands.sampling == "held"
    assert [one.interval for one in (commands, attitude, gyro)] == pytest.approx([0.2, 0.05, 0.01])
    assert attitude.values[0] == pytest.approx([np.deg2rad(10), 0.0, 0.0]) and gyro.channels == ("r",)
    assert gyro.values[0] == pytest.approx(np.deg2rad(9))
    columns = tabulate(streams).columns
    assert columns["z"] == pytest.approx(2.0, abs=0.02)
    assert set(np.unique(columns["cmd_1"])) == {-0.5, 0.5}


def test_a_mapped_table_is_a_flight_log(tmp_path, table):
    """The diagnosis reads it like every other log; without its mapping it cannot."""
    vehicle = load_vehicle("paper")
    six = TABLE.replace("-pwm_3]", "-pwm_3, pwm_2, pwm_2, pwm_2]")
    log = read_flightlog(table, vehicle, options=mapping(tmp_path, six))
    assert {"roll", "pitch", "yaw", "r", "z"} <= set(log.axes) and log.episodes[0].duration > 9.5
    with pytest.raises(FlightLogError):
        read_flightlog(table, vehicle)


def test_messages_of_a_type_of_ones_own_are_read(tmp_path):
    """Topics are found with or without a slash in front; times are those of the recording."""
    typesys = pytest.importorskip("rosbags.typesys")
    from rosbags.rosbag1 import Writer

    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
    layout = store.types["std_msgs/msg/MultiArrayLayout"]([], 0)
    pulses, imu = (store.types[f"std_msgs/msg/{name}MultiArray"] for name in ("UInt16", "Float32"))
    path = tmp_path / "own.bag"
    with Writer(path) as out:
        one, other = (
            out.add_connection(topic, kind.__msgtype__, typestore=store)
            for topic, kind in (("/own/pulses", pulses), ("/own/imu", imu))
        )
        for k in range(100):
            data = pulses(layout, np.array([1900, 1400], np.uint16))
            out.write(one, k * 50_000_000, store.serialize_ros1(data, pulses.__msgtype__))
            data = imu(layout, np.array([k, 0.1, 0.2, 0.3], np.float32))
            out.write(other, k * 50_000_000, store.serialize_ros1(data, imu.__msgtype__))
    streams = read_streams(path, mapping(tmp_path, BAG))
    assert streams is not None
    assert streams.streams["commands"].values == pytest.approx(np.tile([1.0, -0.25], (100, 1)))
    assert streams.streams["gyro"].values == pytest.approx(np.tile([0.1, 0.2, 0.3], (100, 1)))
    assert streams.end == pytest.approx(4.95)
    for wrong, named in (("data.7", None), ("date.0", "did you mean data.0"), ("data", "data.0")):
        options = mapping(tmp_path, BAG.replace("data.1, data.2", f"{wrong}, data.2"))
        if named is None:  # an array may be shorter at times
            read = read_streams(path, options)
            assert read is not None and np.isnan(read.streams["gyro"].values[:, 0]).all()
            continue
        with pytest.raises(FlightLogError, match=named):
            read_streams(path, options)
    with pytest.raises(FlightLogError, match="did you mean /own/imu"):
        read_streams(path, mapping(tmp_path, BAG.replace("own/imu", "own/imv")))


@pytest.mark.parametrize("case", HOSTILE)
def test_a_mapping_that_cannot_be_used_is_told_in_a_line(tmp_path, table, case):
    """One line names the file and what is wrong with it."""
    text, named = HOSTILE[case]
    with pytest.raises(FlightLogError) as error:
        read_streams(table, mapping(tmp_path, text))
    assert named in str(error.value) and "\n" not in str(error.value)


def test_info_takes_a_mapping(tmp_path, table, capsys):
    """``auv-log info`` shows the streams."""
    (tmp_path / "own.yaml").write_text(TABLE)
    main(["info", str(table), f"mapping={tmp_path / 'own.yaml'}"])
    printed = capsys.readouterr().out
    assert "table, as mapped" in printed and "r [rad/s], 100 Hz" in printed
